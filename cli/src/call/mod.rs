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

use crate::describe::Arm;
use crate::link::{Line, Link};
use crate::port::Port;
use crate::problem::Problem;
use crate::{Baud, older};

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
    /// The serial port, such as /dev/ttyACM0 or COM3; or tcp:HOST:PORT, a server of one; or slcan:PORT@BITRATE/NODE, an
    /// adapter on the bus of an SLCAN adapter; or can:IFACE/NODE, on a CAN bus of Linux.
    port: Port,
    #[command(flatten)]
    baud: Baud,
    #[command(subcommand)]
    ask: Ask,
}

impl Call {
    pub(crate) fn run(&self) -> Result<(), Problem> {
        match self {
            Self::Ling(OnPort { port, baud, ask }) => {
                call::<Ling>(older::open(&port.connect(baud.baud)?)?, ask.request())
            }
            Self::Alpha1(OnPort { port, baud, ask }) => call::<Alpha1>(port.connect(baud.baud)?.arm()?, ask.request()),
            Self::Xarm(xarm) => {
                // Before there is a connection, for the request may be none.
                let params = xarm.params();
                let request = xarm.request(&params).map_err(Problem::Usage)?;
                let mut link = Link::connect(xarm.host())?;
                *link.messages_mut() = xarm.protocol();
                call::<XArm>(link, request)
            }
        }
    }
}

/// Sends the request and prints the answer.
fn call<P: Arm>(mut link: Link<P, impl Line>, request: P::Request<'_>) -> Result<(), Problem> {
    let answer = link.call(request, |response| match P::refusal(&response) {
        None => Ok(P::show_response(&response)),
        Some(what) => Err(what),
    })?;
    let text = match answer {
        None => format!("{}: sent, the arm does not answer it", P::show_request(&request)),
        Some(Ok(text)) => text,
        Some(Err(what)) => {
            let name = link.name().to_owned();
            return Err(Problem::Refused { name, what });
        }
    };
    writeln!(stdout(), "{text}").map_err(Problem::Output)
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
