//! `armwire`: inspect, monitor and control robot arms, real or simulated, from the command line.
// docs.rs shows the feature that an item needs. This is unstable, and used there only.
#![cfg_attr(docsrs, feature(doc_cfg))]
#![forbid(unsafe_code)]
// `println!` panics on a closed pipe.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod adapter;
mod args;
mod bench;
mod bus;
mod call;
mod config;
mod confirm;
mod counters;
mod decode;
mod error;
mod hex;
mod ids;
mod info;
mod list;
mod monitor;
mod motion;
mod new_file;
mod output;
mod park;
mod printable;
mod record;
mod recording;
mod remedies;
#[cfg(feature = "recordings")]
mod replay;
mod reserve;
#[cfg(feature = "selftest")]
pub mod selftest;
mod signals;
mod sim;
mod status;
mod stop;
mod teleop;
mod update;

use std::ffi::OsString;
use std::io::{Write, stdout};
#[cfg(feature = "shell")]
use std::path::PathBuf;
use std::process::ExitCode;

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{CommandFactory, FromArgMatches, Parser, Subcommand};
#[cfg(feature = "shell")]
use clap_complete::Shell;
use terminal_size::Width;

pub use args::{ArmKind, Speaker};
pub use decode::decode;

use error::Error;
use output::print_error;

/// Inspect, monitor and control robot arms, real or simulated.
#[derive(Parser)]
#[command(name = "armwire", version)]
struct Cli {
    #[command(subcommand)]
    command: Command,
}

#[derive(Subcommand)]
enum Command {
    /// Run a virtual arm on a pseudo-terminal or on TCP ports.
    #[command(subcommand)]
    Sim(sim::Sim),
    /// Identify the adapter and the arm on a port, and show the arm's state.
    Info(info::Info),
    /// List the ports of this computer, and the adapters and arms on them.
    List(list::List),
    /// Show an arm's joints, temperatures and status live. For an Alpha1: the running servos.
    ///
    /// On a terminal the output is a full screen, otherwise a line per reading. See also --csv and --json.
    Monitor(monitor::Monitor),
    /// Record an arm to an MCAP file, as 'monitor --mcap' does: moved by hand with the torque off, or by another program.
    Record(record::Record),
    /// Replay a recording on a Ling arm. The arm goes slowly to the first pose and moves at once: keep clear of it.
    #[cfg(feature = "recordings")]
    Replay(replay::Replay),
    /// Let a Ling follower follow a leader that is moved by hand. The follower moves at once: keep clear of it.
    Teleop(teleop::Teleop),
    /// Move the joints and the gripper of a Ling arm. The arm moves at once: keep clear of it.
    Move(motion::MoveArm),
    /// Stop an arm. The torque stays on. Not an emergency stop: keep a switch in the arm's supply.
    Stop(stop::command::StopArm),
    /// Switch a Ling arm's torque on or off. With torque off the arm falls: hold it.
    Torque(motion::SetTorque),
    /// Move a Ling arm slowly to the pose in which it lies, and switch its torque off there. The arm moves at once: keep
    /// clear of it.
    ///
    /// The joints go at 20°/s at most, and arrive together. Where the arm does not arrive, and after Ctrl-C, it is stopped,
    /// and its torque stays on.
    Park(park::Park),
    /// Set a Ling arm's current pose as its zero position. The torque goes off and the arm falls: hold it.
    SetZero(motion::SetZero),
    /// Measure how long a program waits for an arm's pose, and how old the pose is.
    ///
    /// At each rate a program first reads and waits for the answer; then a reader reads in a thread, and the program takes
    /// its newest pose. Prints the duration of the calls.
    Bench(bench::Bench),
    /// Show the health of a bus of Feetech servos, as of an SO-101: lost, late and damaged answers, errors, settings that
    /// differ. It only reads, and moves nothing.
    Bus(bus::Bus),
    /// Send one request and print the answer.
    Call(call::Call),
    /// Decode a recording: frames, their meaning, stray bytes.
    Decode(decode::Decode),
    /// Show or change an adapter's configuration.
    Config(config::Configure),
    /// Show an adapter's counters and latencies.
    Counters(counters::Counters),
    /// Reserve the arm's line for USB until Ctrl-C: no polls, no CAN, no torque-off. For updates of the arm's own
    /// firmware.
    Reserve(reserve::Reserve),
    /// Test an adapter board with a jumper from TX to RX in place of the arm. Takes two minutes.
    #[cfg(feature = "selftest")]
    Selftest(selftest::command::Selftest),
    /// Update an adapter's firmware, over USB: with dfu-util, or the drive of a Raspberry Pi Pico.
    Update(update::Update),
    /// Print a shell completion script.
    #[cfg(feature = "shell")]
    Completions {
        /// Shell.
        shell: Shell,
    },
    /// Write the manual pages into a folder.
    #[cfg(feature = "shell")]
    Man {
        /// Folder. It is created if it does not exist.
        folder: PathBuf,
    },
}

/// Runs the command line of this process.
pub fn main() -> ExitCode {
    run_from(&std::env::args_os().collect::<Vec<_>>()).into()
}

/// Runs a command line, which begins with the program's name. Prints errors, and returns the exit status: 0 without any.
pub fn run_from(args: &[OsString]) -> u8 {
    let parsed = command()
        .try_get_matches_from(args)
        .and_then(|matches| Cli::from_arg_matches(&matches));
    let result = match parsed {
        Ok(cli) => run(&cli.command).map(|()| 0),
        Err(error) => answer(&with_names(error, args)),
    };
    match result {
        Ok(status) => status,
        // The reader of the output is gone, as with `| head`: this is no error.
        Err(Error::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => 0,
        Err(error) => {
            print_error(&error);
            error.status()
        }
    }
}

/// The commands, with a help as wide as the terminal, or 80 columns where its width is unknown.
fn command() -> clap::Command {
    /// On a narrower terminal a second column would have a word in each line.
    const TWO_COLUMNS: u16 = 60;
    let command = with_negative_numbers(Cli::command());
    match terminal_size::terminal_size() {
        Some((Width(width), _)) => command.next_line_help(width < TWO_COLUMNS),
        None if std::env::var_os("COLUMNS").is_none() => command.term_width(80),
        None => command,
    }
}

/// Takes `-1` for a number, which an option then refuses with its range, and not for an unknown option.
fn with_negative_numbers(command: clap::Command) -> clap::Command {
    command
        .allow_negative_numbers(true)
        .mut_subcommands(with_negative_numbers)
}

/// Prints the help or the version that the arguments ask for, or what is wrong with them. Returns the exit status.
fn answer(error: &clap::Error) -> Result<u8, Error> {
    let printed = error.print().and_then(|()| stdout().flush());
    match error.use_stderr() {
        true => Ok(error.exit_code() as u8),
        false => printed.map(|()| 0).map_err(Error::Output),
    }
}

/// The error with the names there are, where a request or the like was expected: behind a port clap takes a wrong one
/// for an argument too many.
fn with_names(error: clap::Error, args: &[OsString]) -> clap::Error {
    let wrong = match (error.kind(), error.get(ContextKind::InvalidArg)) {
        (ErrorKind::UnknownArgument, Some(ContextValue::String(wrong))) if !wrong.starts_with('-') => wrong,
        _ => return error,
    };
    let mut cli = command();
    cli.build();
    let mut command = &mut cli;
    for arg in args.iter().skip(1) {
        if command.find_subcommand(arg).is_some() {
            command = command.find_subcommand_mut(arg).expect("it was found");
        }
    }
    let names: Vec<_> = command.get_subcommands().map(clap::Command::get_name).collect();
    if names.is_empty() {
        return error;
    }
    let text = format!("'{wrong}' is unknown, expected one of: {}", names.join(", "));
    command.error(ErrorKind::InvalidSubcommand, text)
}

fn run(command: &Command) -> Result<(), Error> {
    match command {
        Command::Sim(sim) => sim.run(signals::catch()?),
        Command::Info(info) => info.run(),
        Command::List(list) => list.run(),
        Command::Monitor(monitor) => monitor.run(signals::catch()?),
        Command::Record(record) => record.run(signals::catch()?),
        Command::Bench(bench) => bench.run(),
        #[cfg(feature = "recordings")]
        Command::Replay(replay) => replay.run(),
        Command::Teleop(teleop) => teleop.run(),
        Command::Bus(bus) => bus.run(signals::catch()?),
        Command::Call(call) => call.run(),
        Command::Move(motion) => motion.run(),
        Command::Stop(stop) => stop.run(),
        Command::Park(park) => park.run(),
        Command::Torque(torque) => torque.run(),
        Command::SetZero(zero) => zero.run(),
        Command::Decode(decode) => decode.run(),
        Command::Config(config) => config.run(),
        Command::Counters(counters) => counters.run(),
        Command::Reserve(reserve) => reserve.run(signals::catch()?),
        #[cfg(feature = "selftest")]
        Command::Selftest(selftest) => selftest.run(signals::catch()?),
        Command::Update(update) => update.run(),
        #[cfg(feature = "shell")]
        Command::Completions { shell } => {
            let mut script = Vec::new();
            clap_complete::generate(*shell, &mut Cli::command(), "armwire", &mut script);
            output::print(&String::from_utf8_lossy(&script))
        }
        #[cfg(feature = "shell")]
        Command::Man { folder } => std::fs::create_dir_all(folder)
            .and_then(|()| clap_mangen::generate_to(Cli::command(), folder))
            .map_err(|error| Error::at(&folder.display().to_string(), error)),
    }
}
