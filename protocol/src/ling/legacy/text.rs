//! Messages of an arm of the older generation as text.

use core::fmt::{self, Display, Formatter};

use super::{GripperState, JointState, Request, Response};
use crate::ling::text::{Angle, list};

/// There is none.
impl Display for Request {
    fn fmt(&self, _: &mut Formatter<'_>) -> fmt::Result {
        match *self {}
    }
}

/// The joints in degrees.
///
/// ```
/// use armwire::ling::legacy::{Firmware, JointState};
///
/// let state = JointState {
///     firmware: Firmware::V6_0,
///     servos: [2048, 2048, 3072, 1024, 2048, 2048, 2048, 2048, 4096],
/// };
/// assert_eq!(state.to_string(), "joints: +0.00° +90.00° +0.00° +0.00° +0.00° +180.00° (out of range)");
/// ```
impl Display for JointState {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        list(f, "joints: ", self.joints().map(Angle))
    }
}

/// Raw counts: their scale depends on the gripper.
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
/// assert_eq!(state.to_string(), "gripper: 2051, potentiometer: 2300, sync button: 0, attitude button: 1");
/// ```
impl Display for GripperState {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            servo,
            potentiometer,
            sync_button,
            attitude_button,
            ..
        } = self;
        write!(
            f,
            "gripper: {servo}, potentiometer: {potentiometer}, sync button: {sync_button}, attitude button: \
             {attitude_button}"
        )
    }
}

/// The names and values of the message.
impl Display for Response {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Joints(state) => state.fmt(f),
            Self::Gripper(state) => state.fmt(f),
        }
    }
}
