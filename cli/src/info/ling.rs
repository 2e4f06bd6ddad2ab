//! The Ling arm.

use armwire::ling::{Kind, Ling, Request, Response};

use super::show;
use crate::describe::{gripper, joint, list};
use crate::error::Error;
use crate::link::{Line, Link};

pub(super) fn run(link: &mut Link<Ling, impl Line>) -> Result<(), Error> {
    let requests = [
        Request::ReadInfo,
        Request::ReadJoints,
        Request::ReadStroke,
        Request::ReadTemperatures,
        Request::ReadVelocities,
        Request::SelfCheck,
    ];
    // Until the temperatures tell: there is one for each servo.
    let mut kind = Kind::Follower;
    for request in requests {
        match link.call(request, |response| response)? {
            Some(Response::Info(info)) => {
                let arm = match info.serial.kind() {
                    Some(Kind::Leader) => "Ling leader",
                    Some(Kind::Follower) => "Ling follower",
                    None => "Ling, of a kind that the serial number does not tell",
                };
                show("arm", arm.to_owned())?;
                show("serial", info.serial.to_string())?;
                show("hardware", info.hardware.to_string())?;
                show("firmware", info.firmware.to_string())?;
            }
            Some(Response::Joints(state)) => {
                show("status", state.status.to_string())?;
                for (i, ticks) in state.joints.into_iter().enumerate() {
                    show(&format!("joint {}", i + 1), joint(ticks))?;
                }
                show("gripper", gripper(state.gripper))?;
            }
            Some(Response::Stroke(stroke)) => show("stroke", format!("{} mm", stroke.millimetres()))?,
            Some(Response::Temperatures(celsius)) => {
                kind = celsius.kind();
                show("temperatures", format!("{} °C", list(&celsius)))?;
            }
            Some(Response::Velocities(speeds)) => show("velocities", format!("{} ticks/s", list(&speeds)))?,
            Some(Response::SelfCheck(check)) => {
                let faulty: Vec<_> = check.faulty(kind).map(|id| id.to_string()).collect();
                let verdict = match faulty.as_slice() {
                    [] => format!("all {} servos normal", kind.servos()),
                    faulty => format!("servos not normal: {}", faulty.join(", ")),
                };
                show("self-check", verdict)?;
            }
            _ => {}
        }
    }
    Ok(())
}
