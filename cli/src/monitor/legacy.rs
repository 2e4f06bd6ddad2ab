//! The Ling arm of the older generation: what it says of its joints and its gripper.

use std::time::Duration;

use armwire::Micros;
use armwire::ling::legacy::{GripperState, Legacy, Response};

use super::Reading;
use crate::describe::{joint, legacy};
use crate::link::{Line, Link};
use crate::problem::Problem;

/// How long such an arm may say nothing of its joints, though it says it forty times a second.
const SILENCE: Micros = Micros::from_millis(500);

/// The newest of what the arm has said, or else the next.
pub(super) fn read(
    link: &mut Link<Legacy, impl Line>,
    gripper: &mut Option<GripperState>,
) -> Result<Option<Reading>, Problem> {
    let until = link.now() + SILENCE;
    let mut joints = None;
    loop {
        let left = match joints {
            Some(_) => Micros(0),
            None => until.since(link.now()),
        };
        let heard = link.hear(Duration::from_micros(left.0))?;
        match (heard, &joints) {
            (None, Some(joints)) => return Ok(Some(reading(*joints, gripper.as_ref()))),
            (None, None) if until <= link.now() => {
                let port = link.name().to_owned();
                return Err(Problem::Silent { port });
            }
            (None, None) => {}
            (Some(responses), _) => {
                for response in responses {
                    match response {
                        Response::Joints(state) => joints = Some(state.joints()),
                        Response::Gripper(state) => *gripper = Some(state),
                        _ => {}
                    }
                }
            }
        }
    }
}

fn reading(joints: [u16; 6], state: Option<&GripperState>) -> Reading {
    let joints = joints.map(joint);
    let gripper = state.map_or("gripper not heard of yet".to_owned(), legacy::gripper);
    let rows = joints.iter().enumerate();
    let mut rows: Vec<_> = rows.map(|(i, joint)| format!("joint {}  {joint}", i + 1)).collect();
    rows.push(gripper.clone());
    Reading {
        rows,
        line: format!("{}  {gripper}", joints.join("  ")),
    }
}
