//! `armwire stop`: stops an arm.

use armwire::alpha1;
use armwire::ling::Opening;
use armwire::ling::stop::{Grip, Stopped};
use armwire_bridge::control::STOP_MS;
use armwire_host::{Connection, Error as Host, Ling, NoControl};
use clap::Args;

use super::show;
use crate::args::{LiveArm, Place};
use crate::call::call;
use crate::call::ling::opening;
use crate::error::Error;
use crate::output::{print_error, print_line};

/// The arguments of `armwire stop`.
#[derive(Args)]
pub(crate) struct StopArm {
    #[command(flatten)]
    place: Place,
    /// Opening of the gripper that was sent last, in percent of its stroke. Without it the gripper stays at its reading,
    /// and a grip may loosen.
    #[arg(long, value_name = "PERCENT", allow_hyphen_values = true, value_parser = opening)]
    gripper: Option<Opening>,
    /// Hold the arm at its reading, not at its last goal: an arm that presses against something gives way. The request
    /// goes by the arm's port: an adapter holds the last goal.
    #[arg(long = "yield")]
    yields: bool,
}

impl StopArm {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let reason = match self.place.arm {
            LiveArm::Xarm => Some("armwire has no request that stops an xarm: press its emergency stop"),
            LiveArm::LingLegacy => Some(
                "nothing is sent to an arm of the older generation, which has no request that stops it: switch its supply \
                 off, the arm falls",
            ),
            LiveArm::Ling | LiveArm::Alpha1 => None,
        };
        if let Some(reason) = reason {
            return Err(Error::refused(&self.place.port, reason));
        }
        self.stop().map_err(|error| match error {
            Error::Host(Host::InUse { name, user }) => {
                let cause = format!(
                    "the port is in use by {user}: only Ctrl-C there, or the switch of the arm's supply, stops the arm"
                );
                Host::NotStopped {
                    name,
                    cause: cause.into(),
                }
                .into()
            }
            error => error,
        })
    }

    fn stop(&self) -> Result<(), Error> {
        let connection = self.place.connect()?;
        match !self.yields && self.by_adapter(&connection)? {
            true => Ok(()),
            false => self
                .on_line(&connection)
                .map_err(|error| error.explained(|error| connection.explain(error))),
        }
    }

    /// Stops the arm by the adapter's own request, whatever else runs. Returns false without an adapter that can.
    fn by_adapter(&self, connection: &Connection) -> Result<bool, Error> {
        let stopped = connection.adapter().and_then(|mut control| control.stop());
        match stopped {
            Ok(()) => {}
            Err(Host::NoControl {
                reason: NoControl::NoAdapter,
                ..
            }) if self.place.control.is_none() => return Ok(false),
            // The adapter has decided, or there is no other way.
            Err(error @ (Host::NotStopped { .. } | Host::Refused { .. })) => return Err(error.into()),
            Err(error) if connection.is_control() => return Err(error.into()),
            Err(error) => {
                print_error(&format_args!("{}; trying the arm's port", Error::from(error)));
                return Ok(false);
            }
        }
        if self.gripper.is_some() {
            let reason = "the adapter sends the last goal of the gripper on the line, and not --gripper";
            print_error(&format_args!("{}: {reason}", self.place.port));
        }
        print_line(format_args!(
            "the adapter holds the arm unless its torque is off, and refuses the motion of every host for {} s",
            STOP_MS / 1_000
        ))?;
        Ok(true)
    }

    /// Stops the arm by requests on its line.
    fn on_line(&self, connection: &Connection) -> Result<(), Error> {
        match self.place.arm {
            LiveArm::Alpha1 if self.yields => Err(Error::Usage("--yield does not apply to an alpha1".to_owned())),
            LiveArm::Alpha1 if self.gripper.is_some() => {
                Err(Error::Usage("--gripper does not apply to an alpha1".to_owned()))
            }
            LiveArm::Alpha1 => call(connection.alpha1()?.link(), &alpha1::Request::Stop, false),
            LiveArm::Ling | LiveArm::LingLegacy | LiveArm::Xarm => self.ling(&mut connection.ling()?),
        }
    }

    fn ling(&self, arm: &mut Ling) -> Result<(), Error> {
        // Here no goal is known: the arm yields.
        let stopped = arm.stop(self.gripper)?;
        print_line(show(&stopped))?;
        if let Stopped::AtRest {
            grip: Grip::Reading, ..
        } = stopped
        {
            print_error(&format_args!(
                "{}: the gripper's goal is now its reading: a grip may have loosened (--gripper sets the goal)",
                arm.name()
            ));
        }
        Ok(())
    }
}
