//! The Ling arm: joints, gripper and status.

use armwire::ling::{JointState, Ling, Request, Response};

use super::Reading;
use crate::describe::{gripper, joint};
use crate::link::{Line, Link};
use crate::problem::Problem;

pub(super) fn read(link: &mut Link<Ling, impl Line>) -> Result<Option<Reading>, Problem> {
    Ok(match link.call(Request::ReadJoints)? {
        Some(Response::Joints(state)) => Some(reading(&state)),
        _ => None,
    })
}

fn reading(state: &JointState) -> Reading {
    let joints = state.joints.map(joint);
    let gripper = gripper(state.gripper);
    let mut rows: Vec<_> = joints
        .iter()
        .enumerate()
        .map(|(i, joint)| format!("joint {}  {joint}", i + 1))
        .collect();
    rows.push(format!("gripper  {gripper}"));
    rows.push(format!("status   {}", state.status));
    Reading {
        rows,
        line: format!("{}  gripper {gripper}  {}", joints.join("  "), state.status),
    }
}
