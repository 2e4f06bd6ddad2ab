//! `armwire move`, `torque` and `set-zero`: actions of a Ling arm, each read back.

use std::time::Duration;

use armwire::ling::{JointState, Move, Request, TICKS_PER_TURN, Torque};
use armwire_host as host;
use clap::Args;

use crate::args::ArmPort;
use crate::call::ling::{TORQUES, Target};
use crate::call::values::{one_of, seconds};
use crate::confirm::{Confirm, Question};
use crate::error::Error;
use crate::output::print_line;
use crate::stop::stoppable;

/// The arguments of `armwire move`.
#[derive(Args)]
pub(crate) struct MoveArm {
    #[command(flatten)]
    arm: ArmPort,
    #[command(flatten)]
    target: Target,
    /// Wait until the joints are within 3 ticks (0.26°) of their targets, and the gripper is within 0.5 % of its stroke or
    /// has stopped for 1 s, for example at an object.
    #[arg(long)]
    wait: bool,
    /// Maximum wait. The arm continues to move after it: 'armwire stop' stops it.
    #[arg(long, value_name = "SECONDS", requires = "wait", default_value = "30", value_parser = seconds)]
    timeout: Duration,
}

/// The arguments of `armwire torque`.
#[derive(Args)]
pub(crate) struct SetTorque {
    #[command(flatten)]
    arm: ArmPort,
    /// With torque on the arm holds its position.
    #[arg(value_parser = one_of(TORQUES))]
    torque: Torque,
    #[command(flatten)]
    confirm: Confirm,
}

/// The arguments of `armwire set-zero`.
#[derive(Args)]
pub(crate) struct SetZero {
    #[command(flatten)]
    arm: ArmPort,
    #[command(flatten)]
    confirm: Confirm,
}

impl MoveArm {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut arm = stoppable::open(&self.arm)?;
        let moved = self.run_on(&mut arm);
        moved.map_err(|error| error.explained(|error| arm.explain(error)))
    }

    fn run_on(&self, arm: &mut host::Ling) -> Result<(), Error> {
        // Without torque nothing else is asked of the arm.
        arm.require_torque()?;
        let target = self.target.to_move(arm)?;
        match self.wait {
            true => self.move_and_wait(arm, &target),
            false => {
                let (gripper, _speed) = target.gripper;
                arm.stop_if_interrupted(gripper, |arm| {
                    arm.move_to(&target)?;
                    let request = Request::Move(target);
                    print_line(format_args!("sent: {request}"))?;
                    print_line(format_args!("now: {}", arm.read_joints()?))
                })
            }
        }
    }

    fn move_and_wait(&self, arm: &mut host::Ling, target: &Move) -> Result<(), Error> {
        match arm.move_and_wait(target, self.timeout) {
            Ok(state) => match far_gripper(target, &state) {
                None => print_line(format_args!("target reached: {state}")),
                Some(off) => print_line(format_args!(
                    "joints reached; {off} and has stopped: is it holding something? {state}"
                )),
            },
            Err(host::Error::NotReached { name, state, limit }) => {
                let mut off = far_joints(target, &state);
                off.extend(far_gripper(target, &state));
                let (seconds, off, status) = (limit.as_secs_f32(), off.join(", "), state.status);
                let reason = format!(
                    "target not reached after {seconds} s: {off} (status {status}); 'armwire stop PORT' stops the arm"
                );
                Err(Error::at(name.as_str(), reason))
            }
            Err(error) => Err(error.into()),
        }
    }
}

impl SetTorque {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let question = match self.torque {
            Torque::On => None,
            Torque::Off => Some(self.confirm.question("With torque off the arm falls: hold it.")?),
        };
        let mut arm = self.arm.connect()?.ling()?;
        question.map_or(Ok(()), Question::ask)?;
        let set = arm.set_torque(self.torque);
        print_line(set.map_err(|error| arm.explain(error))?)
    }
}

impl SetZero {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let question = self
            .confirm
            .question("The current pose becomes zero. The torque goes off and the arm falls: hold it.")?;
        let mut arm = self.arm.connect()?.ling()?;
        question.ask()?;
        let set = arm.set_zero();
        print_line(set.map_err(|error| arm.explain(error))?)
    }
}

/// The gripper's distance from its target, if that exceeds the tolerance.
fn far_gripper(target: &Move, state: &JointState) -> Option<String> {
    let (goal, _speed) = target.gripper;
    let off = goal.per_mille().abs_diff(state.gripper);
    (!target.is_gripper_reached_by(state)).then(|| format!("gripper is {:.1} % off", f32::from(off) / 10.0))
}

/// The joints away from their targets, and their distances.
fn far_joints(target: &Move, state: &JointState) -> Vec<String> {
    let joints = (1..).zip(target.joints.iter().zip(state.joints));
    let off = joints.filter_map(|(n, ((goal, _speed), ticks))| {
        let off = goal.ticks().abs_diff(ticks);
        let degrees = f32::from(off) * 360.0 / f32::from(TICKS_PER_TURN);
        (off > Move::JOINT_TOLERANCE).then(|| format!("joint {n} is {degrees:.2}° off"))
    });
    off.collect()
}

#[cfg(test)]
mod tests {
    use armwire::ling::{GripperSpeed, MotionStatus, Opening, Position, Speed};

    use super::*;

    #[test]
    fn only_joints_away_from_their_targets_are_listed() {
        let target = Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::OPEN, GripperSpeed(1000)),
        };
        let mut state = JointState {
            joints: [2048, 2051, 2045, 2048, 2048, 2048],
            gripper: 0,
            status: MotionStatus::Locked,
        };
        assert!(far_joints(&target, &state).is_empty());
        state.joints[1] = 2052;
        state.joints[5] = 1024;
        let off = ["joint 2 is 0.35° off", "joint 6 is 90.00° off"];
        assert_eq!(far_joints(&target, &state), off);
    }

    #[test]
    fn gripper_is_there_within_half_a_percent() {
        let target = Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1000)),
        };
        for (gripper, off) in [
            (495, None),
            (505, None),
            (494, Some("gripper is 0.6 % off")),
            (2051, Some("gripper is 155.1 % off")),
        ] {
            let state = JointState {
                joints: [2048; 6],
                gripper,
                status: MotionStatus::Locked,
            };
            assert_eq!(far_gripper(&target, &state).as_deref(), off, "{gripper}");
        }
    }
}
