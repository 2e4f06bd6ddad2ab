//! The messages of the Alpha1 document and of the servos' manual, and the bytes they travel as.

use core::fmt;

use super::frame::{ACT, acknowledgement, header};
use super::value::{
    Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, Outcome, SERVOS, ServoId, ServoStates, Text, TextRef,
    UsbType,
};
use super::{Alpha1, Expect, Frame, MAX_FRAME, ServoAnswer};
use crate::error::write_either;
use crate::{BufferTooShort, Micros, OutOfRange, Protocol, Reply};

/// Commands to a servo, in frames FA AF (servo manual).
mod command {
    pub(super) const MOVE: u8 = 0x01;
    pub(super) const READ_ANGLES: u8 = 0x02;
    pub(super) const LED: u8 = 0x04;
    pub(super) const CHANGE_ID: u8 = 0xCD;
    pub(super) const SET_OFFSET: u8 = 0xD2;
    pub(super) const READ_OFFSET: u8 = 0xD4;
    pub(super) const ALL: &[u8] = &[MOVE, READ_ANGLES, LED, CHANGE_ID, SET_OFFSET, READ_OFFSET];
}

/// Commands to a servo, in frames FC CF.
mod version_command {
    pub(super) const READ: u8 = 0x01;
    pub(super) const BOOT_LOADER: u8 = 0x02;
}

/// Where FF stands in place of an angle (see [`Action::angles`] and [`ServoRequest::Release`]).
const NO_ANGLE: u8 = 0xFF;

/// What the reader of a response expects, as far as it matters to the writer: not which answer of a servo it is.
const RESPONSES: Expect = Expect::Responses(None);

/// The longest a servo thinks (servo manual).
const SERVO_TURNAROUND: Micros = Micros(400);

/// What the host says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Request {
    /// Row F1: the robot's hardware version. Answered by [`Response::HardwareVersion`].
    ReadHardwareVersion,
    /// Row EF: which servos run. Answered by [`Response::ServoStates`].
    ReadServoStates,
    /// Row F2: stops the action that is played. Answered by [`Response::Stopped`].
    Stop,
    /// Row F5: the robot's firmware version. Answered by [`Response::FirmwareVersion`].
    ReadFirmwareVersion,
    /// Row FB: moves all servos. Answered by [`Response::Acted`].
    Act(Action),
    /// Row F4: connects or disconnects the servo offset tool. Answered by [`Response::OffsetTool`].
    SetOffsetTool(OffsetTool),
    /// Row F9: what the robot is on USB from now on. Answered by [`Response::UsbType`].
    SetUsbType(UsbType),
    /// Row F3: plays the action of this name. Answered by [`Response::Playing`].
    Play(Text),
    /// Rows FA and FC: something to one servo, or to all. Answered by [`Response::Servo`], unless it is to all.
    Servo(ServoRequest),
}

/// One frame of an action (row FB).
///
/// ```
/// use core::time::Duration;
/// use armwire::alpha1::{Action, Angle, Interval, MoveTime};
///
/// let mut angles = [None; 20];
/// angles[..16].fill(Some(Angle::new(90)?));
/// let action = Action {
///     angles,
///     time: MoveTime::from_duration(Duration::from_millis(500))?,
///     interval: Interval::from_duration(Duration::from_millis(600))?,
/// };
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Action {
    /// Targets of servos 1 to 20. `None` leaves a servo as it is: it is FF on the wire, which is not in the document
    /// but is what the public programs for this robot send. What the document wants for servos that a robot does not
    /// have is not said.
    pub angles: [Option<Angle>; SERVOS],
    /// How long the servos take to get there.
    pub time: MoveTime,
    /// From the end of this frame to the start of the next one that the robot takes.
    pub interval: Interval,
}

/// What the host says to a servo (servo manual).
///
/// Moves, releases and lights are answered by a single byte, [`ServoResponse::Acknowledged`], or by nothing where all
/// servos are told. The rest is answered by a frame, and is never to all servos ([`ServoId`] says why).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ServoRequest {
    /// Moves.
    Move {
        /// Who.
        to: Address,
        /// Where to.
        angle: Angle,
        /// How long it takes to get there.
        time: MoveTime,
        /// The completion time, which the manual also calls lock time.
        lock: Interval,
    },
    /// Switches the power of the motor off: **what it holds up falls.** Sent as a move to FF, which is not in the
    /// manual.
    Release(Address),
    /// Switches the light.
    SetLed {
        /// Whose.
        to: Address,
        /// To what.
        led: Led,
    },
    /// Target and actual angle. **The servo switches its motor off to answer: what it holds up falls.** Answered by
    /// [`ServoResponse::Angles`].
    ReadAngles(ServoId),
    /// Gives a servo another id. Answered by [`ServoResponse::IdChanged`].
    ChangeId {
        /// The id it has.
        from: ServoId,
        /// The id it gets.
        to: ServoId,
    },
    /// Puts the zero off. Answered by [`ServoResponse::OffsetSet`].
    SetOffset(ServoId, Offset),
    /// How far the zero is put off. Answered by [`ServoResponse::Offset`].
    ReadOffset(ServoId),
    /// The version of the servo's firmware. Answered by [`ServoResponse::Version`].
    ReadVersion(ServoId),
}

/// What the robot or a servo says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Response {
    /// Answers [`Request::ReadHardwareVersion`].
    HardwareVersion(Text),
    /// Answers [`Request::ReadServoStates`].
    ServoStates(ServoStates),
    /// Answers [`Request::Stop`].
    Stopped(Outcome),
    /// Answers [`Request::ReadFirmwareVersion`].
    FirmwareVersion(FirmwareVersion),
    /// Answers [`Request::Act`].
    Acted(Outcome),
    /// Answers [`Request::SetOffsetTool`].
    OffsetTool(Outcome),
    /// Answers [`Request::SetUsbType`].
    UsbType(Outcome),
    /// Answers [`Request::Play`].
    Playing(Outcome),
    /// Answers [`Request::Servo`].
    Servo(ServoResponse),
}

/// A [`Response`] whose texts are borrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ResponseRef<'a> {
    /// [`Response::HardwareVersion`].
    HardwareVersion(TextRef<'a>),
    /// [`Response::ServoStates`].
    ServoStates(ServoStates),
    /// [`Response::Stopped`].
    Stopped(Outcome),
    /// [`Response::FirmwareVersion`].
    FirmwareVersion(Outcome, &'a [u8; 10]),
    /// [`Response::Acted`].
    Acted(Outcome),
    /// [`Response::OffsetTool`].
    OffsetTool(Outcome),
    /// [`Response::UsbType`].
    UsbType(Outcome),
    /// [`Response::Playing`].
    Playing(Outcome),
    /// [`Response::Servo`].
    Servo(ServoResponse),
}

/// The version of the robot's firmware (row F5).
///
/// ```
/// use armwire::alpha1::{FirmwareVersion, OLDEST_FIRMWARE, Outcome};
///
/// let version = FirmwareVersion { outcome: Outcome::Success, text: *b"2016010100" };
/// assert!(version.text >= OLDEST_FIRMWARE); // digits sort as numbers do
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FirmwareVersion {
    /// Whether the robot could tell.
    pub outcome: Outcome,
    /// The version, year first; any bytes if it could not.
    pub text: [u8; 10],
}

/// What a servo says (servo manual).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ServoResponse {
    /// The single byte that answers [`ServoRequest::Move`], [`ServoRequest::Release`] and [`ServoRequest::SetLed`].
    Acknowledged(ServoId),
    /// Answers [`ServoRequest::ReadAngles`]. The motor is off now.
    Angles {
        /// Who says it.
        servo: ServoId,
        /// Whether it could tell.
        outcome: Outcome,
        /// Where it was sent, in degrees.
        target: u16,
        /// Where it is, in degrees.
        actual: u16,
    },
    /// Answers [`ServoRequest::ChangeId`].
    IdChanged {
        /// Who says it: the id that it has now.
        servo: ServoId,
        /// Whether it could do it.
        outcome: Outcome,
        /// The id that it had.
        was: u8,
    },
    /// Answers [`ServoRequest::SetOffset`].
    OffsetSet {
        /// Who says it.
        servo: ServoId,
        /// Whether it could do it.
        outcome: Outcome,
    },
    /// Answers [`ServoRequest::ReadOffset`].
    Offset {
        /// Who says it.
        servo: ServoId,
        /// Whether it could tell.
        outcome: Outcome,
        /// The offset in thirds of a degree; [`Offset::new`] says whether it is in range.
        thirds: i16,
    },
    /// Answers [`ServoRequest::ReadVersion`].
    Version {
        /// Who says it.
        servo: ServoId,
        /// Whether it could tell.
        outcome: Outcome,
        /// The version. What its bytes mean is not documented.
        version: [u8; 4],
    },
}

/// A good frame that is no message.
///
/// ```
/// use armwire::Protocol;
/// use armwire::alpha1::{Alpha1, Cause, Frame};
///
/// let frame = Frame::Message { command: 0xF9, data: &[4, 0, 0, 0, 0, 0] };
/// let error = Alpha1::parse_request(frame).unwrap_err();
/// assert_eq!(error.cause, Cause::Byte { offset: 0, expected: &[1, 2, 3], got: 4 });
/// assert_eq!(error.to_string(), "command F9: data byte 0 is 04, must be 01 or 02 or 03");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ParseError {
    /// The first byte of the frame.
    pub command: u8,
    /// What is wrong with it.
    pub cause: Cause,
}

/// What is wrong with a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Cause {
    /// The document has no such command.
    Unknown,
    /// An answer of a servo, or the shape of one, where none is expected: what it answers cannot be told.
    Unexpected,
    /// A frame of the robot's Bluetooth protocol, which this is not.
    Bluetooth,
    /// A command that starts the boot loader of a servo, which this crate does not offer.
    BootLoader,
    /// The data has the wrong length.
    Length {
        /// The lengths it may have, in bytes.
        expected: &'static [usize],
        /// The length it has, in bytes.
        got: usize,
    },
    /// A byte that may have few values has another.
    Byte {
        /// Where it is, in bytes from the start of the data.
        offset: usize,
        /// What it may be.
        expected: &'static [u8],
        /// What it is.
        got: u8,
    },
    /// A value is out of its range.
    Value {
        /// Where it is, in bytes from the start of the data.
        offset: usize,
        /// What it is and may be.
        error: OutOfRange,
    },
    /// A servo's offset is out of its range.
    Offset(OutOfRange<i16>),
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "command {:02X}: ", self.command)?;
        match self.cause {
            Cause::Unknown => f.write_str("unknown"),
            Cause::Unexpected => f.write_str("an answer of a servo, but none is expected"),
            Cause::Bluetooth => f.write_str("a frame of the robot's Bluetooth protocol"),
            Cause::BootLoader => f.write_str("it would start a servo's boot loader, which is not offered"),
            Cause::Length { expected, got } => {
                write!(f, "{got} data bytes, expected ")?;
                write_either(f, expected, |f, length| write!(f, "{length}"))
            }
            Cause::Byte { offset, expected, got } => {
                write!(f, "data byte {offset} is {got:02X}, must be ")?;
                write_either(f, expected, |f, byte| write!(f, "{byte:02X}"))
            }
            Cause::Value { offset, error } => write!(f, "{error} (data byte {offset})"),
            Cause::Offset(error) => write!(f, "{error}"),
        }
    }
}

impl core::error::Error for ParseError {}

/// Data of a known length, or the error that says which it should have.
fn sized<'a, const N: usize>(data: &'a [u8], expected: &'static [usize]) -> Result<&'a [u8; N], Cause> {
    let got = data.len();
    data.try_into().map_err(|_| Cause::Length { expected, got })
}

/// Checks data that always is the same, `offset` bytes from the start of all data.
fn constant<const N: usize>(offset: usize, data: &[u8; N], expected: &'static [u8; N]) -> Result<(), Cause> {
    for (i, (got, expected)) in data.iter().zip(expected.chunks(1)).enumerate() {
        if expected != [*got] {
            return Err(Cause::Byte {
                offset: offset.saturating_add(i),
                expected,
                got: *got,
            });
        }
    }
    Ok(())
}

/// The text after its count, which counts itself.
fn text(data: &[u8]) -> Result<&[u8], Cause> {
    let [count, text @ ..] = data else {
        return Err(Cause::Length { expected: &[1], got: 0 });
    };
    let (got, len) = (u16::from(*count), u16::try_from(data.len()).unwrap_or(u16::MAX));
    if got != len {
        let error = OutOfRange {
            what: "count",
            unit: "",
            got,
            min: len,
            max: len,
        };
        return Err(Cause::Value { offset: 0, error });
    }
    let at = |error| Cause::Value { offset: 1, error };
    Text::check(text).map(|()| text).map_err(at)
}

fn servo(offset: usize, id: u8) -> Result<ServoId, Cause> {
    ServoId::new(id).map_err(|error| Cause::Value { offset, error })
}

fn address(id: u8) -> Result<Address, Cause> {
    Address::from_wire(id).map_err(|error| Cause::Value { offset: 0, error })
}

fn outcome(offset: usize, status: u8) -> Result<Outcome, Cause> {
    Outcome::from_wire(status).ok_or(Cause::Byte {
        offset,
        expected: &[Outcome::Success as u8, Outcome::Failure as u8],
        got: status,
    })
}

/// Data that is nothing but a status.
fn status(data: &[u8]) -> Result<Outcome, Cause> {
    let [status] = sized(data, &[1])?;
    outcome(0, *status)
}

impl Action {
    const LEN: usize = 29;

    fn data(&self) -> [u8; Self::LEN] {
        let angles = self.angles.iter().map(|angle| angle.map_or(NO_ANGLE, Angle::raw));
        let [high, low] = self.interval.units().to_be_bytes();
        let bytes = [ACT, 0, 0, 0, 0, 0].into_iter().chain(angles);
        let mut data = [0; Self::LEN];
        for (to, from) in data.iter_mut().zip(bytes.chain([self.time.units(), high, low])) {
            *to = from;
        }
        data
    }

    #[inline(always)]
    fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let [act, a, b, c, d, e, angles @ .., time, high, low] = data;
        constant(0, &[*act, *a, *b, *c, *d, *e], &[ACT, 0, 0, 0, 0, 0])?;
        // Not `map`, which takes 84 B of stack also where it is only asked whether a frame is such a request.
        let mut targets = [None; SERVOS];
        for (target, byte) in targets.iter_mut().zip(angles) {
            *target = Angle::from_wire(*byte);
        }
        Ok(Self {
            angles: targets,
            time: MoveTime::new(*time),
            interval: Interval::new(u16::from_be_bytes([*high, *low])),
        })
    }
}

impl ServoRequest {
    /// The header and the data.
    fn to_data(self) -> (u8, [u8; 6]) {
        match self {
            Self::Move { to, angle, time, lock } => {
                let [high, low] = lock.units().to_be_bytes();
                let data = [to.id(), command::MOVE, angle.raw(), time.units(), high, low];
                (header::SERVO, data)
            }
            Self::Release(to) => (header::SERVO, [to.id(), command::MOVE, NO_ANGLE, 0, 0, 0]),
            Self::SetLed { to, led } => (header::SERVO, [to.id(), command::LED, led.0, 0, 0, 0]),
            Self::ReadAngles(servo) => (header::SERVO, [servo.get(), command::READ_ANGLES, 0, 0, 0, 0]),
            Self::ChangeId { from, to } => (header::SERVO, [from.get(), command::CHANGE_ID, 0, to.get(), 0, 0]),
            Self::SetOffset(servo, offset) => {
                let [high, low] = offset.thirds().to_be_bytes();
                (header::SERVO, [servo.get(), command::SET_OFFSET, 0, 0, high, low])
            }
            Self::ReadOffset(servo) => (header::SERVO, [servo.get(), command::READ_OFFSET, 0, 0, 0, 0]),
            Self::ReadVersion(servo) => (header::SERVO_VERSION, [servo.get(), version_command::READ, 0, 0, 0, 0]),
        }
    }

    /// From the data of a frame FA AF.
    #[inline(always)]
    fn from_data(data: &[u8; 6]) -> Result<Self, Cause> {
        let [id, command, a, b, c, d] = *data;
        match command {
            command::MOVE => {
                let to = address(id)?;
                // Whatever times come with FF mean nothing.
                Ok(Angle::from_wire(a).map_or(Self::Release(to), |angle| Self::Move {
                    to,
                    angle,
                    time: MoveTime::new(b),
                    lock: Interval::new(u16::from_be_bytes([c, d])),
                }))
            }
            command::LED => {
                constant(3, &[b, c, d], &[0; 3])?;
                address(id).map(|to| Self::SetLed { to, led: Led(a) })
            }
            command::READ_ANGLES => {
                constant(2, &[a, b, c, d], &[0; 4])?;
                servo(0, id).map(Self::ReadAngles)
            }
            command::CHANGE_ID => {
                constant(2, &[a], &[0])?;
                constant(4, &[c, d], &[0; 2])?;
                let (from, to) = (servo(0, id)?, servo(3, b)?);
                Ok(Self::ChangeId { from, to })
            }
            command::SET_OFFSET => {
                constant(2, &[a, b], &[0; 2])?;
                let offset = Offset::new(i16::from_be_bytes([c, d])).map_err(Cause::Offset)?;
                Ok(Self::SetOffset(servo(0, id)?, offset))
            }
            // The manual allows anything in the four bytes that are left.
            command::READ_OFFSET => servo(0, id).map(Self::ReadOffset),
            got => Err(Cause::Byte {
                offset: 1,
                expected: command::ALL,
                got,
            }),
        }
    }

    /// From the data of a frame FC CF.
    fn from_version_data(data: &[u8; 6]) -> Result<Self, Cause> {
        let [id, command, rest @ ..] = data;
        match *command {
            version_command::READ => {
                constant(2, rest, &[0; 4])?;
                servo(0, *id).map(Self::ReadVersion)
            }
            version_command::BOOT_LOADER => Err(Cause::BootLoader),
            got => Err(Cause::Byte {
                offset: 1,
                expected: &[version_command::READ],
                got,
            }),
        }
    }

    /// The answer it gets; `None` if none.
    const fn answer(self) -> Option<ServoAnswer> {
        match self {
            Self::Move { to, .. } | Self::Release(to) | Self::SetLed { to, .. } => match to {
                Address::One(servo) => Some(ServoAnswer::Acknowledgement(servo)),
                Address::All => None,
            },
            Self::ReadAngles(_) => Some(ServoAnswer::Angles),
            Self::ChangeId { .. } => Some(ServoAnswer::IdChanged),
            Self::SetOffset(..) => Some(ServoAnswer::OffsetSet),
            Self::ReadOffset(_) => Some(ServoAnswer::Offset),
            Self::ReadVersion(_) => Some(ServoAnswer::Version),
        }
    }

    /// Whether a frame with this header comes from the servo that is asked. Not where a single byte is the answer.
    fn is_answered_by(self, command: u8, data: &[u8]) -> bool {
        let from = |servo: ServoId| data.first() == Some(&servo.get());
        match self {
            Self::Move { .. } | Self::Release(_) | Self::SetLed { .. } => false,
            Self::ReadAngles(servo) | Self::SetOffset(servo, _) | Self::ReadOffset(servo) => {
                command == header::SERVO && from(servo)
            }
            Self::ChangeId { from: old, to } => command == header::SERVO && (from(old) || from(to)),
            Self::ReadVersion(servo) => command == header::SERVO_VERSION && from(servo),
        }
    }
}

impl ServoResponse {
    /// From the data of a frame FA AF, as an answer of this kind.
    fn from_data(data: &[u8; 6], answer: Option<ServoAnswer>) -> Result<Self, Cause> {
        let [id, status, a, b, c, d] = *data;
        let (servo, outcome) = (servo(0, id)?, outcome(1, status)?);
        match answer {
            Some(ServoAnswer::Angles) => Ok(Self::Angles {
                servo,
                outcome,
                target: u16::from_be_bytes([a, b]),
                actual: u16::from_be_bytes([c, d]),
            }),
            Some(ServoAnswer::IdChanged) => Ok(Self::IdChanged { servo, outcome, was: b }),
            Some(ServoAnswer::OffsetSet) => Ok(Self::OffsetSet { servo, outcome }),
            Some(ServoAnswer::Offset) => Ok(Self::Offset {
                servo,
                outcome,
                thirds: i16::from_be_bytes([c, d]),
            }),
            Some(ServoAnswer::Acknowledgement(_) | ServoAnswer::Version) | None => Err(Cause::Unexpected),
        }
    }

    /// From the data of a frame FC CF.
    fn from_version_data(data: &[u8; 6]) -> Result<Self, Cause> {
        let [id, status, version @ ..] = *data;
        Ok(Self::Version {
            servo: servo(0, id)?,
            outcome: outcome(1, status)?,
            version,
        })
    }

    fn encode(self, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let (command, servo, outcome, [a, b, c, d]) = match self {
            Self::Acknowledged(servo) => return Frame::Byte(acknowledgement(servo)).put(RESPONSES, out),
            Self::Angles {
                servo,
                outcome,
                target,
                actual,
            } => {
                let ([a, b], [c, d]) = (target.to_be_bytes(), actual.to_be_bytes());
                (header::SERVO, servo, outcome, [a, b, c, d])
            }
            Self::IdChanged { servo, outcome, was } => (header::SERVO, servo, outcome, [0, was, 0, 0]),
            Self::OffsetSet { servo, outcome } => (header::SERVO, servo, outcome, [0; 4]),
            Self::Offset { servo, outcome, thirds } => {
                let [high, low] = thirds.to_be_bytes();
                (header::SERVO, servo, outcome, [0, 0, high, low])
            }
            Self::Version {
                servo,
                outcome,
                version,
            } => (header::SERVO_VERSION, servo, outcome, version),
        };
        encode(out, RESPONSES, command, &[servo.get(), outcome as u8, a, b, c, d])
    }

    /// Whether it is the answer to `request`.
    fn answers(self, request: ServoRequest) -> bool {
        match (request, self) {
            (
                ServoRequest::Move { to, .. } | ServoRequest::Release(to) | ServoRequest::SetLed { to, .. },
                Self::Acknowledged(servo),
            ) => to == Address::One(servo),
            (ServoRequest::ReadAngles(asked), Self::Angles { servo, .. })
            | (ServoRequest::SetOffset(asked, _), Self::OffsetSet { servo, .. })
            | (ServoRequest::ReadOffset(asked), Self::Offset { servo, .. })
            | (ServoRequest::ReadVersion(asked), Self::Version { servo, .. }) => asked == servo,
            (ServoRequest::ChangeId { from, to }, Self::IdChanged { servo, outcome, was }) => match outcome {
                Outcome::Success => (servo, was) == (to, from.get()),
                // What a servo that refuses says of ids is not documented.
                Outcome::Failure => servo == from || servo == to,
            },
            _ => false,
        }
    }
}

// Inlined, the optimiser makes no request where it is only asked whether a frame is one.
#[inline(always)]
fn parse_request(command: u8, data: &[u8]) -> Result<Request, Cause> {
    match command {
        header::HARDWARE_VERSION => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::ReadHardwareVersion),
        header::SERVO_STATES => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::ReadServoStates),
        header::STOP => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::Stop),
        header::FIRMWARE_VERSION => {
            constant(0, sized(data, &[6])?, &[1, 0, 0, 0, 0, 0]).map(|()| Request::ReadFirmwareVersion)
        }
        header::ACT if data.first() != Some(&ACT) => Err(Cause::Bluetooth),
        header::ACT => Action::from_data(sized(data, &[Action::LEN])?).map(Request::Act),
        header::OFFSET_TOOL => {
            let [one, state, rest @ ..] = sized::<6>(data, &[6])?;
            constant(0, &[*one], &[1])?;
            constant(2, rest, &[0; 4])?;
            match *state {
                0 => Ok(Request::SetOffsetTool(OffsetTool::Disconnect)),
                1 => Ok(Request::SetOffsetTool(OffsetTool::Connect)),
                got => Err(Cause::Byte {
                    offset: 1,
                    expected: &[0, 1],
                    got,
                }),
            }
        }
        header::USB_TYPE => {
            let [usb, rest @ ..] = sized::<6>(data, &[6])?;
            constant(1, rest, &[0; 5])?;
            match *usb {
                1 => Ok(Request::SetUsbType(UsbType::Disk)),
                2 => Ok(Request::SetUsbType(UsbType::SerialPort)),
                3 => Ok(Request::SetUsbType(UsbType::Hid)),
                got => Err(Cause::Byte {
                    offset: 0,
                    expected: &[1, 2, 3],
                    got,
                }),
            }
        }
        header::PLAY => Ok(Request::Play(Text::from_wire(text(data)?))),
        header::SERVO => ServoRequest::from_data(sized(data, &[6])?).map(Request::Servo),
        header::SERVO_VERSION => ServoRequest::from_version_data(sized(data, &[6])?).map(Request::Servo),
        _ => Err(Cause::Unknown),
    }
}

/// What a frame of the robot or a servo says.
fn parse_response(command: u8, data: &[u8], answer: Option<ServoAnswer>) -> Result<ResponseRef<'_>, ParseError> {
    let wrong = |cause| ParseError { command, cause };
    let only_status = || status(data).map_err(wrong);
    match command {
        header::HARDWARE_VERSION => {
            let text = text(data).map_err(wrong)?;
            Ok(ResponseRef::HardwareVersion(TextRef::from_wire(text)))
        }
        header::SERVO_STATES => {
            let states = sized(data, &[4]).map_err(wrong)?;
            Ok(ResponseRef::ServoStates(ServoStates(*states)))
        }
        header::STOP => Ok(ResponseRef::Stopped(only_status()?)),
        header::FIRMWARE_VERSION => {
            let [status, text @ ..] = sized::<11>(data, &[11]).map_err(wrong)?;
            Ok(ResponseRef::FirmwareVersion(outcome(0, *status).map_err(wrong)?, text))
        }
        header::ACT if data.first() != Some(&ACT) => Err(wrong(Cause::Bluetooth)),
        header::ACT => {
            let [_, status, rest @ ..] = sized::<6>(data, &[6]).map_err(wrong)?;
            constant(2, rest, &[0; 4]).map_err(wrong)?;
            Ok(ResponseRef::Acted(outcome(1, *status).map_err(wrong)?))
        }
        header::OFFSET_TOOL => Ok(ResponseRef::OffsetTool(only_status()?)),
        header::USB_TYPE => Ok(ResponseRef::UsbType(only_status()?)),
        header::PLAY => Ok(ResponseRef::Playing(only_status()?)),
        header::SERVO => {
            let data = sized(data, &[6]).map_err(wrong)?;
            Ok(ResponseRef::Servo(
                ServoResponse::from_data(data, answer).map_err(wrong)?,
            ))
        }
        header::SERVO_VERSION => {
            let data = sized(data, &[6]).map_err(wrong)?;
            Ok(ResponseRef::Servo(
                ServoResponse::from_version_data(data).map_err(wrong)?,
            ))
        }
        _ => Err(wrong(Cause::Unknown)),
    }
}

/// Writes a frame with a header.
fn encode(out: &mut [u8], expect: Expect, command: u8, data: &[u8]) -> Result<usize, BufferTooShort> {
    Frame::Message { command, data }.put(expect, out)
}

impl Protocol for Alpha1 {
    const REQUESTS: Expect = Expect::Requests;
    const IDENTIFIED: bool = false;
    type Request = Request;
    type Response = Response;
    type ResponseRef<'a> = ResponseRef<'a>;
    type Error = ParseError;

    fn encode_request(request: &Request, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let mut encode = |command, data: &[u8]| encode(out, Expect::Requests, command, data);
        match request {
            Request::ReadHardwareVersion => encode(header::HARDWARE_VERSION, &[0; 6]),
            Request::ReadServoStates => encode(header::SERVO_STATES, &[0; 6]),
            Request::Stop => encode(header::STOP, &[0; 6]),
            Request::ReadFirmwareVersion => encode(header::FIRMWARE_VERSION, &[1, 0, 0, 0, 0, 0]),
            Request::Act(action) => encode(header::ACT, &action.data()),
            Request::SetOffsetTool(tool) => encode(header::OFFSET_TOOL, &[1, *tool as u8, 0, 0, 0, 0]),
            Request::SetUsbType(usb) => encode(header::USB_TYPE, &[*usb as u8, 0, 0, 0, 0, 0]),
            Request::Play(name) => encode(header::PLAY, name.as_wire()),
            Request::Servo(request) => {
                let (command, data) = request.to_data();
                encode(command, &data)
            }
        }
    }

    fn encode_response(response: &Response, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let mut encode = |command, data: &[u8]| encode(out, RESPONSES, command, data);
        match response {
            Response::HardwareVersion(version) => encode(header::HARDWARE_VERSION, version.as_wire()),
            Response::ServoStates(states) => encode(header::SERVO_STATES, &states.0),
            Response::Stopped(outcome) => encode(header::STOP, &[*outcome as u8]),
            Response::FirmwareVersion(FirmwareVersion { outcome, text }) => {
                let [a, b, c, d, e, f, g, h, i, j] = *text;
                encode(
                    header::FIRMWARE_VERSION,
                    &[*outcome as u8, a, b, c, d, e, f, g, h, i, j],
                )
            }
            Response::Acted(outcome) => encode(header::ACT, &[ACT, *outcome as u8, 0, 0, 0, 0]),
            Response::OffsetTool(outcome) => encode(header::OFFSET_TOOL, &[*outcome as u8]),
            Response::UsbType(outcome) => encode(header::USB_TYPE, &[*outcome as u8]),
            Response::Playing(outcome) => encode(header::PLAY, &[*outcome as u8]),
            Response::Servo(response) => response.encode(out),
        }
    }

    fn parse_request(frame: Frame<'_>) -> Result<Request, ParseError> {
        match frame {
            Frame::Message { command, data } => {
                parse_request(command, data).map_err(|cause| ParseError { command, cause })
            }
            Frame::Byte(command) => Err(ParseError {
                command,
                cause: Cause::Unexpected,
            }),
        }
    }

    fn is_request(frame: Frame<'_>) -> bool {
        match frame {
            Frame::Message {
                command: header::PLAY,
                data,
            } => text(data).is_ok(),
            Frame::Message { command, data } => parse_request(command, data).is_ok(),
            Frame::Byte(_) => false,
        }
    }

    fn parse_response_ref<'a>(frame: Self::Frame<'a>, expect: Expect) -> Result<Self::ResponseRef<'a>, ParseError> {
        let answer = match expect {
            Expect::Responses(answer) => answer,
            Expect::Requests => None,
        };
        match (frame, answer) {
            (Frame::Message { command, data }, answer) => parse_response(command, data, answer),
            (Frame::Byte(byte), Some(ServoAnswer::Acknowledgement(servo))) if byte == acknowledgement(servo) => {
                Ok(ResponseRef::Servo(ServoResponse::Acknowledged(servo)))
            }
            (Frame::Byte(command), _) => Err(ParseError {
                command,
                cause: Cause::Unexpected,
            }),
        }
    }

    // Inlined, it would add to the stack of all that its caller calls besides.
    #[inline(never)]
    fn to_response(response: &ResponseRef<'_>) -> Response {
        match response {
            ResponseRef::HardwareVersion(text) => Response::HardwareVersion(Text::from_wire(text.as_bytes())),
            ResponseRef::FirmwareVersion(outcome, text) => {
                // As a whole a Cortex-M0 calls `memcpy` for it, which takes 88 B of stack.
                let [a, b, c, d, e, f, g, h, i, j] = **text;
                let (outcome, text) = (*outcome, [a, b, c, d, e, f, g, h, i, j]);
                Response::FirmwareVersion(FirmwareVersion { outcome, text })
            }
            ResponseRef::ServoStates(states) => Response::ServoStates(*states),
            ResponseRef::Stopped(outcome) => Response::Stopped(*outcome),
            ResponseRef::Acted(outcome) => Response::Acted(*outcome),
            ResponseRef::OffsetTool(outcome) => Response::OffsetTool(*outcome),
            ResponseRef::UsbType(outcome) => Response::UsbType(*outcome),
            ResponseRef::Playing(outcome) => Response::Playing(*outcome),
            ResponseRef::Servo(response) => Response::Servo(*response),
        }
    }

    fn response_ref(response: &Response) -> ResponseRef<'_> {
        match response {
            Response::HardwareVersion(text) => ResponseRef::HardwareVersion(text.borrowed()),
            Response::FirmwareVersion(version) => ResponseRef::FirmwareVersion(version.outcome, &version.text),
            Response::ServoStates(states) => ResponseRef::ServoStates(*states),
            Response::Stopped(outcome) => ResponseRef::Stopped(*outcome),
            Response::Acted(outcome) => ResponseRef::Acted(*outcome),
            Response::OffsetTool(outcome) => ResponseRef::OffsetTool(*outcome),
            Response::UsbType(outcome) => ResponseRef::UsbType(*outcome),
            Response::Playing(outcome) => ResponseRef::Playing(*outcome),
            Response::Servo(response) => ResponseRef::Servo(*response),
        }
    }

    fn expect(request: Option<&Request>) -> Expect {
        match request {
            Some(Request::Servo(request)) => Expect::Responses(request.answer()),
            _ => Expect::Responses(None),
        }
    }

    fn reply(request: &Request) -> Option<Reply> {
        // The document gives no times. Reads take what the robot has at hand; the others wait for its SD card, USB or
        // Bluetooth.
        let (quick, slow) = (Micros::from_millis(100), Micros::from_millis(1_000));
        let (len, turnaround) = match request {
            Request::ReadHardwareVersion => (MAX_FRAME, quick),
            Request::ReadServoStates => (8, quick),
            Request::Stop => (4, quick),
            Request::ReadFirmwareVersion => (15, quick),
            Request::Act(_) => (10, quick),
            Request::SetOffsetTool(_) | Request::SetUsbType(_) | Request::Play(_) => (4, slow),
            Request::Servo(request) => match request.answer()? {
                ServoAnswer::Acknowledgement(_) => (1, SERVO_TURNAROUND),
                _ => (10, SERVO_TURNAROUND),
            },
        };
        Some(Reply { len, turnaround })
    }

    fn answers(request: &Request, response: &ResponseRef<'_>) -> bool {
        match (request, response) {
            (Request::ReadHardwareVersion, ResponseRef::HardwareVersion(_))
            | (Request::ReadServoStates, ResponseRef::ServoStates(_))
            | (Request::Stop, ResponseRef::Stopped(_))
            | (Request::ReadFirmwareVersion, ResponseRef::FirmwareVersion(..))
            | (Request::Act(_), ResponseRef::Acted(_))
            | (Request::SetOffsetTool(_), ResponseRef::OffsetTool(_))
            | (Request::SetUsbType(_), ResponseRef::UsbType(_))
            | (Request::Play(_), ResponseRef::Playing(_)) => true,
            (Request::Servo(request), ResponseRef::Servo(response)) => response.answers(*request),
            _ => false,
        }
    }

    fn is_response_to(request: &Request, frame: Frame<'_>) -> bool {
        let Frame::Message { command, data } = frame else {
            return false;
        };
        match request {
            Request::ReadHardwareVersion => command == header::HARDWARE_VERSION,
            Request::ReadServoStates => command == header::SERVO_STATES,
            Request::Stop => command == header::STOP,
            Request::ReadFirmwareVersion => command == header::FIRMWARE_VERSION,
            // A frame of the robot's Bluetooth protocol has the same header.
            Request::Act(_) => command == header::ACT && data.first() == Some(&ACT),
            Request::SetOffsetTool(_) => command == header::OFFSET_TOOL,
            Request::SetUsbType(_) => command == header::USB_TYPE,
            Request::Play(_) => command == header::PLAY,
            Request::Servo(request) => request.is_answered_by(command, data),
        }
    }

    fn repeatable(request: &Request) -> bool {
        // Reading a servo's angles is not among them: it switches the motor off.
        matches!(
            request,
            Request::ReadHardwareVersion
                | Request::ReadServoStates
                | Request::ReadFirmwareVersion
                | Request::Servo(ServoRequest::ReadOffset(_) | ServoRequest::ReadVersion(_))
        )
    }
}
