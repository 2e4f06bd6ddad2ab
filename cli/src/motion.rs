//! `armwire move`, `torque` and `set-zero`: actions of a Ling arm, each read back.

use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::{JointState, Ling, Move, Position, Request, TICKS_PER_TURN, Torque};
use clap::Args;

use crate::args::ArmPort;
use crate::call::ling::{TORQUES, Target, read_joints};
use crate::call::values::{one_of, seconds};
use crate::confirm::Confirm;
use crate::error::Error;
use crate::legacy;
use crate::link::Link;
use crate::output::print_line;
use crate::signals;
use crate::stop::stoppable::Stoppable;

/// A gripper whose reading is the same for this long stands still: it may hold something.
const STANDSTILL_TIME: Duration = Duration::from_millis(1_000);
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
        let mut arm = Stoppable::open(&self.arm)?;
        self.run_on(&mut arm).map_err(|error| arm.explain(error))
    }

    fn run_on(&self, arm: &mut Stoppable) -> Result<(), Error> {
        let link = arm.link();
        if read_joints(link)?.status.is_holding() == Some(false) {
            let reason = "the torque is off, so nothing was sent: 'armwire torque PORT on' switches it on ('armwire call \
                          ling PORT move' sends it all the same)";
            return Err(Error::at(link.name(), reason));
        }
        let target = self.target.to_move(link)?;
        arm.run(&target, |link| self.send(link, &target))
    }

    fn send(&self, link: &mut Link<Ling>, target: &Move) -> Result<(), Error> {
        let request = Request::Move(*target);
        link.call(&request, drop)?;
        if !self.wait {
            print_line(format_args!("sent: {request}"))?;
            return print_line(format_args!("now: {}", read_joints(link)?));
        }
        let mut gripper = Standstill::default();
        let is_there = |now, state: &JointState| {
            let stands_still = gripper.lasts(now, state.gripper) >= STANDSTILL_TIME;
            target.are_joints_reached_by(state) && (stands_still || target.is_gripper_reached_by(state))
        };
        let (state, is_there) = read_until(link, self.timeout, is_there)?;
        match (is_there, far_gripper(target, &state)) {
            (true, None) => print_line(format_args!("target reached: {state}")),
            (true, Some(off)) => print_line(format_args!(
                "joints reached; {off} and has stopped: is it holding something? {state}"
            )),
            (false, gripper) => {
                let mut off = far_joints(target, &state);
                off.extend(gripper);
                let (seconds, off, status) = (self.timeout.as_secs_f32(), off.join(", "), state.status);
                let reason = format!(
                    "target not reached after {seconds} s: {off} (status {status}); 'armwire stop PORT' stops the arm"
                );
                Err(Error::at(link.name(), reason))
            }
        }
    }
}

impl SetTorque {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (wanted, done) = match self.torque {
            Torque::On => (true, "torque on: the arm holds its position"),
            Torque::Off => (false, "torque off: the arm can be moved by hand"),
        };
        if !wanted {
            self.confirm.prompt("With torque off the arm falls: hold it.")?;
        }
        let connection = self.arm.connect()?;
        let mut link = legacy::open(&connection)?;
        let request = Request::SetTorque(self.torque);
        let is_so = |_, state: &JointState| state.status.is_holding() == Some(wanted);
        let (JointState { status, .. }, is_so) =
            send_and_read(&mut link, &request, is_so).map_err(|error| error.explained(&connection))?;
        match status.is_holding() {
            _ if is_so => print_line(format_args!("{done} (status {status})")),
            None => print_line(format_args!(
                "{request}: sent; status {status} does not show its effect"
            )),
            Some(_) => Err(Error::at(
                link.name(),
                format_args!("{request} was sent, but the status is {status}"),
            )),
        }
    }
}

impl SetZero {
    pub(crate) fn run(&self) -> Result<(), Error> {
        self.confirm
            .prompt("The current pose becomes zero. The torque goes off and the arm falls: hold it.")?;
        let connection = self.arm.connect()?;
        let mut link = legacy::open(&connection)?;
        let is_zero = |_, state: &JointState| {
            let mut joints = state.joints.iter();
            joints.all(|ticks| ticks.abs_diff(ZERO) <= Move::JOINT_TOLERANCE)
        };
        let (state, is_zero) =
            send_and_read(&mut link, &Request::SetZero, is_zero).map_err(|error| error.explained(&connection))?;
        match is_zero {
            true => print_line(format_args!("zero set: {state}")),
            false => Err(Error::at(
                link.name(),
                format_args!("set-zero was sent, but the arm reports {state}"),
            )),
        }
    }
}

/// Sends a request without an answer, and reads until `is_so` returns true, at most for [`READ_BACK_TIMEOUT`].
fn send_and_read(
    link: &mut Link<Ling>,
    request: &Request,
    is_so: impl FnMut(Duration, &JointState) -> bool,
) -> Result<(JointState, bool), Error> {
    link.call(request, drop)?;
    read_until(link, READ_BACK_TIMEOUT, is_so)
}

/// Reads until `is_so` returns true, at most for the timeout. `is_so` takes the time since the start and the reading.
/// Returns the last reading, and its result.
fn read_until(
    link: &mut Link<Ling>,
    timeout: Duration,
    mut is_so: impl FnMut(Duration, &JointState) -> bool,
) -> Result<(JointState, bool), Error> {
    let start = Instant::now();
    loop {
        signals::check().map_err(armwire_host::Error::Interrupted)?;
        let state = read_joints(link)?;
        let is_so = is_so(start.elapsed(), &state);
        if is_so || start.elapsed() >= timeout {
            return Ok((state, is_so));
        }
        thread::sleep(POLL_PERIOD);
    }
}

/// A gripper's reading, and the time since which it is the same.
#[derive(Default)]
struct Standstill(Option<(u16, Duration)>);

impl Standstill {
    /// Takes a reading, and returns how long it has been the same.
    fn lasts(&mut self, now: Duration, opening: u16) -> Duration {
        match self.0 {
            Some((before, since)) if before == opening => now - since,
            _ => {
                self.0 = Some((opening, now));
                Duration::ZERO
            }
        }
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

    #[test]
    fn gripper_stands_still_while_its_reading_stays() {
        let mut gripper = Standstill::default();
        let lasts = |(millis, opening): (u64, u16)| gripper.lasts(Duration::from_millis(millis), opening).as_millis();
        let readings = [(10, 0), (500, 0), (600, 1), (1600, 1), (1601, 0), (1602, 0)];
        assert_eq!(readings.map(lasts), [0, 490, 0, 1000, 0, 1]);
    }
}
