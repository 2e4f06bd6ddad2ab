//! A virtual device on a pseudo-terminal, behind a line with faults.

use std::fmt::Display;
use std::io;
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use armwire_sim::faults::{Line, Rates};
use armwire_sim::pty::Pty;
use armwire_sim::serial::{Counters, SerialDevice};
use armwire_sim::serve::{BAUD, Served, serve};
use clap::{Args, ValueEnum};

use crate::call::values::whole;
use crate::error::Error;
use crate::output::print_line;

/// The pty of a device and the faults of its line: the arguments of all devices on a serial line.
#[derive(Args)]
pub(super) struct LineArgs {
    /// Symbolic link to the pty, removed at the end. PATH.lock marks it as in use. Without this option the system picks
    /// a name.
    #[arg(long, value_name = "PATH")]
    pty: Option<PathBuf>,
    /// Faults on the line, per million bytes: one number for all kinds, or a list such as 'drop=100,corrupt=5000' of drop,
    /// corrupt, duplicate, delay and noise.
    #[arg(long, value_name = "FAULTS", default_value = "0", value_parser = fault_rates)]
    faults: Rates,
    /// Direction in which faults are injected.
    #[arg(long, value_enum, default_value_t = FaultsOn::Both)]
    faults_on: FaultsOn,
    /// Seed of the faults: the same seed gives the same faults.
    #[arg(long, value_name = "N", default_value_t = 1, value_parser = whole::<u64>(0..=u64::MAX))]
    seed: u64,
}

#[derive(Clone, Copy, PartialEq, Eq, ValueEnum)]
enum FaultsOn {
    Both,
    Requests,
    Answers,
}

fn fault_rates(text: &str) -> Result<Rates, String> {
    let ppm = |text: &str| match text.parse() {
        Ok(ppm @ 0..=1_000_000) => Ok(ppm),
        _ => Err(format!("'{text}' is not a number from 0 to 1000000")),
    };
    if !text.contains('=') {
        return ppm(text).map(Rates::each);
    }
    let mut rates = Rates::NONE;
    for part in text.split(',') {
        let (kind, rate) = part
            .split_once('=')
            .ok_or(format!("'{part}': expected KIND=NUMBER, for example drop=100"))?;
        let field = match kind {
            "drop" => &mut rates.drop,
            "corrupt" => &mut rates.corrupt,
            "duplicate" => &mut rates.duplicate,
            "delay" => &mut rates.delay,
            "noise" => &mut rates.noise,
            _ => {
                return Err(format!(
                    "unknown fault '{kind}': expected drop, corrupt, duplicate, delay or noise"
                ));
            }
        };
        *field = ppm(rate)?;
    }
    Ok(rates)
}

impl LineArgs {
    /// Serves a device until `stop` is set, and prints its pty. Returns the device and the line's counts.
    pub(super) fn serve<D: SerialDevice>(
        &self,
        name: impl Display,
        device: D,
        stop: &AtomicBool,
    ) -> Result<(Line<D>, Served), Error> {
        let rates = |without| {
            if self.faults_on == without {
                Rates::NONE
            } else {
                self.faults
            }
        };
        let (to_device, from_device) = (rates(FaultsOn::Answers), rates(FaultsOn::Requests));
        let mut line = Line::new(device, to_device, from_device, self.seed);

        let pty = Pty::open(self.pty.as_deref()).map_err(not_served)?;
        pty.set_baud(BAUD).map_err(not_served)?;
        print_line(format_args!("{name} is at {}; Ctrl-C ends it.", pty.path().display()))?;
        let served = serve(&mut line, &pty, stop).map_err(not_served)?;
        Ok((line, served))
    }
}

/// The error of a virtual arm that cannot be served.
pub(super) fn not_served(error: io::Error) -> Error {
    Error::at("cannot serve a virtual arm", error)
}

/// Prints the line's counts and the device's.
pub(super) fn print_counts(served: Served, counters: Counters) -> Result<(), Error> {
    print_line(format_args!(
        "{} bytes in, {} out, {} not read; {} requests ({} answered, {} refused), {} unknown frames, {} noise bytes.",
        served.received,
        served.sent,
        served.lost,
        counters.requests,
        counters.answered,
        counters.refused,
        counters.unknown,
        counters.noise_bytes
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn fault_rates_are_one_number_or_named() {
        assert_eq!(fault_rates("100"), Ok(Rates::each(100)));
        let named = Rates {
            drop: 1,
            noise: 2,
            ..Rates::NONE
        };
        assert_eq!(fault_rates("drop=1,noise=2"), Ok(named));
        for wrong in ["", "x", "-1", "1000001", "drop", "drop=", "gremlins=1", "drop=1,2"] {
            assert!(fault_rates(wrong).is_err(), "{wrong}");
        }
    }
}
