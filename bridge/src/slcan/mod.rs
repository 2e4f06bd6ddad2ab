//! SLCAN: a CAN adapter on a serial port, with a protocol of ASCII lines (LAWICEL's manuals of CAN232 and CANUSB).
//!
//! A program sends [`Command`]s and the adapter sends [`Reply`]s. Both end with a carriage return; a refusal is a BELL.
//! Each side parses the other's bytes in pieces of any size. The adapter's side is `armwire_bridge::slcan::Adapter`.
//!
//! FD frames are those of the CANable 2 firmware, which python-can also supports. `Y` sets the data bit rate.
//!
//! | Frame | 11 bits | 29 bits | Length |
//! |---|---|---|---|
//! | classic | `t` | `T` | 0 to 8 |
//! | remote | `r` | `R` | 0 to 8 |
//! | FD | `d` | `D` | DLC, 0 to F |
//! | FD with bit rate switching | `b` | `B` | DLC, 0 to F |
//!
//! No line carries the ESI flag of an FD frame, or a classic DLC above 8.
//!
//! ```
//! use armwire_bridge::can::bus::{Frame, Id};
//! use armwire_bridge::slcan::{BitRate, Command, Replies, Reply};
//!
//! let frame = Frame::data_frame(Id::Standard(0x600), &[1, 2, 3]).unwrap();
//! let mut program = Vec::new();
//! for command in [
//!     Command::BitRate(BitRate::new(1_000_000).unwrap()),
//!     Command::Open,
//!     Command::Transmit(frame),
//! ] {
//!     command.encode(&mut program);
//! }
//! assert_eq!(program, b"S8\rO\rt6003010203\r");
//!
//! let mut replies = Replies::default();
//! let received: Vec<_> = b"\r\rz\r".iter().filter_map(|&byte| replies.push(byte)).collect();
//! assert_eq!(received, [Ok(Reply::Done), Ok(Reply::Done), Ok(Reply::Sent { is_extended: false })]);
//! ```
//!
//! The crate slcan 0.1.3 does not fit: it has the program's side only, owns its port, and ignores malformed lines.

mod line;
mod malformed;
#[cfg(test)]
mod tests;

use core::fmt;

use armwire::OutOfRange;

use crate::can::bus::{FdFlags, Frame, Id, fd_length};
use crate::can::{FD_LENGTHS, MAX_CLASSIC, MAX_FD};
use line::{Field, Line};
pub use malformed::{Cause, Malformed};

/// The selectable bit rates, in bits per second. The index is the digit of the `S` command.
pub const BIT_RATES: [u32; 9] = [
    10_000, 20_000, 50_000, 100_000, 125_000, 250_000, 500_000, 800_000, 1_000_000,
];

/// The selectable data bit rates, in bits per second. The digit of the `Y` command is the rate in Mbit/s.
pub const DATA_BIT_RATES: [u32; 4] = [1_000_000, 2_000_000, 4_000_000, 5_000_000];

/// The carriage return that ends every line.
const CR: u8 = b'\r';
/// Refusal, sent by an adapter in place of a line.
const BELL: u8 = 0x07;
/// Period of the time stamps, in milliseconds.
pub const MINUTE: u16 = 60_000;

/// One of [`BIT_RATES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct BitRate(u8);

impl BitRate {
    /// The highest bit rate.
    pub const MAX: Self = Self(BIT_RATES.len() as u8 - 1);

    /// Returns the setting for this bit rate, if it is one of [`BIT_RATES`].
    pub fn new(bits_per_second: u32) -> Option<Self> {
        let digit = BIT_RATES.iter().position(|&rate| rate == bits_per_second)?;
        Some(Self(digit as u8))
    }

    /// Returns the rate in bits per second.
    pub fn bits_per_second(self) -> u32 {
        BIT_RATES.get(usize::from(self.0)).copied().unwrap_or_default()
    }
}

/// One of [`DATA_BIT_RATES`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct DataBitRate(u8);

impl DataBitRate {
    /// Returns the setting for this bit rate, if it is one of [`DATA_BIT_RATES`].
    pub fn new(bits_per_second: u32) -> Option<Self> {
        let is_known = DATA_BIT_RATES.contains(&bits_per_second);
        is_known.then_some(Self((bits_per_second / 1_000_000) as u8))
    }

    /// Returns the rate in bits per second.
    pub fn bits_per_second(self) -> u32 {
        u32::from(self.0) * 1_000_000
    }
}

/// 2 Mbit/s, the default of the CANable 2 firmware.
impl Default for DataBitRate {
    fn default() -> Self {
        Self(2)
    }
}

/// A command of the program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
    /// Empty line. It terminates an incomplete command of an earlier program.
    Nothing,
    /// `S`: sets the bit rate. Allowed while the channel is closed.
    BitRate(BitRate),
    /// `Y`: sets the data bit rate. Allowed while the channel is closed.
    DataBitRate(DataBitRate),
    /// `O`: opens the channel. Requires a bit rate.
    Open,
    /// `L`: opens the channel listen-only. Requires a bit rate.
    Listen,
    /// `C`: closes the channel.
    Close,
    /// Transmits a frame. Allowed while the channel is open.
    Transmit(Frame),
    /// `F`: reads the [`Status`]. Allowed while the channel is open or listen-only.
    Status,
    /// `V`: reads the versions.
    Version,
    /// `N`: reads the serial number.
    SerialNumber,
    /// `Z`: switches time stamps on or off. Allowed while the channel is closed.
    TimeStamps(bool),
}

/// A reply of the adapter.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Reply {
    /// Empty line: success.
    Done,
    /// BELL: refused.
    Refused,
    /// `z`, or `Z` for a 29-bit identifier: the frame is queued.
    Sent {
        /// True if the identifier has 29 bits.
        is_extended: bool,
    },
    /// A frame from the bus.
    Frame {
        /// The frame.
        frame: Frame,
        /// Time stamp in milliseconds, modulo one minute, if time stamps are on.
        millis: Option<u16>,
    },
    /// `F`: status bits.
    Status(Status),
    /// `V`: two digits each.
    Version {
        /// Hardware version, as hexadecimal digits.
        hardware: u8,
        /// Software version, as hexadecimal digits.
        software: u8,
    },
    /// `N`: four characters.
    SerialNumber([u8; 4]),
}

/// Status bits of the `F` command, named in [`Status::NAMES`].
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Status(pub u8);

impl Status {
    /// Receive queue full: frames were lost.
    pub const RECEIVE_QUEUE_FULL: Self = Self(0x01);
    /// Transmit queue full: frames were refused.
    pub const TRANSMIT_QUEUE_FULL: Self = Self(0x02);
    /// Error warning limit reached.
    pub const ERROR_WARNING: Self = Self(0x04);
    /// Overrun: frames were lost in the controller.
    pub const OVERRUN: Self = Self(0x08);
    /// Error passive: the controller sends no active error flags.
    pub const ERROR_PASSIVE: Self = Self(0x20);
    /// Arbitration lost.
    pub const ARBITRATION_LOST: Self = Self(0x40);
    /// Bus error.
    pub const BUS_ERROR: Self = Self(0x80);

    /// Each bit with its name.
    pub const NAMES: [(Self, &str); 7] = [
        (Self::RECEIVE_QUEUE_FULL, "receive queue full"),
        (Self::TRANSMIT_QUEUE_FULL, "transmit queue full"),
        (Self::ERROR_WARNING, "error warning"),
        (Self::OVERRUN, "data overrun"),
        (Self::ERROR_PASSIVE, "error passive"),
        (Self::ARBITRATION_LOST, "arbitration lost"),
        (Self::BUS_ERROR, "bus error"),
    ];

    /// Returns the bits set in either.
    #[must_use]
    pub const fn and(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

/// Names of the set bits, or `in order`.
impl fmt::Display for Status {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut set = Self::NAMES.iter().filter(|(bit, _)| self.0 & bit.0 != 0);
        match set.next() {
            None => f.write_str("in order"),
            Some((_, first)) => {
                f.write_str(first)?;
                set.try_for_each(|(_, name)| write!(f, ", {name}"))
            }
        }
    }
}

/// Parser of a program's commands.
///
/// ```
/// use armwire_bridge::slcan::{Command, Commands};
///
/// let mut commands = Commands::default();
/// let mut read = b"t80011\rV\r".iter().filter_map(|&byte| commands.push(byte));
/// let error = read.next().unwrap().unwrap_err();
/// assert_eq!(error.to_string(), "'t': CAN identifier is 2048, must be 0..=2047");
/// assert_eq!(read.next(), Some(Ok(Command::Version)));
/// ```
#[derive(Clone, Debug, Default)]
pub struct Commands {
    line: Line,
}

impl Commands {
    /// Takes the next byte from the program. Returns a command or an error at the end of each line.
    pub fn push(&mut self, byte: u8) -> Option<Result<Command, Malformed>> {
        if byte != CR {
            self.line.push(byte);
            return None;
        }
        Some(self.line.take(Self::parse))
    }

    fn parse(field: &mut Field<'_>) -> Result<Command, Cause> {
        Ok(match field.command() {
            None => Command::Nothing,
            Some(b'S') => Command::BitRate(BitRate(field.digit("bit rate", 8)?)),
            Some(b'Y') => Command::DataBitRate(data_bit_rate(field)?),
            Some(b'O') => Command::Open,
            Some(b'L') => Command::Listen,
            Some(b'C') => Command::Close,
            Some(kind @ (b't' | b'd' | b'b' | b'T' | b'D' | b'B' | b'r' | b'R')) => {
                Command::Transmit(frame(kind, field)?)
            }
            Some(b'F') => Command::Status,
            Some(b'V') => Command::Version,
            Some(b'N') => Command::SerialNumber,
            Some(b'Z') => Command::TimeStamps(field.digit("time stamps", 1)? == 1),
            Some(_) => return Err(Cause::Unknown),
        })
    }
}

/// Parser of an adapter's replies.
///
/// ```
/// use armwire_bridge::slcan::{Replies, Reply};
///
/// let mut replies = Replies::default();
/// let read: Vec<_> = b"V1013\r\x07".iter().filter_map(|&byte| replies.push(byte)).collect();
/// assert_eq!(read, [Ok(Reply::Version { hardware: 0x10, software: 0x13 }), Ok(Reply::Refused)]);
/// ```
#[derive(Clone, Debug, Default)]
pub struct Replies {
    line: Line,
}

impl Replies {
    /// Takes the next byte from the adapter. Returns a reply or an error at the end of each line.
    pub fn push(&mut self, byte: u8) -> Option<Result<Reply, Malformed>> {
        match byte {
            CR => Some(self.line.take(Self::parse)),
            BELL => {
                // A BELL cuts off the incomplete line.
                self.line = Line::default();
                Some(Ok(Reply::Refused))
            }
            _ => {
                self.line.push(byte);
                None
            }
        }
    }

    fn parse(field: &mut Field<'_>) -> Result<Reply, Cause> {
        Ok(match field.command() {
            None => Reply::Done,
            Some(kind @ (b'z' | b'Z')) => Reply::Sent {
                is_extended: kind == b'Z',
            },
            Some(kind @ (b't' | b'd' | b'b' | b'T' | b'D' | b'B' | b'r' | b'R')) => Reply::Frame {
                frame: frame(kind, field)?,
                millis: if field.is_at_end() { None } else { Some(millis(field)?) },
            },
            Some(b'F') => Reply::Status(Status(field.byte()?)),
            Some(b'V') => Reply::Version {
                hardware: field.byte()?,
                software: field.byte()?,
            },
            Some(b'N') => Reply::SerialNumber(field.characters()?),
            Some(_) => return Err(Cause::Unknown),
        })
    }
}

/// Parses a frame after its first character, up to the time stamp.
fn frame(kind: u8, field: &mut Field<'_>) -> Result<Frame, Cause> {
    let id = if kind.is_ascii_uppercase() {
        match field.number(8)? {
            id @ ..=Id::MAX_EXTENDED => Id::Extended(id),
            id => return Err(Cause::Identifier(id)),
        }
    } else {
        let id = crate::can::Id::new(field.number(3)? as u16);
        Id::Standard(id.map_err(Cause::OutOfRange)?.get())
    };
    let flags = match kind.to_ascii_lowercase() {
        b'd' => Some(FdFlags::default()),
        b'b' => Some(FdFlags {
            bit_rate_switch: true,
            error_passive: false,
        }),
        _ => None,
    };
    let max = if flags.is_some() {
        FD_LENGTHS.len() - 1
    } else {
        MAX_CLASSIC
    };
    let dlc = field.digit("length of a frame", max as u8)?;
    if let b'r' | b'R' = kind {
        return Ok(Frame::remote_frame(id, dlc));
    }
    let mut data = [0; MAX_FD];
    for byte in data.iter_mut().take(fd_length(dlc)) {
        *byte = field.byte()?;
    }
    Ok(match flags {
        Some(flags) => Frame::fd(id, flags, dlc, &data),
        None => Frame::classic(id, false, dlc, &data),
    })
}

fn data_bit_rate(field: &mut Field<'_>) -> Result<DataBitRate, Cause> {
    let rate = field.digit("data bit rate", 0xF)?;
    DataBitRate::new(u32::from(rate) * 1_000_000).ok_or(Cause::DataBitRate(rate))
}

fn millis(field: &mut Field<'_>) -> Result<u16, Cause> {
    match field.number(4)? as u16 {
        got @ MINUTE.. => Err(Cause::OutOfRange(OutOfRange {
            what: "time stamp",
            unit: "ms",
            got,
            min: 0,
            max: MINUTE - 1,
        })),
        millis => Ok(millis),
    }
}

impl Command {
    /// Appends the encoded line.
    pub fn encode(&self, out: &mut impl Extend<u8>) {
        match self {
            Self::Nothing => {}
            Self::BitRate(BitRate(digit)) => out.extend([b'S', b'0' + digit]),
            Self::DataBitRate(DataBitRate(digit)) => out.extend([b'Y', b'0' + digit]),
            Self::Open => out.extend([b'O']),
            Self::Listen => out.extend([b'L']),
            Self::Close => out.extend([b'C']),
            Self::Transmit(frame) => encode_frame(frame, out),
            Self::Status => out.extend([b'F']),
            Self::Version => out.extend([b'V']),
            Self::SerialNumber => out.extend([b'N']),
            Self::TimeStamps(on) => out.extend([b'Z', b'0' + u8::from(*on)]),
        }
        out.extend([CR]);
    }
}

impl Reply {
    /// Appends the encoded line.
    pub fn encode(&self, out: &mut impl Extend<u8>) {
        match self {
            Self::Done => {}
            Self::Refused => {
                out.extend([BELL]);
                return;
            }
            Self::Sent { is_extended } => out.extend([if *is_extended { b'Z' } else { b'z' }]),
            Self::Frame { frame, millis } => {
                encode_frame(frame, out);
                if let Some(millis) = millis {
                    out.extend(hex((*millis).into(), 4));
                }
            }
            Self::Status(status) => {
                out.extend([b'F']);
                out.extend(hex(status.0.into(), 2));
            }
            Self::Version { hardware, software } => {
                out.extend([b'V']);
                out.extend(
                    [hardware, software]
                        .into_iter()
                        .flat_map(|&version| hex(version.into(), 2)),
                );
            }
            Self::SerialNumber(characters) => {
                out.extend([b'N']);
                out.extend(characters.iter().copied());
            }
        }
        out.extend([CR]);
    }
}

fn encode_frame(frame: &Frame, out: &mut impl Extend<u8>) {
    let (kind, dlc) = match frame.fd {
        Some(flags) => (if flags.bit_rate_switch { b'b' } else { b'd' }, frame.dlc),
        None => (if frame.remote { b'r' } else { b't' }, frame.dlc.min(MAX_CLASSIC as u8)),
    };
    let (kind, id) = match frame.id {
        Id::Standard(id) => (kind, hex(id.into(), 3)),
        Id::Extended(id) => (kind.to_ascii_uppercase(), hex(id, 8)),
    };
    out.extend([kind]);
    out.extend(id.chain(hex(dlc.into(), 1)));
    out.extend(frame.payload().iter().flat_map(|&byte| hex(byte.into(), 2)));
}

/// The low hexadecimal digits of `value`, the highest first.
fn hex(value: u32, digits: u32) -> impl Iterator<Item = u8> {
    (0..digits)
        .rev()
        .map(move |digit| match (value >> (4 * digit) & 0xF) as u8 {
            digit @ ..10 => b'0' + digit,
            letter => b'A' + letter - 10,
        })
}
