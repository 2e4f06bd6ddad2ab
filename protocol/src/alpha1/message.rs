//! The messages of the Alpha1 document and of the servos' manual, and their encoding.

use super::correlation::{NO_ANGLE, command, version_command};
use super::frame::{ACT, acknowledgement, header, put};
use super::value::{
    Address, Angle, Interval, Led, MoveTime, Offset, OffsetTool, Outcome, SERVOS, ServoId, ServoStates, Text, UsbType,
};
use super::{Alpha1, Expect, Frame, Key, ServoAnswer};
use crate::error::{Cause, MessageId, ParseError, constant, sized};
use crate::framing::write;
use crate::messages::Messages;
use crate::{BufferTooShort, OutOfRange, alpha1};

/// The expectation for writing responses, which does not depend on a servo's answer.
const RESPONSES: Expect = Expect::Responses(None);

/// A message of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Request<'a> {
    /// Row F1: the robot's hardware version. Answered by [`Response::HardwareVersion`].
    ReadHardwareVersion,
    /// Row EF: reads the servo states. Answered by [`Response::ServoStates`].
    ReadServoStates,
    /// Row F2: stops the current action. Answered by [`Response::Stopped`].
    Stop,
    /// Row F5: the robot's firmware version. Answered by [`Response::FirmwareVersion`].
    ReadFirmwareVersion,
    /// Row FB: moves all servos. Answered by [`Response::Acted`].
    Act(Action),
    /// Row F4: connects or disconnects the servo offset tool. Answered by [`Response::OffsetTool`].
    SetOffsetTool(OffsetTool),
    /// Row F9: sets the robot's USB device type. Answered by [`Response::UsbType`].
    SetUsbType(UsbType),
    /// Row F3: plays the action of this name. Answered by [`Response::Playing`].
    Play(Text<'a>),
    /// Rows FA and FC: a request to one servo, or to all. Answered by [`Response::Servo`], unless it is to all.
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
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Action {
    /// Targets of servos 1 to 20. `None` is FF on the wire, which is not in the document: public programs for this
    /// robot send it as "no change", but on the servos' own bus it [releases](ServoRequest::Release) the motor. State a
    /// target for each servo that must hold a load. The document does not specify the value for servos that a robot
    /// does not have.
    pub angles: [Option<Angle>; SERVOS],
    /// Duration of the servos' move.
    pub time: MoveTime,
    /// Time from the end of this frame to the start of the next one that the robot accepts.
    pub interval: Interval,
}

/// A message of the host to a servo (servo manual).
///
/// Moves, releases and LED settings are answered by a single byte, [`ServoResponse::Acknowledged`], or not at all if
/// they are to all servos. All other requests are answered by a frame, and are never to all servos ([`ServoId`] has the
/// reason).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum ServoRequest {
    /// Moves a servo.
    Move {
        /// The servos.
        to: Address,
        /// The target.
        angle: Angle,
        /// The duration of the move.
        time: MoveTime,
        /// The completion time, which the manual also calls lock time.
        lock: Interval,
    },
    /// Switches the power of the motor off: **a load that it holds falls.** Sent as a move to FF, which is not in the
    /// manual.
    Release(Address),
    /// Switches the LED.
    SetLed {
        /// The servos.
        to: Address,
        /// The setting.
        led: Led,
    },
    /// Reads the target and the actual angle. **The servo switches its motor off to answer: a load that it holds
    /// falls.** Answered by [`ServoResponse::Angles`].
    ReadAngles(ServoId),
    /// Changes a servo's id. Answered by [`ServoResponse::IdChanged`].
    ChangeId {
        /// The old id.
        from: ServoId,
        /// The new id.
        to: ServoId,
    },
    /// Sets the zero offset. Answered by [`ServoResponse::OffsetSet`].
    SetOffset(ServoId, Offset),
    /// Reads the zero offset. Answered by [`ServoResponse::Offset`].
    ReadOffset(ServoId),
    /// Reads the version of the servo's firmware. Answered by [`ServoResponse::Version`].
    ReadVersion(ServoId),
}

/// A message of the robot or of a servo.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Response<'a> {
    /// Answers [`Request::ReadHardwareVersion`].
    HardwareVersion(Text<'a>),
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
    #[cfg_attr(fuzzing, arbitrary(skip))] // the frame alone does not identify the answer
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
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct FirmwareVersion {
    /// Success if the version is valid.
    pub outcome: Outcome,
    /// The version, year first; arbitrary bytes after a failure.
    pub text: [u8; 10],
}

/// A message of a servo (servo manual).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum ServoResponse {
    /// The single byte that answers [`ServoRequest::Move`], [`ServoRequest::Release`] and [`ServoRequest::SetLed`].
    Acknowledged(ServoId),
    /// Answers [`ServoRequest::ReadAngles`]. The motor is now off.
    Angles {
        /// The servo.
        servo: ServoId,
        /// Success if the angles are valid.
        outcome: Outcome,
        /// The target, in degrees.
        target: u16,
        /// The actual angle, in degrees.
        actual: u16,
    },
    /// Answers [`ServoRequest::ChangeId`].
    IdChanged {
        /// The servo, by its new id.
        servo: ServoId,
        /// The result of the change.
        outcome: Outcome,
        /// The old id.
        was: u8,
    },
    /// Answers [`ServoRequest::SetOffset`].
    OffsetSet {
        /// The servo.
        servo: ServoId,
        /// The result of the change.
        outcome: Outcome,
    },
    /// Answers [`ServoRequest::ReadOffset`].
    Offset {
        /// The servo.
        servo: ServoId,
        /// Success if the offset is valid.
        outcome: Outcome,
        /// The offset in thirds of a degree; [`Offset::new`] checks its range.
        thirds: i16,
    },
    /// Answers [`ServoRequest::ReadVersion`].
    Version {
        /// The servo.
        servo: ServoId,
        /// Success if the version is valid.
        outcome: Outcome,
        /// The version. The meaning of its bytes is not documented.
        version: [u8; 4],
    },
}

/// The text after its count byte, which includes itself.
fn text(data: &[u8]) -> Result<Text<'_>, Cause> {
    let [count, text @ ..] = data else {
        return Err(Cause::Length { expected: &[1], got: 0 });
    };
    let (got, len) = (u16::from(*count), u16::try_from(data.len()).unwrap_or(u16::MAX));
    if got != len {
        let error = OutOfRange::new("count", "", got, len, len);
        return Err(Cause::value(0, error));
    }
    Text::new(text).map_err(|error| Cause::value(1, error))
}

fn servo(offset: usize, id: u8) -> Result<ServoId, Cause> {
    ServoId::new(id).map_err(|error| Cause::value(offset, error))
}

fn address(id: u8) -> Result<Address, Cause> {
    Address::from_wire(id).map_err(|error| Cause::value(0, error))
}

fn outcome(offset: usize, status: u8) -> Result<Outcome, Cause> {
    Outcome::from_wire(status).ok_or(Cause::byte(
        offset,
        &[Outcome::Success as u8, Outcome::Failure as u8],
        status,
    ))
}

/// Data that consists of a status only.
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

    fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let [act, a, b, c, d, e, angles @ .., time, high, low] = data;
        constant(0, &[*act, *a, *b, *c, *d, *e], &[ACT, 0, 0, 0, 0, 0])?;
        Ok(Self {
            angles: angles.map(Angle::from_wire),
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

    /// Decodes the data of a frame FA AF.
    fn from_data(data: &[u8; 6]) -> Result<Self, Cause> {
        let [id, command, a, b, c, d] = *data;
        match command {
            command::MOVE => {
                let to = address(id)?;
                // Times that accompany FF have no meaning.
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
                let offset = Offset::new(i16::from_be_bytes([c, d])).map_err(|error| Cause::value(4, error))?;
                Ok(Self::SetOffset(servo(0, id)?, offset))
            }
            // The manual allows any values in the four remaining bytes.
            command::READ_OFFSET => servo(0, id).map(Self::ReadOffset),
            got => Err(Cause::byte(1, command::ALL, got)),
        }
    }

    /// Decodes the data of a frame FC CF.
    fn from_version_data(data: &[u8; 6]) -> Result<Self, Cause> {
        let [id, command, rest @ ..] = data;
        match *command {
            version_command::READ => {
                constant(2, rest, &[0; 4])?;
                servo(0, *id).map(Self::ReadVersion)
            }
            version_command::BOOT_LOADER => Err(alpha1::Cause::BootLoader.into()),
            got => Err(Cause::byte(1, &[version_command::READ], got)),
        }
    }
}

impl ServoResponse {
    /// Decodes the data of a frame FA AF as an answer of this kind.
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
            Some(ServoAnswer::Acknowledgement(_) | ServoAnswer::Version) | None => {
                Err(alpha1::Cause::Unexpected.into())
            }
        }
    }

    /// Decodes the data of a frame FC CF.
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
            Self::Acknowledged(servo) => return write(out, [acknowledgement(servo)].into_iter()),
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
        put(
            out,
            RESPONSES,
            command,
            [&[servo.get(), outcome as u8, a, b, c, d], &[]],
        )
    }
}

fn parse_request(command: u8, data: &[u8]) -> Result<Request<'_>, Cause> {
    match command {
        header::HARDWARE_VERSION => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::ReadHardwareVersion),
        header::SERVO_STATES => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::ReadServoStates),
        header::STOP => constant(0, sized(data, &[6])?, &[0; 6]).map(|()| Request::Stop),
        header::FIRMWARE_VERSION => {
            constant(0, sized(data, &[6])?, &[1, 0, 0, 0, 0, 0]).map(|()| Request::ReadFirmwareVersion)
        }
        header::ACT if data.first() != Some(&ACT) => Err(alpha1::Cause::Bluetooth.into()),
        header::ACT => Action::from_data(sized(data, &[Action::LEN])?).map(Request::Act),
        header::OFFSET_TOOL => {
            let [one, state, rest @ ..] = sized::<6>(data, &[6])?;
            constant(0, &[*one], &[1])?;
            constant(2, rest, &[0; 4])?;
            match *state {
                0 => Ok(Request::SetOffsetTool(OffsetTool::Disconnect)),
                1 => Ok(Request::SetOffsetTool(OffsetTool::Connect)),
                got => Err(Cause::byte(1, &[0, 1], got)),
            }
        }
        header::USB_TYPE => {
            let [usb, rest @ ..] = sized::<6>(data, &[6])?;
            constant(1, rest, &[0; 5])?;
            match *usb {
                1 => Ok(Request::SetUsbType(UsbType::Disk)),
                2 => Ok(Request::SetUsbType(UsbType::SerialPort)),
                3 => Ok(Request::SetUsbType(UsbType::Hid)),
                got => Err(Cause::byte(0, &[1, 2, 3], got)),
            }
        }
        header::PLAY => text(data).map(Request::Play),
        header::SERVO => ServoRequest::from_data(sized(data, &[6])?).map(Request::Servo),
        header::SERVO_VERSION => ServoRequest::from_version_data(sized(data, &[6])?).map(Request::Servo),
        _ => Err(Cause::Unknown),
    }
}

fn parse_response(command: u8, data: &[u8], answer: Option<ServoAnswer>) -> Result<Response<'_>, Cause> {
    match command {
        header::HARDWARE_VERSION => text(data).map(Response::HardwareVersion),
        header::SERVO_STATES => sized(data, &[4]).map(|states| Response::ServoStates(ServoStates(*states))),
        header::STOP => status(data).map(Response::Stopped),
        header::FIRMWARE_VERSION => {
            let [status, text @ ..] = *sized::<11>(data, &[11])?;
            let outcome = outcome(0, status)?;
            Ok(Response::FirmwareVersion(FirmwareVersion { outcome, text }))
        }
        header::ACT if data.first() != Some(&ACT) => Err(alpha1::Cause::Bluetooth.into()),
        header::ACT => {
            let [_, status, rest @ ..] = sized::<6>(data, &[6])?;
            constant(2, rest, &[0; 4])?;
            outcome(1, *status).map(Response::Acted)
        }
        header::OFFSET_TOOL => status(data).map(Response::OffsetTool),
        header::USB_TYPE => status(data).map(Response::UsbType),
        header::PLAY => status(data).map(Response::Playing),
        header::SERVO => ServoResponse::from_data(sized(data, &[6])?, answer).map(Response::Servo),
        header::SERVO_VERSION => ServoResponse::from_version_data(sized(data, &[6])?).map(Response::Servo),
        _ => Err(Cause::Unknown),
    }
}

/// The count byte of a text, which includes itself.
fn count(text: Text<'_>) -> u8 {
    (text.as_bytes().len() as u8).wrapping_add(1)
}

impl Messages for Alpha1 {
    type Request<'a> = Request<'a>;
    type Response<'a> = Response<'a>;
    type EncodeError = BufferTooShort;

    fn encode_request(&self, request: &Request<'_>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let mut encode = |command, data: &[u8]| put(out, Expect::Requests, command, [data, &[]]);
        match *request {
            Request::ReadHardwareVersion => encode(header::HARDWARE_VERSION, &[0; 6]),
            Request::ReadServoStates => encode(header::SERVO_STATES, &[0; 6]),
            Request::Stop => encode(header::STOP, &[0; 6]),
            Request::ReadFirmwareVersion => encode(header::FIRMWARE_VERSION, &[1, 0, 0, 0, 0, 0]),
            Request::Act(action) => encode(header::ACT, &action.data()),
            Request::SetOffsetTool(tool) => encode(header::OFFSET_TOOL, &[1, tool as u8, 0, 0, 0, 0]),
            Request::SetUsbType(usb) => encode(header::USB_TYPE, &[usb as u8, 0, 0, 0, 0, 0]),
            Request::Play(name) => put(out, Expect::Requests, header::PLAY, [&[count(name)], name.as_bytes()]),
            Request::Servo(request) => {
                let (command, data) = request.to_data();
                encode(command, &data)
            }
        }
    }

    fn encode_response(
        &self,
        response: &Response<'_>,
        _to: Option<Key>,
        out: &mut [u8],
    ) -> Result<usize, BufferTooShort> {
        let mut encode = |command, data: &[u8], text: &[u8]| put(out, RESPONSES, command, [data, text]);
        match *response {
            Response::HardwareVersion(version) => {
                encode(header::HARDWARE_VERSION, &[count(version)], version.as_bytes())
            }
            Response::ServoStates(states) => encode(header::SERVO_STATES, &states.0, &[]),
            Response::Stopped(outcome) => encode(header::STOP, &[outcome as u8], &[]),
            Response::FirmwareVersion(FirmwareVersion { outcome, text }) => {
                encode(header::FIRMWARE_VERSION, &[outcome as u8], &text)
            }
            Response::Acted(outcome) => encode(header::ACT, &[ACT, outcome as u8, 0, 0, 0, 0], &[]),
            Response::OffsetTool(outcome) => encode(header::OFFSET_TOOL, &[outcome as u8], &[]),
            Response::UsbType(outcome) => encode(header::USB_TYPE, &[outcome as u8], &[]),
            Response::Playing(outcome) => encode(header::PLAY, &[outcome as u8], &[]),
            Response::Servo(response) => response.encode(out),
        }
    }

    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Request<'a>, ParseError> {
        match Frame::parse(frame) {
            Some(Frame::Message { command, data }) => {
                parse_request(command, data).map_err(ParseError::of(MessageId::Command(command)))
            }
            Some(Frame::Byte(command)) => Err(ParseError::of(MessageId::Command(command))(
                alpha1::Cause::Unexpected.into(),
            )),
            None => Err(ParseError::NO_FRAME),
        }
    }

    fn parse_response<'a>(&self, frame: &'a [u8], expect: Expect) -> Result<Response<'a>, ParseError> {
        let answer = match expect {
            Expect::Responses(answer) => answer,
            Expect::Requests => None,
        };
        match (Frame::parse(frame), answer) {
            (Some(Frame::Message { command, data }), answer) => {
                parse_response(command, data, answer).map_err(ParseError::of(MessageId::Command(command)))
            }
            (Some(Frame::Byte(byte)), Some(ServoAnswer::Acknowledgement(servo))) if byte == acknowledgement(servo) => {
                Ok(Response::Servo(ServoResponse::Acknowledged(servo)))
            }
            (Some(Frame::Byte(command)), _) => Err(ParseError::of(MessageId::Command(command))(
                alpha1::Cause::Unexpected.into(),
            )),
            (None, _) => Err(ParseError::NO_FRAME),
        }
    }
}
