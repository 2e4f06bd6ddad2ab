//! `armwire`: virtual arms, and real ones to look at and talk to, from the command line.
#![forbid(unsafe_code)]
// They panic when nobody reads any more.
#![deny(clippy::print_stdout, clippy::print_stderr)]

mod adapter;
mod call;
mod can;
mod config;
mod control;
mod counters;
mod decode;
mod describe;
mod held;
mod hex;
mod hold;
mod info;
mod link;
mod monitor;
mod motion;
mod older;
mod port;
mod printable;
mod problem;
mod serial;
#[cfg(unix)]
mod sim;
mod tcp;
mod update;

use std::fmt::Display;
use std::io::{Write, stderr};
use std::num::NonZeroU32;
use std::process::ExitCode;
use std::sync::atomic::{AtomicBool, Ordering};

use clap::error::{ContextKind, ContextValue, ErrorKind};
use clap::{Args, CommandFactory, Parser, Subcommand, ValueEnum};

pub use decode::{Speaker, decode};

use control::ControlLink;
use port::{Connection, Port};
use printable::escaped;
use problem::Problem;
use tcp::Host;

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
    /// Make one request and print the answer.
    #[command(subcommand)]
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

/// Where an arm is, and which it is.
#[derive(Args)]
struct Place {
    /// The serial port, such as /dev/ttyACM0 or COM3; or tcp:HOST:PORT, a server of one; or slcan:PORT@BITRATE/NODE, an
    /// adapter on the bus of an SLCAN adapter; or can:IFACE/NODE, on a CAN bus of Linux. For xarm the host, such as
    /// 192.168.1.10 or 192.168.1.10:502.
    port: String,
    /// Which arm it is.
    #[arg(long, value_enum, default_value_t)]
    arm: ArmKind,
    #[command(flatten)]
    baud: Baud,
    /// The adapter's control port, where it cannot be found from the arm's port, as that of a virtual board:
    /// control:PORT, or PORT alone.
    #[arg(long, value_name = "PORT", value_parser = Port::of_control)]
    control: Option<Port>,
}

impl Place {
    /// What any other arm is on.
    fn connect(&self) -> Result<Connection, Problem> {
        let port: Port = self.port.parse().map_err(Problem::Usage)?;
        port.connect(self.baud.baud)
    }

    /// The control port of the adapter there.
    fn control(&self, connection: &Connection) -> Result<ControlLink, Problem> {
        match &self.control {
            Some(port) => port.connect(None)?.control(),
            None => connection.control(),
        }
    }

    /// The host that an xArm is on.
    fn host(&self) -> Result<Host, Problem> {
        let refused = |option| Err(Problem::Usage(format!("an xarm is on a host, which has no {option}")));
        match (self.baud.baud, &self.control) {
            (None, None) => self.port.parse().map_err(Problem::Usage),
            (Some(_), _) => refused("--baud"),
            (None, Some(_)) => refused("--control"),
        }
    }
}

/// The baud rate of a serial port.
#[derive(Args)]
struct Baud {
    /// Baud rate of the serial port; 1000000 for ling and 115200 for alpha1 unless you say otherwise; a ling arm of the
    /// older generation may need 921600.
    #[arg(long)]
    baud: Option<NonZeroU32>,
}

/// The arms there are.
#[derive(Clone, Copy, Debug, Default, ValueEnum)]
pub enum ArmKind {
    /// Ling / Alicia-D, on a serial port.
    #[default]
    Ling,
    /// UFACTORY xArm, on TCP.
    Xarm,
    /// UBTECH Alpha1, on a serial port.
    Alpha1,
}

/// Does what the command line says.
pub fn main() -> ExitCode {
    let cli = Cli::try_parse().unwrap_or_else(|error| with_names(error).exit());
    match run(&cli.command) {
        Ok(()) => ExitCode::SUCCESS,
        // Who no longer reads what we print has had enough.
        Err(Problem::Output(error)) if error.kind() == std::io::ErrorKind::BrokenPipe => ExitCode::SUCCESS,
        Err(Problem::Usage(text)) => Cli::command().error(ErrorKind::ValueValidation, text).exit(),
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

fn run(command: &Command) -> Result<(), Problem> {
    match command {
        #[cfg(unix)]
        Command::Sim(sim) => sim.run(stop_on_ctrl_c()?),
        Command::Info(place) => info::run(place),
        Command::Monitor(monitor) => monitor.run(stop_on_ctrl_c()?),
        Command::Call(call) => call.run(),
        Command::Move(motion) => motion.run(),
        Command::Torque(torque) => torque.run(),
        Command::Decode(decode) => decode.run(),
        Command::Config(config) => config.run(),
        Command::Counters(counters) => counters.run(),
        Command::Hold(hold) => hold.run(stop_on_ctrl_c()?),
        Command::Update(update) => update.run(),
    }
}

/// Tells what is wrong where it does not get into the data. That nobody reads it is no other problem.
fn complain(what: &impl Display) {
    let _ = writeln!(stderr(), "armwire: {}", escaped(&what.to_string()));
}

/// A flag that Ctrl-C, or a request to terminate, sets.
fn stop_on_ctrl_c() -> Result<&'static AtomicBool, Problem> {
    static STOP: AtomicBool = AtomicBool::new(false);
    ctrlc::set_handler(|| STOP.store(true, Ordering::Relaxed)).map_err(Problem::Signals)?;
    Ok(&STOP)
}
