//! The joints of a Ling arm, as Python gets them.

use armwire::ling::{JOINTS, JointState};

/// Joint ticks, gripper in thousandths, motion status.
pub(crate) type Joints = ([u16; JOINTS], u16, u8);

pub(crate) fn joints(state: JointState) -> Joints {
    (state.joints, state.gripper, state.status.into())
}
