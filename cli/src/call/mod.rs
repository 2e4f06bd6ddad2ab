//! `armwire call`: one request of any kind, and its answer.

mod alpha1;
pub(crate) mod ling;
pub(crate) mod values;
mod xarm;

use armwire::ling::{Ling, Request};
use armwire_host::Link;
use armwire_host::describe::{Arm, Fact, line, object};
use clap::{Args, Subcommand};
use serde_json::json;

use crate::args::ArmPort;
use crate::error::Error;
use crate::output::{print_json, print_line};
use crate::stop::stoppable;

/// The arguments of `armwire call`.
#[derive(Args)]
pub(crate) struct Call {
    /// Print the answer as one JSON object, with the units in the names.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    arm: ToArm,
}

/// The kinds of arms.
#[derive(Subcommand)]
enum ToArm {
    /// Send a request to a Ling / Alicia-D arm.
    Ling(OnPort<ling::Command>),
    /// Send a request to a UFACTORY xArm.
    Xarm(xarm::OnHost),
    /// Send a request to a UBTECH Alpha1, or to its servos.
    #[command(after_help = "For a HID device, PORT is hid:. If there are several: hid:VID:PID or hid:NAME.")]
    Alpha1(OnPort<alpha1::Command>),
}

/// A request and its serial port.
#[derive(Args)]
struct OnPort<Command: Subcommand> {
    #[command(flatten)]
    arm: ArmPort,
    #[command(subcommand)]
    command: Command,
}

impl Call {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let json = self.json;
        match &self.arm {
            ToArm::Ling(OnPort { arm, command }) => {
                let mut arm = stoppable::open(arm)?;
                let called = command.request(&mut arm).and_then(|request| match request {
                    Request::Move(target) => {
                        let (gripper, _speed) = target.gripper;
                        arm.check_refusal()?;
                        arm.stop_if_interrupted(gripper, |arm| call(arm.link(), &request, json))
                    }
                    _ => match ling::answer_of_leader(&request, &mut arm)? {
                        Some(answer) => {
                            let extra = Ling::extra_fact(arm.frame());
                            let answer = (answer.to_string(), Ling::facts(&answer));
                            print(answer, extra.into_iter().collect(), json)
                        }
                        None => call(arm.link(), &request, json),
                    },
                });
                called.map_err(|error| error.explained(|error| arm.explain(error)))
            }
            ToArm::Alpha1(OnPort { arm, command }) => {
                let mut robot = arm.connect()?.alpha1()?;
                let called = call(robot.link(), &command.request(), json);
                called.map_err(|error| error.explained(|error| robot.explain(error)))
            }
            ToArm::Xarm(xarm) => {
                // Before there is a connection, for the request may be none.
                let params = xarm.params();
                let request = xarm.request(&params).map_err(Error::Usage)?;
                call(xarm.connect()?.link(), &request, json)
            }
        }
    }
}

/// Sends the request and prints the answer.
pub(crate) fn call<P: Arm>(link: &mut Link<P>, request: &P::Request<'_>, json: bool) -> Result<(), Error> {
    let answer = link.call(request, |response| {
        let answer = match P::refusal(&response) {
            None => Ok((response.to_string(), P::facts(&response))),
            Some(reason) => Err(reason),
        };
        (answer, P::follow_up(&response))
    })?;
    let Some((answer, follow_up)) = answer else {
        return match json {
            true => print_json(&json!({ "sent": request.to_string() })),
            false => print_line(format_args!("{request}: sent, the arm does not answer it")),
        };
    };
    let extra = P::extra_fact(link.frame());
    let answer = match answer {
        Ok(answer) => answer,
        Err(reason) => return Err(link.refused(&reason, follow_up).into()),
    };
    let more = extra.into_iter().chain(link.explain(follow_up)).collect();
    print(answer, more, json)
}

/// Prints an answer, which is its text and its facts, with more facts.
fn print((text, mut facts): (String, Vec<Fact>), more: Vec<Fact>, json: bool) -> Result<(), Error> {
    match (json, &more[..]) {
        (true, _) => {
            facts.extend(more);
            print_json(&object(&facts).into())
        }
        (false, []) => print_line(text),
        (false, more) => print_line(format_args!("{text}, {}", line(more))),
    }
}
