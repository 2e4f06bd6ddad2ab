//! `armwire sim`: a virtual arm that any serial program can open.

use std::io::{Write, stdout};
use std::path::PathBuf;
use std::str::FromStr;
use std::sync::atomic::AtomicBool;

use armwire::Micros;
use armwire::ling::{Kind, SerialNumber, Stroke};
use armwire_sim::faults::{Line, Rates};
use armwire_sim::ling::{Config, LingArm};
use armwire_sim::pty::Pty;
use armwire_sim::serve::serve;
use clap::{Args, Subcommand, ValueEnum};

use crate::problem::Problem;

/// The arms there are.
#[derive(Subcommand)]
pub(crate) enum Sim {
    /// A Ling (Alicia-D) arm.
    Ling(LingSim),
}

/// The arguments of `armwire sim ling`.
#[derive(Args)]
pub(crate) struct LingSim {
    /// Where programs find it: a symbolic link that is made, and removed at the end. Without it the system picks a name.
    #[arg(long, value_name = "PATH")]
    pty: Option<PathBuf>,
    /// A leader arm: six servos, moved by hand. Without it a follower: ten servos.
    #[arg(long)]
    leader: bool,
    /// Serial number, 16 characters.
    #[arg(long, value_parser = parse_serial)]
    serial: Option<SerialNumber>,
    /// Gripper stroke in millimetres: 50, 75 or 100.
    #[arg(long, default_value = "50", value_parser = parse_stroke)]
    stroke: Stroke,
    /// From the end of a request to the start of its answer, in microseconds.
    #[arg(long, value_name = "N", default_value_t = 200)]
    turnaround_us: u64,
    /// Give every byte back at once, as a half-duplex adapter does.
    #[arg(long)]
    echo: bool,
    /// Faults on the line, in bytes per million: one number for every kind, or such as 'drop=100,corrupt=5000'; kinds
    /// are drop, corrupt, duplicate, delay, noise.
    #[arg(long, value_name = "FAULTS", default_value = "0")]
    faults: FaultRates,
    /// Which bytes meet them.
    #[arg(long, value_enum, default_value_t = FaultsOn::Both)]
    faults_on: FaultsOn,
    /// The same seed makes the same faults.
    #[arg(long, value_name = "N", default_value_t = 1)]
    seed: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FaultsOn {
    Both,
    Requests,
    Answers,
}

#[derive(Clone, Copy)]
struct FaultRates(Rates);

impl FromStr for FaultRates {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let ppm = |text: &str| match text.parse() {
            Ok(ppm @ 0..=1_000_000) => Ok(ppm),
            _ => Err(format!("'{text}' is not a number from 0 to 1000000")),
        };
        if !text.contains('=') {
            return ppm(text).map(|ppm| Self(Rates::each(ppm)));
        }
        let mut rates = Rates::NONE;
        for part in text.split(',') {
            let (kind, rate) = part
                .split_once('=')
                .ok_or(format!("'{part}' is not such as drop=100"))?;
            let field = match kind {
                "drop" => &mut rates.drop,
                "corrupt" => &mut rates.corrupt,
                "duplicate" => &mut rates.duplicate,
                "delay" => &mut rates.delay,
                "noise" => &mut rates.noise,
                _ => return Err(format!("'{kind}' is none of drop, corrupt, duplicate, delay, noise")),
            };
            *field = ppm(rate)?;
        }
        Ok(Self(rates))
    }
}

fn parse_serial(text: &str) -> Result<SerialNumber, String> {
    let bytes = text.as_bytes().try_into();
    bytes
        .map(SerialNumber)
        .map_err(|_| format!("it has {} bytes, not 16", text.len()))
}

fn parse_stroke(text: &str) -> Result<Stroke, String> {
    match text {
        "50" => Ok(Stroke::Mm50),
        "75" => Ok(Stroke::Mm75),
        "100" => Ok(Stroke::Mm100),
        _ => Err("there are 50, 75 and 100".to_owned()),
    }
}

impl Sim {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Problem> {
        match self {
            Self::Ling(sim) => sim.run(stop),
        }
    }
}

impl LingSim {
    fn run(&self, stop: &AtomicBool) -> Result<(), Problem> {
        let base = if self.leader {
            Config::leader()
        } else {
            Config::follower()
        };
        let config = Config {
            serial: self.serial.unwrap_or(base.serial),
            stroke: self.stroke,
            turnaround: Micros(self.turnaround_us),
            echo: self.echo,
            ..base
        };
        let name = match config.kind {
            Kind::Leader => "leader",
            Kind::Follower => "follower",
        };
        let serial = config.serial;
        let rates = |without| {
            if self.faults_on == without {
                Rates::NONE
            } else {
                self.faults.0
            }
        };
        let (to_arm, from_arm) = (rates(FaultsOn::Answers), rates(FaultsOn::Requests));
        let mut line = Line::new(LingArm::new(config), to_arm, from_arm, self.seed);

        let pty = Pty::open(self.pty.as_deref()).map_err(Problem::Serve)?;
        say(format_args!(
            "Ling {name} {serial} is at {}; Ctrl-C ends it.",
            pty.path().display()
        ))?;
        let served = serve(&mut line, &pty, stop).map_err(Problem::Serve)?;

        let heard = line.device().counters();
        say(format_args!(
            "{} bytes in, {} out, {} not read; {} requests ({} answered, {} refused), {} unknown frames, {} noise bytes.",
            served.received,
            served.sent,
            served.lost,
            heard.requests,
            heard.answered,
            heard.refused,
            heard.unknown,
            heard.noise_bytes
        ))
    }
}

fn say(text: std::fmt::Arguments<'_>) -> Result<(), Problem> {
    let mut out = stdout().lock();
    writeln!(out, "{text}")
        .and_then(|()| out.flush())
        .map_err(Problem::Output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_rates_are_one_number_or_named() {
        let rates = |text: &str| text.parse::<FaultRates>().map(|rates| rates.0);
        assert_eq!(rates("100"), Ok(Rates::each(100)));
        let named = Rates {
            drop: 1,
            noise: 2,
            ..Rates::NONE
        };
        assert_eq!(rates("drop=1,noise=2"), Ok(named));
        for wrong in ["", "x", "-1", "1000001", "drop", "drop=", "gremlins=1", "drop=1,2"] {
            assert!(rates(wrong).is_err(), "{wrong}");
        }
    }
}
