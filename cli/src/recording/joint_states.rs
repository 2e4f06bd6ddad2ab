//! Joint positions from the frames of an arm.

use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling, Stroke};
use armwire::messages::Messages;
use armwire::xarm::{self, Reply, State, XArm};
use armwire_host::describe::{
    Protocol,
    xarm::{JOINTS, POSITIONS},
};

use super::frame::Frame;
use crate::args::Speaker;

/// Facts of an arm from its frames so far.
#[derive(Default)]
pub(super) struct Joints {
    /// The stroke of the gripper, without which its opening is no length.
    stroke: Option<Stroke>,
    /// The number of joints of an xArm.
    axes: Option<usize>,
}

impl Joints {
    /// Joint positions in rad, and a gripper's opening in m behind them if its stroke is known. `None` of any other
    /// frame, and if a position is out of the protocol's range.
    pub(super) fn read(&mut self, frame: &Frame) -> Option<Vec<(String, f64)>> {
        if frame.from != Speaker::Arm {
            return None;
        }
        match frame.protocol {
            Protocol::Ling => self.read_ling(&frame.bytes),
            Protocol::LingLegacy => read_legacy(&frame.bytes),
            Protocol::Xarm => self.read_xarm(&frame.bytes),
            // The robot has a request for which servos run, and none for their positions.
            Protocol::Alpha1 => None,
        }
    }

    fn read_ling(&mut self, frame: &[u8]) -> Option<Vec<(String, f64)>> {
        match Messages::parse_response(&Ling, frame, ()).ok()? {
            ling::Response::Stroke(stroke) => {
                self.stroke = Some(stroke);
                None
            }
            ling::Response::Joints(state) => {
                let opening = state.opening().ok()?;
                let mut joints = numbered(state.positions().ok()?.map(|position| position.radians()));
                joints.extend(self.stroke.map(|stroke| {
                    let metres = f64::from(opening.millimetres(stroke)) / 1_000.0;
                    ("gripper".to_owned(), metres)
                }));
                Some(joints)
            }
            _ => None,
        }
    }

    fn read_xarm(&mut self, frame: &[u8]) -> Option<Vec<(String, f64)>> {
        let arm = XArm::default();
        let response = Messages::parse_response(&arm, frame, armwire::framing::Framing::unsolicited(&arm)).ok()?;
        let xarm::Response::Reply { state, reply } = response else {
            return None;
        };
        match reply {
            Reply::Version(text) => {
                self.axes = text.version().ok().map(|version| version.axes.into());
                None
            }
            Reply::Raw(raw) if raw.register() == POSITIONS && !state.contains(State::INVALID) => {
                let (positions, rest) = raw.params().as_chunks();
                let is_whole = rest.is_empty() && positions.len() == JOINTS;
                // Without the version the number of joints is unknown.
                let axes = self.axes?.min(JOINTS);
                is_whole.then(|| numbered(positions[..axes].iter().map(|&bytes| f32::from_le_bytes(bytes))))
            }
            _ => None,
        }
    }
}

fn read_legacy(frame: &[u8]) -> Option<Vec<(String, f64)>> {
    match Messages::parse_response(&Legacy, frame, ()).ok()? {
        legacy::Response::Joints(state) => Some(numbered(state.positions().ok()?.map(|position| position.radians()))),
        _ => None,
    }
}

/// Joints from number 1.
fn numbered(radians: impl IntoIterator<Item = f32>) -> Vec<(String, f64)> {
    let joints = (1..).zip(radians);
    joints
        .map(|(n, radians)| (format!("joint{n}"), radians.into()))
        .collect()
}
