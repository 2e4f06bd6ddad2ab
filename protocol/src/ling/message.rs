//! The messages of the Ling document, section 2, and their encoding.

use super::force_feedback::{ControlMode, ForceFeedback, ModeReply, ModeState};
use super::frame::{ERROR, NO_VALUE, put_words, words};
use super::value::{
    JOINTS, MotionStatus, Opening, PerServo, Position, SelfCheck, SerialNumber, Speed, Stroke, TemperatureLimit,
    Version,
};
use super::{Frame, Key, Ling, SELF_CHECK};
use crate::error::{Cause, MessageId, ParseError, sized};
use crate::messages::Messages;
use crate::{BufferTooShort, OutOfRange};

/// Commands (section 1.1).
mod command {
    pub(super) const INFO: u8 = 0x01;
    pub(super) const ZERO: u8 = 0x03;
    pub(super) const STROKE: u8 = 0x04;
    pub(super) const TORQUE: u8 = 0x05;
    pub(super) const JOINTS: u8 = 0x06;
    pub(super) const SELF_CHECK: u8 = 0xFE;
}

/// Functions of [`command::JOINTS`] (section 2.5), and the mode of [`command::TORQUE`]; [`command::STROKE`] has its own.
mod function {
    pub(super) const STATE: u8 = 0x00;
    pub(super) const TEMPERATURE: u8 = 0x01;
    pub(super) const VELOCITY: u8 = 0x02;
    pub(super) const MOVE: u8 = 0x03;
    pub(super) const READ_STROKE: u8 = 0x0E;
    pub(super) const MODE: u8 = 0x01;
    pub(super) const FORCE_FEEDBACK: u8 = 0x20;
    pub(super) const READ_MODE: u8 = 0x24;
}

/// A message of the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Request {
    /// Serial number and versions (section 2.1). Answered by [`Response::Info`].
    ReadInfo,
    /// Makes the present pose the zero position, and switches the torque off (section 2.2). Not answered.
    SetZero,
    /// Sets the gripper type (section 2.3). Not answered.
    SetStroke(Stroke),
    /// Reads the configured gripper type (section 2.3). Answered by [`Response::Stroke`].
    ReadStroke,
    /// Switches the torque (section 2.4). Not answered.
    SetTorque(Torque),
    /// Joint positions, gripper and motion status (section 2.5). Answered by [`Response::Joints`].
    ReadJoints,
    /// Servo temperatures (section 2.5). Answered by [`Response::Temperatures`].
    ReadTemperatures,
    /// Sets the temperature limit of the arm's overheat protection (section 2.5). Not answered.
    SetTemperatureLimit(TemperatureLimit),
    /// Servo velocities (section 2.5). Answered by [`Response::Velocities`].
    ReadVelocities,
    /// Moves the joints and the gripper (section 2.5). Not answered.
    Move(Move),
    /// Runs a self-check of every servo (section 2.6). Answered by [`Response::SelfCheck`].
    SelfCheck,
    /// Sets the control mode of a force-feedback leader, which may switch its torque. Answered by
    /// [`Response::ModeReply`], before the mode is applied: see [`ModeChange`](super::ModeChange).
    SetMode(ControlMode),
    /// Reads the applied mode and the currents of a force-feedback leader. Answered by [`Response::Mode`].
    ReadMode,
    /// Requests the force feedback of a force-feedback leader, or its end. With it the motors push the joints. Answered
    /// by [`Response::ForceFeedback`].
    SetForceFeedback(bool),
    /// Reads the state of the force feedback. Answered by [`Response::ForceFeedback`].
    ReadForceFeedback,
}

/// The torque of the servos, which holds their positions.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum Torque {
    /// The arm can be moved by hand.
    Off,
    /// The arm holds and moves.
    On,
}

/// Targets and speeds (section 2.5).
///
/// ```
/// use armwire::ling::{GripperSpeed, Move, Opening, Position, Speed};
///
/// let home = Move {
///     joints: [(Position::CENTRE, Speed::new(1000)?); 6],
///     gripper: (Opening::from_fraction(0.5)?, GripperSpeed(1000)),
/// };
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Move {
    /// Target and speed of joints 1 to 6.
    pub joints: [(Position, Speed); JOINTS],
    /// Target and speed of the gripper.
    pub gripper: (Opening, GripperSpeed),
}

/// The speed of the gripper, in ticks per second.
///
/// The document's maximum of 5000 applies to joints: the vendor's software sends 5500 here.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct GripperSpeed(pub u16);

impl GripperSpeed {
    /// The speed to a goal that may be a whole stroke away, as in a stop, in teleoperation and at the start of a replay. It
    /// is less than a fifth of the vendor's.
    pub const DEFAULT: Self = Self(1000);
}

/// A message of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Response {
    /// Answers [`Request::ReadInfo`].
    Info(Info),
    /// Answers [`Request::ReadStroke`].
    Stroke(Stroke),
    /// Answers [`Request::ReadJoints`].
    Joints(JointState),
    /// Answers [`Request::ReadTemperatures`], in °C.
    Temperatures(PerServo<u8>),
    /// Answers [`Request::ReadVelocities`], in ticks per second, unsigned.
    Velocities(PerServo<u16>),
    /// Answers [`Request::SelfCheck`].
    SelfCheck(SelfCheck),
    /// Answers [`Request::SetMode`].
    ModeReply(ModeReply),
    /// Answers [`Request::ReadMode`].
    Mode(ModeState),
    /// Answers [`Request::SetForceFeedback`] and [`Request::ReadForceFeedback`].
    ForceFeedback(ForceFeedback),
}

/// The arm's identity (section 2.1).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Info {
    /// Serial number.
    pub serial: SerialNumber,
    /// Hardware version.
    pub hardware: Version,
    /// Firmware version.
    pub firmware: Version,
}

/// The arm's position, in raw counts as sent (section 2.5).
///
/// An arm may send values outside the range of requests: the document's example has a gripper value of 2051. The raw
/// counts are therefore kept, and converted to range-checked values on demand.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus};
///
/// let state = JointState {
///     joints: [2050, 2043, 2043, 2050, 2042, 2049],
///     gripper: 2051,
///     status: MotionStatus::Idle,
/// };
/// assert_eq!(state.positions()?[0].ticks(), 2050);
/// assert!(state.opening().is_err());
/// # Ok::<(), armwire::OutOfRange<f32>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct JointState {
    /// Positions of joints 1 to 6, in ticks.
    pub joints: [u16; JOINTS],
    /// Gripper opening, in thousandths of the stroke.
    pub gripper: u16,
    /// The motion status.
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut arbitrary::Unstructured<'_>| u.arbitrary::<u8>().map(u8::into)))]
    pub status: MotionStatus,
}

impl JointState {
    const LEN: usize = 15;

    /// The joints in a frame of the arm, as [`parse_response`](Messages::parse_response) decodes them. `None` for another
    /// frame. A program that only needs this message does without the code of all others.
    ///
    /// ```
    /// use armwire::ling::{JointState, READ_JOINTS};
    ///
    /// let frame = [0xAA, 6, 0, 15, 2, 8, 251, 7, 251, 7, 2, 8, 250, 7, 1, 8, 3, 8, 0, 0xA9, 0xFF];
    /// assert_eq!(JointState::of_frame(&frame).unwrap().joints, [2050, 2043, 2043, 2050, 2042, 2049]);
    /// assert_eq!(JointState::of_frame(&READ_JOINTS), None);
    /// ```
    pub fn of_frame(frame: &[u8]) -> Option<Self> {
        match Frame::parse(frame)? {
            Frame {
                command: command::JOINTS,
                function: function::STATE,
                data,
            } => Self::from_data(data).ok(),
            _ => None,
        }
    }

    /// The joints in the data of an answer, whatever follows them.
    fn from_data(data: &[u8]) -> Result<Self, Cause> {
        let documented = data.get(..Self::LEN).unwrap_or(data);
        let [joints @ .., low, high, status] = sized::<{ Self::LEN }>(documented, &[Self::LEN])?;
        Ok(Self {
            joints: words(joints),
            gripper: u16::from_le_bytes([*low, *high]),
            status: MotionStatus::of_answer(*status, data.len() as u8),
        })
    }

    /// The joint positions.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for an answer of [another robot](super::Foreign), and for the first joint over 4095 ticks.
    pub fn positions(&self) -> Result<[Position; JOINTS], OutOfRange> {
        self.check_own()?;
        let mut positions = [Position::CENTRE; JOINTS];
        for (position, ticks) in positions.iter_mut().zip(self.joints) {
            *position = Position::new(ticks)?;
        }
        Ok(positions)
    }

    /// The gripper opening.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for an answer of [another robot](super::Foreign), and over 1000.
    pub const fn opening(&self) -> Result<Opening, OutOfRange> {
        match self.check_own() {
            Ok(()) => Opening::new(self.gripper),
            Err(error) => Err(error),
        }
    }

    /// Checks that the answer is an Alicia-D's.
    const fn check_own(&self) -> Result<(), OutOfRange> {
        match self.status {
            MotionStatus::Foreign(foreign) => Err(foreign.error()),
            _ => Ok(()),
        }
    }
}

/// Checks the data of a request without a value.
fn check_no_value(data: &[u8]) -> Result<(), Cause> {
    match *sized(data, &[1])? {
        [NO_VALUE] => Ok(()),
        [got] => Err(Cause::byte(0, &[NO_VALUE], got)),
    }
}

/// Writes a frame.
fn encode(out: &mut [u8], command: u8, function: u8, data: &[u8]) -> Result<usize, BufferTooShort> {
    let frame = Frame {
        command,
        function,
        data,
    };
    frame.put(out)
}

impl Move {
    const LEN: usize = (JOINTS + 1) * 4;

    fn to_data(self) -> [u8; Self::LEN] {
        let mut data = [0; Self::LEN];
        let joints = self
            .joints
            .map(|(position, speed)| [position.ticks(), speed.ticks_per_second()]);
        let (opening, speed) = self.gripper;
        let axes = joints.into_iter().chain([[opening.per_mille(), speed.0]]);
        for (bytes, axis) in data.chunks_exact_mut(4).zip(axes) {
            put_words(bytes, &axis);
        }
        data
    }

    fn from_data(data: &[u8; Self::LEN]) -> Result<Self, Cause> {
        let at = |offset| move |error: OutOfRange| Cause::value(offset, error);
        let mut joints = [(Position::CENTRE, Speed::MAX); JOINTS];
        for (i, (joint, bytes)) in joints.iter_mut().zip(data.as_chunks::<4>().0).enumerate() {
            let [position, speed] = words(bytes);
            *joint = (
                Position::new(position).map_err(at(4 * i))?,
                Speed::new(speed).map_err(at(4 * i + 2))?,
            );
        }
        let [.., a, b, c, d] = *data;
        let [opening, speed] = words(&[a, b, c, d]);
        Ok(Self {
            joints,
            gripper: (Opening::new(opening).map_err(at(4 * JOINTS))?, GripperSpeed(speed)),
        })
    }
}

fn parse_request(frame: Frame<'_>) -> Result<Request, Cause> {
    match (frame.command, frame.function) {
        (command::INFO, 0) => check_no_value(frame.data).map(|()| Request::ReadInfo),
        (command::ZERO, 0) => check_no_value(frame.data).map(|()| Request::SetZero),
        (command::STROKE, function::READ_STROKE) => check_no_value(frame.data).map(|()| Request::ReadStroke),
        (command::STROKE, code) => {
            let stroke = Stroke::from_code(code).map_err(|_| Cause::Unknown)?;
            check_no_value(frame.data).map(|()| Request::SetStroke(stroke))
        }
        (command::TORQUE, 0) => match *sized(frame.data, &[1])? {
            [0] => Ok(Request::SetTorque(Torque::Off)),
            [1] => Ok(Request::SetTorque(Torque::On)),
            [got] => Err(Cause::value(0, OutOfRange::new("torque switch", "", got, 0, 1))),
        },
        (command::JOINTS, function::STATE) => check_no_value(frame.data).map(|()| Request::ReadJoints),
        (command::JOINTS, function::TEMPERATURE) => match *sized(frame.data, &[1])? {
            [NO_VALUE] => Ok(Request::ReadTemperatures),
            [celsius] => TemperatureLimit::new(celsius)
                .map(Request::SetTemperatureLimit)
                .map_err(|error| Cause::value(0, error)),
        },
        (command::JOINTS, function::VELOCITY) => check_no_value(frame.data).map(|()| Request::ReadVelocities),
        (command::JOINTS, function::MOVE) => Move::from_data(sized(frame.data, &[Move::LEN])?).map(Request::Move),
        // The document prints it with a data byte and with length 0: both are accepted.
        (command::SELF_CHECK, 0) if frame.data.is_empty() => Ok(Request::SelfCheck),
        (command::SELF_CHECK, 0) => check_no_value(frame.data).map(|()| Request::SelfCheck),
        (command::TORQUE, function::MODE) => {
            let [code] = *sized(frame.data, &[1])?;
            let mode = ControlMode::from_code(code).map_err(|error| Cause::value(0, error))?;
            Ok(Request::SetMode(mode))
        }
        (command::JOINTS, function::READ_MODE) => check_no_value(frame.data).map(|()| Request::ReadMode),
        (command::JOINTS, function::FORCE_FEEDBACK) => match *sized(frame.data, &[1])? {
            [0] => Ok(Request::SetForceFeedback(false)),
            [1] => Ok(Request::SetForceFeedback(true)),
            [NO_VALUE] => Ok(Request::ReadForceFeedback),
            [got] => Err(Cause::byte(0, &[0, 1, NO_VALUE], got)),
        },
        _ => Err(Cause::Unknown),
    }
}

/// Divides the data of a response after its documented fields (sections 2.1 to 2.6). Arms may send more: the vendor's
/// software accepts any number of bytes and servos.
fn split_extra(frame: Frame<'_>) -> (Frame<'_>, &[u8]) {
    let len = frame.data.len();
    let documented = match (frame.command, frame.function) {
        (command::INFO, 0) => 24,
        (command::STROKE, function::READ_STROKE) => 1,
        (command::JOINTS, function::STATE) => JointState::LEN,
        // A number of servos between those of a leader and a follower: a leader's, and extra bytes.
        (command::JOINTS, function::TEMPERATURE) => {
            if len < 10 {
                6
            } else {
                10
            }
        }
        (command::JOINTS, function::VELOCITY) => {
            if len < 20 {
                12
            } else {
                20
            }
        }
        (command::SELF_CHECK, 0) => 2,
        (command::TORQUE, function::MODE) => ModeReply::LEN,
        (command::JOINTS, function::READ_MODE) => ModeState::LEN,
        (command::JOINTS, function::FORCE_FEEDBACK) => ForceFeedback::LEN,
        _ => len,
    };
    let (data, extra) = frame.data.split_at_checked(documented).unwrap_or((frame.data, &[]));
    (Frame { data, ..frame }, extra)
}

fn parse_response(frame: Frame<'_>) -> Result<Response, Cause> {
    let with_extra = frame.data;
    let (frame, _) = split_extra(frame);
    match (frame.command, frame.function) {
        (command::INFO, 0) => {
            let data: &[u8; 24] = sized(frame.data, &[24])?;
            let [serial @ .., h0, h1, h2, h3, f0, f1, f2, f3] = *data;
            Ok(Response::Info(Info {
                serial: SerialNumber(serial),
                hardware: Version(u32::from_le_bytes([h0, h1, h2, h3])),
                firmware: Version(u32::from_le_bytes([f0, f1, f2, f3])),
            }))
        }
        (command::STROKE, function::READ_STROKE) => {
            let [code] = *sized(frame.data, &[1])?;
            Stroke::from_code(code)
                .map(Response::Stroke)
                .map_err(|error| Cause::value(0, error))
        }
        (command::JOINTS, function::STATE) => JointState::from_data(with_extra).map(Response::Joints),
        (command::JOINTS, function::TEMPERATURE) => match frame.data.len() {
            6 => sized(frame.data, &[6]).copied().map(PerServo::Leader),
            _ => sized(frame.data, &[6, 10]).copied().map(PerServo::Follower),
        }
        .map(Response::Temperatures),
        (command::JOINTS, function::VELOCITY) => match frame.data.len() {
            12 => Ok(PerServo::Leader(words(frame.data))),
            20 => Ok(PerServo::Follower(words(frame.data))),
            got => Err(Cause::Length {
                expected: &[12, 20],
                got,
            }),
        }
        .map(Response::Velocities),
        (command::SELF_CHECK, 0) => {
            sized(frame.data, &[2]).map(|mask| Response::SelfCheck(SelfCheck(u16::from_le_bytes(*mask))))
        }
        (command::TORQUE, function::MODE) => {
            ModeReply::from_data(sized(frame.data, &[ModeReply::LEN])?).map(Response::ModeReply)
        }
        (command::JOINTS, function::READ_MODE) => {
            ModeState::from_data(sized(frame.data, &[ModeState::LEN])?).map(Response::Mode)
        }
        (command::JOINTS, function::FORCE_FEEDBACK) => {
            ForceFeedback::from_data(sized(frame.data, &[ForceFeedback::LEN])?).map(Response::ForceFeedback)
        }
        // The sources contradict each other on the place of the code: the bytes are not interpreted.
        (ERROR, _) => Err(Cause::ErrorFrame),
        _ => Err(Cause::Unknown),
    }
}

impl Messages for Ling {
    type Request<'a> = Request;
    type Response<'a> = Response;
    type EncodeError = BufferTooShort;

    /// The stroke, the temperatures and the velocities.
    const FENCES: &'static [&'static [u8]] = &[
        &[0xAA, 0x04, 0x0E, 0x01, 0xFE, 0x1B, 0xFF],
        &[0xAA, 0x06, 0x01, 0x01, 0xFE, 0xAD, 0xFF],
        &[0xAA, 0x06, 0x02, 0x01, 0xFE, 0xF4, 0xFF],
    ];

    fn encode_request(&self, request: &Request, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let mut encode = |command, function, data: &[u8]| encode(out, command, function, data);
        match *request {
            Request::ReadInfo => encode(command::INFO, 0, &[NO_VALUE]),
            Request::SetZero => encode(command::ZERO, 0, &[NO_VALUE]),
            Request::SetStroke(stroke) => encode(command::STROKE, stroke as u8, &[NO_VALUE]),
            Request::ReadStroke => encode(command::STROKE, function::READ_STROKE, &[NO_VALUE]),
            Request::SetTorque(torque) => encode(command::TORQUE, 0, &[torque as u8]),
            Request::ReadJoints => encode(command::JOINTS, function::STATE, &[NO_VALUE]),
            Request::ReadTemperatures => encode(command::JOINTS, function::TEMPERATURE, &[NO_VALUE]),
            Request::SetTemperatureLimit(limit) => encode(command::JOINTS, function::TEMPERATURE, &[limit.celsius()]),
            Request::ReadVelocities => encode(command::JOINTS, function::VELOCITY, &[NO_VALUE]),
            Request::Move(target) => encode(command::JOINTS, function::MOVE, &target.to_data()),
            Request::SelfCheck => {
                let got = out.len();
                let out = out.get_mut(..SELF_CHECK.len()).ok_or(BufferTooShort {
                    needed: SELF_CHECK.len(),
                    got,
                })?;
                out.copy_from_slice(&SELF_CHECK);
                Ok(SELF_CHECK.len())
            }
            Request::SetMode(mode) => encode(command::TORQUE, function::MODE, &[mode as u8]),
            Request::ReadMode => encode(command::JOINTS, function::READ_MODE, &[NO_VALUE]),
            Request::SetForceFeedback(on) => encode(command::JOINTS, function::FORCE_FEEDBACK, &[on.into()]),
            Request::ReadForceFeedback => encode(command::JOINTS, function::FORCE_FEEDBACK, &[NO_VALUE]),
        }
    }

    fn encode_response(&self, response: &Response, _to: Option<Key>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let mut encode = |command, function, data: &[u8]| encode(out, command, function, data);
        match response {
            Response::Info(info) => {
                let mut data = [0; 24];
                let fields = info.serial.0.into_iter();
                let fields = fields
                    .chain(info.hardware.0.to_le_bytes())
                    .chain(info.firmware.0.to_le_bytes());
                for (byte, field) in data.iter_mut().zip(fields) {
                    *byte = field;
                }
                encode(command::INFO, 0, &data)
            }
            Response::Stroke(stroke) => encode(command::STROKE, function::READ_STROKE, &[*stroke as u8]),
            Response::Joints(state) => {
                let mut data = [0; JointState::LEN];
                let [j1, j2, j3, j4, j5, j6] = state.joints;
                put_words(&mut data, &[j1, j2, j3, j4, j5, j6, state.gripper]);
                let [.., status] = &mut data;
                *status = state.status.into();
                encode(command::JOINTS, function::STATE, &data)
            }
            Response::Temperatures(celsius) => encode(command::JOINTS, function::TEMPERATURE, celsius.as_slice()),
            Response::Velocities(PerServo::Leader(words)) => {
                let mut data = [0; 12];
                put_words(&mut data, words);
                encode(command::JOINTS, function::VELOCITY, &data)
            }
            Response::Velocities(PerServo::Follower(words)) => {
                let mut data = [0; 20];
                put_words(&mut data, words);
                encode(command::JOINTS, function::VELOCITY, &data)
            }
            Response::SelfCheck(check) => encode(command::SELF_CHECK, 0, &check.0.to_le_bytes()),
            Response::ModeReply(reply) => encode(command::TORQUE, function::MODE, &reply.to_data()),
            Response::Mode(state) => encode(command::JOINTS, function::READ_MODE, &state.to_data()),
            Response::ForceFeedback(state) => encode(command::JOINTS, function::FORCE_FEEDBACK, &state.to_data()),
        }
    }

    fn parse_request(&self, frame: &[u8]) -> Result<Request, ParseError> {
        parse(frame, parse_request)
    }

    fn parse_response(&self, frame: &[u8], (): ()) -> Result<Response, ParseError> {
        parse(frame, parse_response)
    }

    /// ```
    /// use armwire::ling::{Ling, Response, Stroke};
    /// use armwire::messages::Messages;
    ///
    /// let frame = [0xAA, 0x04, 0x0E, 0x03, 0x02, 0x07, 0x08, 0xA1, 0xFF];
    /// assert_eq!(Ling.parse_response(&frame, ()), Ok(Response::Stroke(Stroke::Mm100)));
    /// assert_eq!(Ling.extra(&frame), [0x07, 0x08]);
    /// ```
    fn extra<'a>(&self, frame: &'a [u8]) -> &'a [u8] {
        Frame::parse(frame).map_or(&[], |frame| split_extra(frame).1)
    }
}

/// Decodes a frame. Errors contain its command and function.
fn parse<T>(frame: &[u8], message: impl Fn(Frame<'_>) -> Result<T, Cause>) -> Result<T, ParseError> {
    let Some(frame) = Frame::parse(frame) else {
        return Err(ParseError::NO_FRAME);
    };
    let Frame { command, function, .. } = frame;
    message(frame).map_err(ParseError::of(MessageId::Function { command, function }))
}
