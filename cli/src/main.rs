//! `armwire`: virtual arms, and a look at real ones, from the command line.
#![forbid(unsafe_code)]

mod decode;
mod describe;
mod info;
mod link;
mod monitor;
mod problem;
#[cfg(unix)]
mod sim;

use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::{Args, Parser, Subcommand};

use problem::Problem;

/// Virtual robot arms, and a look at real ones.
#[derive(Parser)]
#[command(name = "armwire", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Serve a virtual arm that any serial program can open.
    #[cfg(unix)]
    #[command(subcommand)]
    Sim(sim::Sim),
    /// Tell what arm is on a port, and how it is.
    Info(Port),
    /// Watch an arm's joints, gripper and status.
    Monitor(monitor::Monitor),
    /// Tell the frames in a recording of a line, what they mean, and what is between them.
    Decode(decode::Decode),
}

/// The port an arm is on.
#[derive(Args)]
struct Port {
    /// The serial port, such as /dev/ttyACM0 or COM3.
    port: String,
    /// Its baud rate.
    #[arg(long, default_value_t = 1_000_000, value_parser = clap::value_parser!(u32).range(1..))]
    baud: u32,
}

fn main() -> ExitCode {
    match run(&Cli::parse().command) {
        Ok(()) => ExitCode::SUCCESS,
        // Who no longer reads what we print has had enough.
        Err(Problem::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(problem) => {
            eprintln!("armwire: {problem}");
            ExitCode::FAILURE
        }
    }
}

fn run(command: &Command) -> Result<(), Problem> {
    match command {
        #[cfg(unix)]
        Command::Sim(sim) => sim.run(stop_on_ctrl_c()?),
        Command::Info(port) => info::run(port),
        Command::Monitor(monitor) => monitor.run(stop_on_ctrl_c()?),
        Command::Decode(decode) => decode.run(),
    }
}

/// A flag that Ctrl-C, or a request to terminate, sets.
fn stop_on_ctrl_c() -> Result<&'static AtomicBool, Problem> {
    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).map_err(Problem::Signals)?;
    Ok(&STOP)
}
