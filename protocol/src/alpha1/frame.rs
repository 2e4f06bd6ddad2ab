//! The bytes of an Alpha1 frame.
//!
//! ```text
//!   0     1    2 .. 2+n    2+n     3+n
//! +----+----+-----------+-------+------+
//! | H  | H' | DATA      | CHECK | ED   |
//! +----+----+-----------+-------+------+
//! ```
//!
//! `H'` is `H` with its nibbles swapped. CHECK is the low byte of the sum of DATA; some answers have none. The length
//! of DATA is not in the frame: it follows from the direction and the header by the table in `layout`. The terminator
//! ED is therefore verified, never searched for: DATA and CHECK may contain ED too.
//!
//! The servos' own frames, FA AF and FC CF, have the same layout. Some commands are answered by a single byte, the
//! servo's id plus AA, without a frame. It is decoded only when it is expected.
//!
//! The robot's Bluetooth frames have the header FB BF too, followed by their length instead of this protocol's 01:
//!
//! ```text
//!   0     1     2      3     4 .. n-1   n-1     n
//! +----+----+-------+-----+---------+-------+------+
//! | FB | BF | n ≥ 6 | CMD | params  | CHECK | ED   |
//! +----+----+-------+-----+---------+-------+------+
//! ```

use core::ops::RangeInclusive;
use core::slice;

use super::{Alpha1, MAX_TEXT, Outcome, ServoId};
use crate::BufferTooShort;
use crate::framing::{Framing, LONGEST_VOID, Reason, Scan, verify, write};

/// The longest frame, in bytes: a version or name of [`MAX_TEXT`] bytes. On USB HID such a frame takes five reports.
///
/// A decoder for the servo bus, or for a robot with short names and versions, needs only the 33 bytes of an action.
pub const MAX_FRAME: usize = MAX_TEXT + 5;

/// The terminator: the last byte of every frame. A servo's acknowledgement is a single byte without it.
pub const TAIL: u8 = 0xED;

/// The request for the servo states (row EF).
pub const READ_SERVO_STATES: [u8; 10] = [header::SERVO_STATES, 0xFE, 0, 0, 0, 0, 0, 0, 0, TAIL];

/// The request for the firmware's version (row F5).
pub const READ_FIRMWARE_VERSION: [u8; 10] = [header::FIRMWARE_VERSION, 0x5F, 1, 0, 0, 0, 0, 0, 1, TAIL];

/// The request that stops the running action (row F2).
pub const STOP: [u8; 10] = [header::STOP, 0x2F, 0, 0, 0, 0, 0, 0, 0, TAIL];

/// The values of the status in an answer.
const STATUS: &[u8] = &[Outcome::Success as u8, Outcome::Failure as u8];

/// The byte after FB BF, in both directions (row FB).
pub(super) const ACT: u8 = 0x01;

/// The range of a text's count byte, which includes itself.
const COUNT: RangeInclusive<usize> = 1..=MAX_TEXT + 1;

/// The range of a Bluetooth frame's length, which includes itself, one header byte and all bytes after it.
const BLUETOOTH: RangeInclusive<usize> = 6..=u8::MAX as usize;

/// The first bytes of the headers.
pub(super) mod header {
    pub(crate) const HARDWARE_VERSION: u8 = 0xF1;
    pub(crate) const SERVO_STATES: u8 = 0xEF;
    pub(crate) const STOP: u8 = 0xF2;
    pub(crate) const FIRMWARE_VERSION: u8 = 0xF5;
    pub(crate) const ACT: u8 = 0xFB;
    pub(crate) const OFFSET_TOOL: u8 = 0xF4;
    pub(crate) const USB_TYPE: u8 = 0xF9;
    pub(crate) const PLAY: u8 = 0xF3;
    pub(crate) const SERVO: u8 = 0xFA;
    pub(crate) const SERVO_VERSION: u8 = 0xFC;
}

/// The checksum of `data`: the low byte of its sum.
///
/// ```
/// assert_eq!(armwire::alpha1::checksum(b"\x06dance"), 0x01); // row F3
/// ```
pub fn checksum(data: &[u8]) -> u8 {
    data.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// The expectation of the next frame.
///
/// ```
/// use armwire::alpha1::{Alpha1, Expect, ServoAnswer, ServoId};
/// use armwire::framing::{Framing, Scan};
///
/// let line = [0xAB];
/// let answer = ServoAnswer::Acknowledgement(ServoId::new(1)?);
/// assert_eq!(Alpha1.scan(&line, Expect::Responses(Some(answer))), Scan::Frame(1));
/// assert!(matches!(Alpha1.scan(&line, Expect::Responses(None)), Scan::Noise(1, _)));
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Expect {
    /// Frames from the host.
    Requests,
    /// Frames from the robot or a servo, with the expected answer of a servo, if any.
    Responses(Option<ServoAnswer>),
}

impl Expect {
    /// The expected single-byte answer.
    const fn byte(self) -> Option<u8> {
        match self {
            Self::Responses(Some(ServoAnswer::Acknowledgement(servo))) => Some(acknowledgement(servo)),
            _ => None,
        }
    }
}

/// The expected answer of a servo. The frames do not identify it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum ServoAnswer {
    /// The single byte of this servo.
    Acknowledgement(ServoId),
    /// Its target and actual angle.
    Angles,
    /// Its new id.
    IdChanged,
    /// The confirmation of a set offset.
    OffsetSet,
    /// Its offset.
    Offset,
    /// Its version.
    Version,
}

/// The single byte that acknowledges a request to this servo.
pub(super) const fn acknowledgement(servo: ServoId) -> u8 {
    servo.get().wrapping_add(0xAA)
}

/// The bytes after a header.
enum Layout {
    /// This number of bytes of DATA, CHECK, ED.
    Data(usize),
    /// A count byte, which includes itself; the text; CHECK, ED.
    Counted,
    /// AA or EE, ED: no CHECK.
    Status,
}

/// The layout of each frame.
const fn layout(first: u8, expect: Expect) -> Option<Layout> {
    use header::*;
    Some(match (expect, first) {
        (_, SERVO | SERVO_VERSION) => Layout::Data(6),
        (Expect::Requests, HARDWARE_VERSION | SERVO_STATES | STOP | FIRMWARE_VERSION) => Layout::Data(6),
        (Expect::Requests, OFFSET_TOOL | USB_TYPE) => Layout::Data(6),
        (Expect::Requests, header::ACT) => Layout::Data(29),
        (Expect::Requests, PLAY) => Layout::Counted,
        (Expect::Responses(_), HARDWARE_VERSION) => Layout::Counted,
        (Expect::Responses(_), SERVO_STATES) => Layout::Data(4),
        (Expect::Responses(_), FIRMWARE_VERSION) => Layout::Data(11),
        (Expect::Responses(_), header::ACT) => Layout::Data(6),
        (Expect::Responses(_), STOP | OFFSET_TOOL | USB_TYPE | PLAY) => Layout::Status,
        _ => return None,
    })
}

/// A frame with valid header, length, checksum and terminator.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Frame<'a> {
    /// A frame with a header.
    Message {
        /// The first byte of the header, which names the row of the document.
        command: u8,
        /// DATA, including the count byte of a text. A Bluetooth frame has its length where row FB has 01.
        data: &'a [u8],
    },
    /// The single byte of a servo.
    Byte(u8),
}

/// Writes a frame whose data is in two parts.
pub(super) fn put(out: &mut [u8], expect: Expect, command: u8, data: [&[u8]; 2]) -> Result<usize, BufferTooShort> {
    let [start, end] = data;
    let check = !matches!(layout(command, expect), Some(Layout::Status));
    let check = check.then(|| checksum(start).wrapping_add(checksum(end)));
    let data = start.iter().chain(end).copied();
    let bytes = [command, command.rotate_left(4)].into_iter().chain(data);
    write(out, bytes.chain(check).chain([TAIL]))
}

/// The verdict on a window that starts with a header.
fn scan_frame(window: &[u8], layout: Layout) -> Scan {
    let &[first, _, third, ..] = window else {
        return Scan::Need(1);
    };
    let count = usize::from(third);
    if first == header::ACT && third != ACT {
        return scan_bluetooth(window, count);
    }
    match layout {
        Layout::Data(len) => verify(window, len + 4, 2, checksum, TAIL),
        Layout::Counted if COUNT.contains(&count) => verify(window, count + 4, 2, checksum, TAIL),
        Layout::Counted => {
            let (min, max) = COUNT.into_inner();
            let (min, max, got) = (min as u16, max as u16, third.into());
            Scan::Noise(1, Reason::Length { min, max, got })
        }
        Layout::Status => scan_status(window),
    }
}

/// The verdict on a Bluetooth frame, which has a length byte after FB BF.
fn scan_bluetooth(window: &[u8], len: usize) -> Scan {
    if !BLUETOOTH.contains(&len) {
        let (offset, expected, got) = (2, &[ACT], len as u8);
        return Scan::Noise(1, Reason::Byte { offset, expected, got });
    }
    verify(window, len + 1, 2, checksum, TAIL)
}

/// The verdict on an answer without a checksum. Its status must be one of two values, otherwise half of the frame would
/// be unchecked.
fn scan_status(window: &[u8]) -> Scan {
    match *window {
        [_, _, status, TAIL, ..] if STATUS.contains(&status) => Scan::Frame(4),
        [_, _, status, got, ..] if STATUS.contains(&status) => Scan::Noise(1, Reason::Tail { expected: TAIL, got }),
        [_, _, got, _, ..] => {
            let (offset, expected) = (2, STATUS);
            Scan::Noise(1, Reason::Byte { offset, expected, got })
        }
        _ => Scan::Need(4_usize.saturating_sub(window.len())),
    }
}

impl<'a> Frame<'a> {
    /// Decodes a frame. `bytes` must be a frame according to [`scan`](Framing::scan). For any other bytes the result is
    /// unspecified.
    pub fn parse(bytes: &'a [u8]) -> Option<Self> {
        match bytes {
            [byte] => Some(Self::Byte(*byte)),
            [first, second, ..] if *second != first.rotate_left(4) => None,
            [command, _, status, TAIL] => Some(Self::Message {
                command: *command,
                data: slice::from_ref(status),
            }),
            [command, _, data @ .., _, TAIL] => Some(Self::Message {
                command: *command,
                data,
            }),
            _ => None,
        }
    }
}

impl Framing for Alpha1 {
    const VOID: Option<usize> = Some(LONGEST_VOID);
    type Expect = Expect;

    fn scan(&self, window: &[u8], expect: Expect) -> Scan {
        let Some((&first, rest)) = window.split_first() else {
            return Scan::Need(1);
        };
        // The bytes of ten servos could begin a frame, for example an echoed request. They wait for the next byte or
        // for silence.
        if rest.first().is_none_or(|second| *second == first.rotate_left(4))
            && let Some(layout) = layout(first, expect)
        {
            return scan_frame(window, layout);
        }
        let byte = expect.byte();
        if Some(first) == byte {
            return Scan::Frame(1);
        }
        if first == 0 {
            return Scan::Padding(1 + rest.iter().take_while(|&&byte| byte == 0).count());
        }
        let starts = |&next: &u8| next == 0 || Some(next) == byte || layout(next, expect).is_some();
        let stray = rest.iter().position(starts).unwrap_or(rest.len());
        Scan::Noise(1 + stray, Reason::Stray)
    }

    fn scan_idle(&self, window: &[u8], expect: Expect) -> Scan {
        match (self.scan(window, expect), window) {
            (Scan::Need(_), &[byte]) if Some(byte) == expect.byte() => Scan::Frame(1),
            (Scan::Need(missing), _) => Scan::Noise(1, Reason::Truncated { missing }),
            (verdict, _) => verdict,
        }
    }

    fn terminator(&self, expect: Expect) -> Option<u8> {
        match expect.byte() {
            Some(_) => None,
            None => Some(TAIL),
        }
    }

    fn shortest(&self, expect: Expect) -> usize {
        match (expect, expect.byte()) {
            (_, Some(_)) => 1,
            (Expect::Requests, None) => 5,
            (Expect::Responses(_), None) => 4,
        }
    }

    fn requests(&self) -> Expect {
        Expect::Requests
    }

    fn unsolicited(&self) -> Expect {
        Expect::Responses(None)
    }
}
