//! `armwire call`: any one request, and what the arm answers.

mod alpha1;
mod ling;
mod xarm;

use std::io::{Write, stdout};

use armwire::OutOfRange;
use armwire::alpha1::Alpha1;
use armwire::ling::Ling;
use armwire::xarm::XArm;
use clap::{Args, Subcommand};

use crate::args::ArmPort;
use crate::describe::Arm;
use crate::error::Error;
use crate::legacy;
use crate::link::{Line, Link};

pub(crate) use alpha1::duration as seconds;
pub(crate) use ling::{Switch, Target};
pub(crate) use xarm::ask;

/// The arms there are.
#[derive(Subcommand)]
pub(crate) enum Call {
    /// Ask a Ling / Alicia-D arm.
    Ling(OnPort<ling::Ask>),
    /// Ask a UFACTORY xArm.
    Xarm(xarm::OnHost),
    /// Ask a UBTECH Alpha1, or its servos.
    Alpha1(OnPort<alpha1::Ask>),
}

/// A request, and the serial port it goes to.
#[derive(Args)]
pub(crate) struct OnPort<Ask: Subcommand> {
    #[command(flatten)]
    arm: ArmPort,
    #[command(subcommand)]
    ask: Ask,
}

impl Call {
    pub(crate) fn run(&self) -> Result<(), Error> {
        match self {
            Self::Ling(OnPort { arm, ask }) => call::<Ling>(legacy::open(&arm.connect()?)?, ask.request()),
            Self::Alpha1(OnPort { arm, ask }) => call::<Alpha1>(arm.connect()?.arm()?, ask.request()),
            Self::Xarm(xarm) => {
                // Before there is a connection, for the request may be none.
                let params = xarm.params();
                let request = xarm.request(&params).map_err(Error::Usage)?;
                let mut link = Link::connect(xarm.host())?;
                *link.messages_mut() = xarm.protocol();
                call::<XArm>(link, request)
            }
        }
    }
}

/// Sends the request and prints the answer.
fn call<P: Arm>(mut link: Link<P, impl Line>, request: P::Request<'_>) -> Result<(), Error> {
    let answer = link.call(request, |response| match P::refusal(&response) {
        None => Ok(P::show_response(&response)),
        Some(what) => Err(what),
    })?;
    let text = match answer {
        None => format!("{}: sent, the arm does not answer it", P::show_request(&request)),
        Some(Ok(text)) => text,
        Some(Err(what)) => return Err(Error::at(link.name(), what)),
    };
    writeln!(stdout(), "{text}").map_err(Error::Output)
}

/// A number from the command line.
fn number(text: &str) -> Result<f32, String> {
    text.trim().parse().map_err(|_| format!("'{text}' is not a number"))
}

/// A value that was typed in another unit than the protocol's, with the errors in the unit in which it was typed.
fn scaled<T>(
    typed: f32,
    unit: &'static str,
    scale: f32,
    make: impl Fn(f32) -> Result<T, OutOfRange<f32>>,
) -> Result<T, String> {
    make(typed * scale).map_err(|error| {
        let (min, max) = (error.min / scale, error.max / scale);
        let error = OutOfRange {
            unit,
            got: typed,
            min,
            max,
            ..error
        };
        error.to_string()
    })
}
