//! `armwire move`, `torque` and `set-zero`: actions of a Ling arm, each read back.

use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::{JointState, Move, Position, Request, TICKS_PER_TURN, Torque};
use armwire_host as host;
use clap::Args;

use crate::args::ArmPort;
use crate::call::ling::{TORQUES, Target};
use crate::call::values::{one_of, seconds};
use crate::confirm::{Confirm, Question};
use crate::error::Error;
use crate::output::print_line;
use crate::stop::stoppable;

/// Zero, in ticks.
const ZERO: u16 = Position::CENTRE.ticks();
/// Timeout of an action that is read back.
const READ_BACK_TIMEOUT: Duration = Duration::from_millis(500);
/// Period of the readings.
const POLL_PERIOD: Duration = Duration::from_millis(20);

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
        let (wanted, done) = match self.torque {
            Torque::On => (true, "torque on: the arm holds its position"),
            Torque::Off => (false, "torque off: the arm can be moved by hand"),
        };
        let question = match self.torque {
            Torque::On => None,
            Torque::Off => Some(self.confirm.question("With torque off the arm falls: hold it.")?),
        };
        let mut arm = self.arm.connect()?.ling()?;
        question.map_or(Ok(()), Question::ask)?;
        let request = Request::SetTorque(self.torque);
        let is_so = |state: &JointState| state.status.is_holding() == Some(wanted);
        let (JointState { status, .. }, is_so) = send_and_read(&mut arm, |arm| arm.set_torque(self.torque), is_so)?;
        match status.is_holding() {
            _ if is_so => print_line(format_args!("{done} (status {status})")),
            None => print_line(format_args!(
                "{request}: sent; status {status} does not show its effect"
            )),
            Some(_) => Err(Error::at(
                arm.name(),
                format_args!("{request} was sent, but the status is {status}"),
            )),
        }
    }
}

impl SetZero {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let question = self
            .confirm
            .question("The current pose becomes zero. The torque goes off and the arm falls: hold it.")?;
        let mut arm = self.arm.connect()?.ling()?;
        question.ask()?;
        let is_zero = |state: &JointState| {
            let mut joints = state.joints.iter();
            joints.all(|ticks| ticks.abs_diff(ZERO) <= Move::JOINT_TOLERANCE)
        };
        let (state, is_zero) = send_and_read(&mut arm, host::Ling::set_zero, is_zero)?;
        match is_zero {
            true => print_line(format_args!("zero set: {state}")),
            false => Err(Error::at(
                arm.name(),
                format_args!("set-zero was sent, but the arm reports {state}"),
            )),
        }
    }
}

/// Sends a request without an answer, and reads until `is_so` returns true, at most for [`READ_BACK_TIMEOUT`]. Returns the
/// last reading, and its result.
fn send_and_read(
    arm: &mut host::Ling,
    send: impl FnOnce(&mut host::Ling) -> Result<(), host::Error>,
    is_so: impl Fn(&JointState) -> bool,
) -> Result<(JointState, bool), Error> {
    let read = |arm: &mut host::Ling| {
        send(arm)?;
        let start = Instant::now();
        loop {
            let state = arm.read_joints()?;
            let is_so = is_so(&state);
            if is_so || start.elapsed() >= READ_BACK_TIMEOUT {
                return Ok((state, is_so));
            }
            thread::sleep(POLL_PERIOD);
        }
    };
    read(arm).map_err(|error| arm.explain(error).into())
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
    use armwire::ling::{GripperSpeed, MotionStatus, Opening, Speed};

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
