//! `armwire move`, `torque` and `set-zero`: actions of a Ling arm, each read back.

use std::time::Duration;

use armwire::ling::arrival::Tolerances;
use armwire::ling::{Move, Request, TICKS_PER_TURN, Torque};
use armwire_host as host;
use clap::Args;

use crate::args::ArmPort;
use crate::call::ling::{TORQUES, Target};
use crate::call::values::{one_of, parse, seconds};
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
    /// Wait until the joints are at rest at their targets, and the gripper is within 0.5 % of its stroke or has stopped for
    /// 1 s, for example at an object.
    #[arg(long)]
    wait: bool,
    /// Tolerance of a joint: a servo holds a load by its deviation.
    #[arg(long, value_name = "DEGREES", requires = "wait", default_value = "5.7", value_parser = within)]
    within: u16,
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
                    // A stop may have come just before it.
                    arm.check_refusal()?;
                    let request = Request::Move(target);
                    print_line(format_args!("sent: {request}"))?;
                    print_line(format_args!("now: {}", arm.read_joints()?))
                })
            }
        }
    }

    fn move_and_wait(&self, arm: &mut host::Ling, target: &Move) -> Result<(), Error> {
        let tolerances = Tolerances::within(self.within);
        let state = arm.move_and_wait(target, tolerances, self.timeout)?;
        let deviations = target.deviations(&state);
        match target.away(&state, &tolerances) {
            Some(off) => print_line(format_args!(
                "joints reached; {off} and has stopped: is it holding something? {state}"
            )),
            None if deviations.are_small() => print_line(format_args!("target reached: {state}")),
            None => print_line(format_args!("target reached: {state}; {deviations}")),
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

/// A tolerance in degrees, as ticks.
pub(crate) fn within(text: &str) -> Result<u16, String> {
    let degrees: f32 = parse(text, "a number")?;
    let ticks = degrees * f32::from(TICKS_PER_TURN) / 360.0;
    match (1.0..=f32::from(TICKS_PER_TURN)).contains(&ticks) {
        true => Ok(ticks.round() as u16),
        false => Err(format!("tolerance is {degrees} degrees, must be 0.09 to 360")),
    }
}
