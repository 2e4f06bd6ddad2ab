//! The messages of an arm of the older generation, and their encoding.

use super::{Frame, Legacy};
use crate::error::{Cause, MessageId, ParseError, sized};
use crate::ling::frame::{put_words, words};
use crate::ling::{JOINTS, Position};
use crate::messages::Messages;
use crate::{BufferTooShort, OutOfRange};

/// Commands.
mod command {
    pub(super) const GRIPPER_V5: u8 = 0x02;
    pub(super) const JOINTS_V5: u8 = 0x04;
    pub(super) const GRIPPER_V6_0: u8 = 0x12;
    pub(super) const JOINTS_V6_0: u8 = 0x14;
}

/// Servos in a joint frame: two on each of joints 1 to 3, one on each of joints 4 to 6.
pub const SERVOS: usize = 9;

/// A message of the host: an empty type, because no request is known.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Request {}

/// A message of the arm, always unsolicited.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Response {
    /// The positions of the joints.
    Joints(JointState),
    /// The position of the gripper, and the buttons.
    Gripper(GripperState),
}

/// The firmware generation of a frame, from its command. The data is the same.
///
/// The vendor's package 5.6 uses the version that the arm reports. Other sources call arms with commands 14 and 12 "v5"
/// too.
///
/// ```
/// use armwire::ling::legacy::Firmware;
///
/// assert_eq!((Firmware::V5.joints_command(), Firmware::V5.gripper_command()), (0x04, 0x02));
/// assert_eq!((Firmware::V6_0.joints_command(), Firmware::V6_0.gripper_command()), (0x14, 0x12));
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Firmware {
    /// 5: commands 04 and 02.
    V5,
    /// 6.0: commands 14 and 12.
    V6_0,
}

impl Firmware {
    /// The command of a joint frame.
    pub const fn joints_command(self) -> u8 {
        match self {
            Self::V5 => command::JOINTS_V5,
            Self::V6_0 => command::JOINTS_V6_0,
        }
    }

    /// The command of a gripper frame.
    pub const fn gripper_command(self) -> u8 {
        match self {
            Self::V5 => command::GRIPPER_V5,
            Self::V6_0 => command::GRIPPER_V6_0,
        }
    }
}

/// The positions of the joints: nine servo positions in raw counts as sent by the arm.
///
/// A servo has 4096 ticks per turn, 2048 at 0 rad: the scale of the current generation. Only the vendor's ROS 2 driver
/// divides by 4095.
///
/// ```
/// use armwire::ling::legacy::{Firmware, JointState};
///
/// let state = JointState {
///     firmware: Firmware::V6_0,
///     servos: [2048, 2048, 3072, 1024, 2048, 2048, 2048, 2048, 4096],
/// };
/// assert_eq!(state.joints(), [2048, 3072, 2048, 2048, 2048, 4096]);
/// let error = state.positions().unwrap_err();
/// assert_eq!(error.to_string(), "joint position is 4096 ticks, must be 0..=4095");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct JointState {
    /// The firmware generation of the arm.
    pub firmware: Firmware,
    /// Positions of servos 1 to 9, in ticks. Servo 2 moves with servo 1, servos 4 and 6 against servos 3 and 5.
    pub servos: [u16; SERVOS],
}

impl JointState {
    const LEN: usize = 2 * SERVOS;

    /// Positions of joints 1 to 6 in ticks, as sent: those of servos 1, 3, 5, 7, 8 and 9.
    pub const fn joints(&self) -> [u16; JOINTS] {
        let [joint1, _, joint2, _, joint3, _, joint4, joint5, joint6] = self.servos;
        [joint1, joint2, joint3, joint4, joint5, joint6]
    }

    /// The joint positions.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for the first joint over 4095 ticks.
    pub fn positions(&self) -> Result<[Position; JOINTS], OutOfRange> {
        let mut positions = [Position::CENTRE; JOINTS];
        for (position, ticks) in positions.iter_mut().zip(self.joints()) {
            *position = Position::new(ticks)?;
        }
        Ok(positions)
    }
}

/// The position of the gripper, and the buttons, in raw counts as sent by the arm.
///
/// There is no typed opening, because the frame does not contain the gripper type. 2048 is open; the vendor's software
/// has 2900, 3290, 3600 or 3930 for closed.
///
/// ```
/// use armwire::ling::legacy::{Firmware, GripperState};
///
/// let state = GripperState {
///     firmware: Firmware::V5,
///     id: 1,
///     servo: 2051,
///     potentiometer: 2300,
///     sync_button: 0,
///     attitude_button: 1,
/// };
/// assert!(state.servo >= 2048);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct GripperState {
    /// The firmware generation of the arm.
    pub firmware: Firmware,
    /// The gripper's id: 1 in all known frames.
    pub id: u8,
    /// The actual or commanded position of the gripper's servo.
    pub servo: u16,
    /// The position of a leader arm's handle, which takes the place of a gripper.
    pub potentiometer: u16,
    /// The button that switches synchronisation of the follower: 0 released, 1 pressed.
    pub sync_button: u8,
    /// The second button, named after the arm's attitude: 0 released, 1 pressed.
    pub attitude_button: u8,
}

impl GripperState {
    const LEN: usize = 7;
}

fn parse_joints(firmware: Firmware, data: &[u8]) -> Result<Response, Cause> {
    let data: &[u8; JointState::LEN] = sized(data, &[JointState::LEN])?;
    Ok(Response::Joints(JointState {
        firmware,
        servos: words(data),
    }))
}

fn parse_gripper(firmware: Firmware, data: &[u8]) -> Result<Response, Cause> {
    let data: &[u8; GripperState::LEN] = sized(data, &[GripperState::LEN])?;
    let [id, s0, s1, p0, p1, sync_button, attitude_button] = *data;
    Ok(Response::Gripper(GripperState {
        firmware,
        id,
        servo: u16::from_le_bytes([s0, s1]),
        potentiometer: u16::from_le_bytes([p0, p1]),
        sync_button,
        attitude_button,
    }))
}

impl Messages for Legacy {
    type Request<'a> = Request;
    type Response<'a> = Response;
    type EncodeError = BufferTooShort;

    fn encode_request(&self, request: &Request, _out: &mut [u8]) -> Result<usize, BufferTooShort> {
        match *request {}
    }

    fn encode_response(&self, response: &Response, _to: Option<()>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        match *response {
            Response::Joints(JointState { firmware, servos }) => {
                let mut data = [0; JointState::LEN];
                put_words(&mut data, &servos);
                let command = firmware.joints_command();
                Frame { command, data: &data }.put(out)
            }
            Response::Gripper(state) => {
                let [s0, s1] = state.servo.to_le_bytes();
                let [p0, p1] = state.potentiometer.to_le_bytes();
                let data = [state.id, s0, s1, p0, p1, state.sync_button, state.attitude_button];
                let command = state.firmware.gripper_command();
                Frame { command, data: &data }.put(out)
            }
        }
    }

    /// No frame is a request: all are unknown.
    fn parse_request(&self, frame: &[u8]) -> Result<Request, ParseError> {
        parse(frame, |_, _| Err(Cause::Unknown))
    }

    fn parse_response(&self, frame: &[u8], (): ()) -> Result<Response, ParseError> {
        parse(frame, |command, data| match command {
            command::JOINTS_V5 => parse_joints(Firmware::V5, data),
            command::JOINTS_V6_0 => parse_joints(Firmware::V6_0, data),
            command::GRIPPER_V5 => parse_gripper(Firmware::V5, data),
            command::GRIPPER_V6_0 => parse_gripper(Firmware::V6_0, data),
            _ => Err(Cause::Unknown),
        })
    }
}

/// Decodes a frame. Errors contain its command.
fn parse<T>(frame: &[u8], message: impl Fn(u8, &[u8]) -> Result<T, Cause>) -> Result<T, ParseError> {
    let Some(Frame { command, data }) = Frame::parse(frame) else {
        return Err(ParseError::NO_FRAME);
    };
    message(command, data).map_err(ParseError::of(MessageId::Command(command)))
}
