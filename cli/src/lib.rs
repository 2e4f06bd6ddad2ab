//! `armwire`: virtual arms, and real ones to look at and talk to, from the command line.
#![forbid(unsafe_code)]
// They panic when nobody reads any more.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod adapter;
mod args;
mod available;
mod call;
mod can;
mod config;
mod confirm;
mod control;
mod counters;
mod decode;
mod describe;
mod error;
mod heard;
mod hex;
mod hold;
mod info;
mod legacy;
mod line_holder;
mod link;
mod monitor;
mod motion;
mod output;
mod port;
mod printable;
mod serial;
#[cfg(unix)]
mod sim;
mod tcp;
mod update;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, Parser, Subcommand};

pub use args::ArmKind;
pub use decode::{Speaker, decode};

use args::Place;
use error::Error;
use output::complain;

/// Virtual robot arms, and real ones to look at and talk to.
#[derive(Parser)]
#[command(name = "armwire", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Serve a virtual arm, for any program that talks to a real one.
    #[cfg(unix)]
    #[command(subcommand)]
    Sim(sim::Sim),
    /// Tell what adapter and what arm are on a port, and how the arm is.
    Info(Place),
    /// Watch an arm's joints, temperatures and status; of an alpha1, which servos run.
    ///
    /// A full screen on a terminal, a line for each reading otherwise; see --csv and --json.
    Monitor(monitor::Monitor),
    /// Move the joints and the gripper of a Ling arm. The arm moves at once: keep clear of it.
    Move(motion::MoveArm),
    /// Switch a Ling arm's torque on or off. With torque off the arm falls: hold it.
    Torque(motion::SetTorque),
    /// Make a Ling arm's pose its zero position. Its torque goes off and the arm falls: hold it.
    SetZero(motion::SetZero),
    /// Make one request and print the answer.
    Call(call::Call),
    /// Tell the frames in a recording of a line, what they mean, and what is between them.
    Decode(decode::Decode),
    /// Show or change what an adapter is told to be.
    Config(config::Configure),
    /// Show all that an adapter has counted, and how long things took.
    Counters(counters::Counters),
    /// Hold the line to the arm for USB alone, until Ctrl-C: no polls, no CAN, no torque-off. For updates of the arm's own
    /// firmware.
    Hold(hold::Hold),
    /// Give an adapter another firmware, over USB with dfu-util.
    Update(update::Update),
}

/// Does what the command line says.
pub fn main() -> ExitCode {
    let cli = Cli::try_parse().unwrap_or_else(|error| with_names(error).exit());
    match run(&cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        // Who no longer reads what we print has had enough.
        Err(Error::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(Error::Usage(text)) => Cli::command().error(ErrorKind::ValueValidation, text).exit(),
        Err(problem) => {
            complain(&problem);
            ExitCode::FAILURE
        }
    }
}

/// The error with the names there are, where a request or the like was expected: behind a port clap takes a wrong one
/// for an argument too many.
fn with_names(error: clap::Error) -> clap::Error {
    let wrong = match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::UnknownArgument, Some(ContextValue::String(wrong))) if !wrong.starts_with('-') => wrong,
        _ => return error,
    };
    let mut cli = Cli::command();
    cli.build();
    let mut command = &mut cli;
    for arg in std::env::args_os().skip(1) {
        if command.find_subcommand(&arg).is_some() {
            command = command.find_subcommand_mut(&arg).expect("it was found");
        }
    }
    let names: Vec<_> = command.get_subcommands().map(clap::Command::get_name).collect();
    if names.is_empty() {
        return error;
    }
    let text = format!("'{wrong}' is none of these: {}", names.join(", "));
    command.error(ErrorKind::InvalidSubcommand, text)
}

fn run(command: &Command) -> Result<(), Error> {
    match command {
        #[cfg(unix)]
        Command::Sim(sim) => sim.run(stop_on_ctrl_c()?),
        Command::Info(place) => info::run(place),
        Command::Monitor(monitor) => monitor.run(stop_on_ctrl_c()?),
        Command::Call(call) => call.run(),
        Command::Move(motion) => motion.run(),
        Command::Torque(torque) => torque.run(),
        Command::SetZero(zero) => zero.run(),
        Command::Decode(decode) => decode.run(),
        Command::Config(config) => config.run(),
        Command::Counters(counters) => counters.run(),
        Command::Hold(hold) => hold.run(stop_on_ctrl_c()?),
        Command::Update(update) => update.run(),
    }
}

/// A flag that Ctrl-C, or a request to terminate, sets.
fn stop_on_ctrl_c() -> Result<&'static AtomicBool, Error> {
    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).map_err(Error::Signals)?;
    Ok(&STOP)
}
