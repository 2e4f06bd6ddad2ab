//! `armwire sim alpha1` and `armwire sim alpha1-servo`: a virtual Alpha1, or its servos alone, on a pseudo-terminal.

use std::str::FromStr;
use std::sync::atomic::AtomicBool;

use armwire::alpha1::{ServoId, Text};
use armwire_bridge::Duration;
use armwire_sim::alpha1::{Alpha1Robot, BusConfig, RobotConfig, ServoBus};
use armwire_sim::serial::SerialDevice;
use clap::Args;

use super::line::{LineArgs, print_counts};
use crate::call::values::{made, whole};
use crate::error::Error;
use crate::ids::ids;
use crate::output::print_line;

/// The arguments of `armwire sim alpha1`.
#[derive(Args)]
pub(crate) struct Alpha1Sim {
    #[command(flatten)]
    line: LineArgs,
    /// Hardware version, at most 254 characters.
    #[arg(long, value_name = "TEXT", value_parser = parse_text)]
    hardware: Option<String>,
    /// Firmware version, 10 characters.
    #[arg(long, value_name = "TEXT", value_parser = parse_firmware)]
    firmware: Option<[u8; 10]>,
    /// Time from the end of a request to the start of its answer, in microseconds.
    #[arg(long, value_name = "N", default_value_t = 1_000, value_parser = whole::<u64>(0..=u64::MAX))]
    turnaround_us: u64,
    /// Longest pause inside a request, in milliseconds. After it the incomplete request is dropped.
    #[arg(long, value_name = "N", default_value_t = 100, value_parser = whole::<u32>(0..=u32::MAX.into()))]
    idle_ms: u32,
    /// Pad each answer with zeros to HID reports of 64 bytes. Padded requests are always accepted.
    #[arg(long)]
    hid: bool,
}

/// The arguments of `armwire sim alpha1-servo`.
#[derive(Args)]
pub(crate) struct Alpha1ServoSim {
    #[command(flatten)]
    line: LineArgs,
    /// Ids of the servos, 1 to 240, such as '1-16' or '1,2,7'.
    #[arg(long, default_value = "1-16")]
    ids: Ids,
    /// Time from the end of a request to the start of its answer, in microseconds.
    #[arg(long, value_name = "N", default_value_t = 200, value_parser = whole::<u64>(0..=u64::MAX))]
    turnaround_us: u64,
    /// Echo every received byte immediately, as a single-wire bus does.
    #[arg(long)]
    echo: bool,
}

#[derive(Clone, Debug)]
struct Ids(Vec<ServoId>);

impl FromStr for Ids {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let id = |text: &str| made(text, "an id from 1 to 240", ServoId::new).map(ServoId::get);
        let ids = ids(text, id)?.into_iter();
        Ok(Self(ids.filter_map(|id| ServoId::new(id).ok()).collect()))
    }
}

fn parse_text(text: &str) -> Result<String, String> {
    match Text::new(text.as_bytes()) {
        Ok(_) => Ok(text.to_owned()),
        Err(error) => Err(error.to_string()),
    }
}

fn parse_firmware(text: &str) -> Result<[u8; 10], String> {
    text.as_bytes()
        .try_into()
        .map_err(|_| format!("it has {} bytes, not 10", text.len()))
}

impl Alpha1Sim {
    pub(super) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let base = RobotConfig::default();
        let config = RobotConfig {
            hardware: self.hardware.clone().map_or(base.hardware, String::into_bytes),
            firmware: self.firmware.unwrap_or(base.firmware),
            turnaround: Duration::from_micros(self.turnaround_us),
            idle: Duration::from_millis(self.idle_ms.into()),
            hid: self.hid,
        };
        let name = format!("Alpha1 with hardware {}", config.hardware.escape_ascii());
        let (line, served) = self.line.serve(name, Alpha1Robot::new(config), stop)?;
        if line.is_gone() {
            print_line("The robot is a disk on USB: this port is gone.")?;
        }
        print_counts(served, line.device().counters())
    }
}

impl Alpha1ServoSim {
    pub(super) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let config = BusConfig {
            ids: self.ids.0.clone(),
            turnaround: Duration::from_micros(self.turnaround_us),
            echo: self.echo,
            ..BusConfig::default()
        };
        let name = match config.ids.len() {
            1 => "Alpha1 servo bus with 1 servo".to_owned(),
            servos => format!("Alpha1 servo bus with {servos} servos"),
        };
        let (line, served) = self.line.serve(name, ServoBus::new(config), stop)?;
        print_counts(served, line.device().counters())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ids_are_numbers_and_ranges() {
        let ids = |text: &str| {
            let ids = text.parse::<Ids>();
            ids.map(|ids| ids.0.into_iter().map(ServoId::get).collect::<Vec<_>>())
        };
        assert_eq!(ids("7"), Ok(vec![7]));
        assert_eq!(ids("1,3-5,240"), Ok(vec![1, 3, 4, 5, 240]));
        for wrong in ["", "0", "241", "256", "1-", "-1", "5-3", "1,,2", "x"] {
            assert!(ids(wrong).is_err(), "{wrong}");
        }
        let error = ids("0").unwrap_err();
        assert_eq!(error, "servo id is 0, must be 1..=240");
    }
}
