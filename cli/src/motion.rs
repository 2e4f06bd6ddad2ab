//! `armwire move` and `armwire torque`: a Ling arm in motion.

use std::time::Duration;

use armwire::ling::{JointState, Ling, Move, Request, Response, TICKS_PER_TURN, Torque};
use armwire_bridge::time;
use clap::Args;
use clap::builder::{PossibleValuesParser, TypedValueParser};

use crate::args::ArmPort;
use crate::call::ling::{Target, torque};
use crate::call::values::seconds;
use crate::describe::Arm as _;
use crate::error::Error;
use crate::legacy;
use crate::link::{Line, Link};
use crate::output::say;

/// How near a joint is when it is there: 3 ticks, 0.26°.
const NEAR: u16 = 3;
/// How often is looked.
const PERIOD: time::Duration = time::Duration::from_millis(20);

/// The arguments of `armwire move`.
#[derive(Args)]
pub(crate) struct MoveArm {
    #[command(flatten)]
    arm: ArmPort,
    #[command(flatten)]
    target: Target,
    /// Wait until the joints are within 3 ticks (0.26°) of where they go. The gripper is not waited for: it may hold
    /// something.
    #[arg(long)]
    wait: bool,
    /// How long to wait at most. The arm moves on after that, too.
    #[arg(long, value_name = "SECONDS", requires = "wait", default_value = "30", value_parser = seconds)]
    timeout: Duration,
}

/// The arguments of `armwire torque`.
#[derive(Args)]
pub(crate) struct SetTorque {
    #[command(flatten)]
    arm: ArmPort,
    /// Whether the arm holds its position.
    #[arg(value_parser = PossibleValuesParser::new(["on", "off"]).map(torque))]
    torque: Torque,
}

impl MoveArm {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut link = legacy::open(&self.arm.connect()?)?;
        let target = self.target.to_move();
        link.call(&Request::Move(target), drop)?;
        if !self.wait {
            return say(format!(
                "{}: sent, the arm does not answer it",
                Ling::show_request(&Request::Move(target))
            ));
        }
        let state = wait(&mut link, &target, self.timeout)?;
        say(format!("there: {}", Ling::show_response(&Response::Joints(state))))
    }
}

impl SetTorque {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut link = legacy::open(&self.arm.connect()?)?;
        let done = match self.torque {
            Torque::On => "torque on: the arm holds its position",
            Torque::Off => "torque off: the arm can be moved by hand",
        };
        link.call(&Request::SetTorque(self.torque), drop)?;
        say(format!("{done}, if it was heard; the arm does not answer it"))
    }
}

/// Waits until the arm is where it was told to go.
fn wait(link: &mut Link<Ling, impl Line>, target: &Move, timeout: Duration) -> Result<JointState, Error> {
    let until = link.now() + time::Duration::from_micros(timeout.as_micros().try_into().unwrap_or(u64::MAX));
    loop {
        if let Some(Response::Joints(state)) = link.call(&Request::ReadJoints, |response| response)? {
            let off = far(target, &state);
            if off.is_empty() {
                return Ok(state);
            }
            if until <= link.now() {
                let reason = format!(
                    "not there after {} s: {} (status {})",
                    timeout.as_secs_f32(),
                    off.join(", "),
                    state.status
                );
                return Err(Error::at(link.name(), reason));
            }
        }
        link.sleep_until(link.now() + PERIOD);
    }
}

/// Each joint that is not near its target, and how far off.
fn far(target: &Move, state: &JointState) -> Vec<String> {
    let joints = (1..).zip(target.joints.iter().zip(state.joints));
    let off = joints.filter_map(|(n, ((goal, _speed), ticks))| {
        let off = goal.ticks().abs_diff(ticks);
        let degrees = f32::from(off) * 360.0 / f32::from(TICKS_PER_TURN);
        (off > NEAR).then(|| format!("joint {n} is {degrees:.2}° off"))
    });
    off.collect()
}

#[cfg(test)]
mod tests {
    use armwire::ling::{GripperSpeed, MotionStatus, Opening, Position, Speed};

    use super::*;

    #[test]
    fn only_joints_that_are_not_there_are_told() {
        let target = Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::OPEN, GripperSpeed(1000)),
        };
        let mut state = JointState {
            joints: [2048, 2051, 2045, 2048, 2048, 2048],
            gripper: 0,
            status: MotionStatus::Locked,
        };
        assert!(far(&target, &state).is_empty(), "the gripper is not waited for");
        state.joints[1] = 2052;
        state.joints[5] = 1024;
        assert_eq!(far(&target, &state), ["joint 2 is 0.35° off", "joint 6 is 90.00° off"]);
    }
}
