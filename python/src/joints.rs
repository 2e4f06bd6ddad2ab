//! The joints of a Ling arm, as Python gets them.

use armwire::ling::{JOINTS, JointState, MotionStatus};

/// Joint ticks, gripper in thousandths, motion status, and the number of data bytes of another robot's answer, else 0.
pub(crate) type Joints = ([u16; JOINTS], u16, u8, u8);

pub(crate) fn joints(state: JointState) -> Joints {
    let data_bytes = match state.status {
        MotionStatus::Foreign(foreign) => foreign.data_bytes,
        _ => 0,
    };
    (state.joints, state.gripper, state.status.into(), data_bytes)
}
