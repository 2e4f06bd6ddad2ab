//! `armwire selftest PORT` on the command line.

use std::io::Write;
use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};

use armwire_host::control::usb_serial_number;
use armwire_host::{Error as Host, Port, has_serial_port};
use clap::Args;
use serde_json::{Value, json};

use super::linux::LinuxUsb;
use super::{Check, Plan, counters, names, report, run};
use crate::confirm::Confirm;
use crate::error::Error;
use crate::new_file;
use crate::output::{print_json, print_line};
use crate::printable::escaped_json;

/// The warning that the user confirms before anything is sent.
const DANGER: &str = "Disconnect the arm, and join TX and RX with a jumper. The self-test restarts the adapter and writes \
                      its flash.";

/// The arguments of `armwire selftest`.
#[derive(Args)]
pub(crate) struct Selftest {
    /// The adapter's serial port, such as /dev/ttyACM0 or usb:SERIAL. No program may have it open.
    port: String,
    /// Run only these of the checks that need the jumper, separated by commas.
    #[arg(long, value_name = "CHECKS", value_delimiter = ',', value_parser = names())]
    only: Vec<String>,
    #[command(flatten)]
    confirm: Confirm,
    /// Print one JSON object at the end.
    #[arg(long)]
    json: bool,
    /// Write a report to this file: versions, each check with its figures, and the adapter's counters. It has no serial
    /// number.
    #[arg(long, value_name = "FILE")]
    report: Option<PathBuf>,
}

impl Selftest {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        if !cfg!(target_os = "linux") {
            let text = "the self-test needs Linux: other systems let no program detach the driver of a serial port";
            return Err(Error::at(&self.port, text));
        }
        let plan = Plan {
            only: self.only.clone(),
            ..Plan::default()
        };
        if let Some(path) = &self.report {
            new_file::check(path)?;
        }
        let (checks, mut printed) = self.check(&plan, stop)?;
        let failed = checks.iter().filter(|check| check.has_failed()).count();
        let (result, error) = match failed {
            0 if stop.load(Ordering::Relaxed) => ("stopped", Some("stopped before the last check".to_owned())),
            0 => ("passed", None),
            _ => ("failed", Some(format!("{failed} of {} checks failed", checks.len()))),
        };
        if self.json {
            let list: Vec<_> = checks.iter().map(Check::json).collect();
            printed = print_json(&json!({ "port": self.port, "result": result, "checks": Value::from(list) }));
        } else {
            let passed = checks.iter().filter(|check| check.result.is_ok()).count();
            let untried = checks.len() - passed - failed;
            printed = printed
                .and_then(|()| print_line(format_args!("{passed} passed, {failed} failed, {untried} not tried")));
        }
        error.map_or(printed, |reason| Err(Error::at(&self.port, reason)))
    }

    /// The checks, and the result of printing each as it ended.
    fn check(&self, plan: &Plan, stop: &AtomicBool) -> Result<(Vec<Check>, Result<(), Error>), Error> {
        if !has_serial_port(&self.port) {
            return Err(Port::not_found(&self.port).into());
        }
        let serial = usb_serial_number(&self.port).map_err(|error| match error {
            // No option names a control port here.
            Host::NoControl { .. } => Error::at(&self.port, "no adapter on USB is known to have this port"),
            error => error.into(),
        })?;
        self.confirm.question(DANGER)?.ask()?;
        let mut adapter = LinuxUsb::open(serial).map_err(|fault| Host::Usb {
            name: self.port.as_str().into(),
            fault,
        })?;
        let mut printed = Ok(());
        let stopped = || stop.load(Ordering::Relaxed);
        let checks = run(&mut adapter, plan, &stopped, &mut |check| {
            if !self.json && printed.is_ok() {
                printed = print_line(check.line());
            }
        });
        if let Some(path) = &self.report {
            let report = report(&checks, counters(&mut adapter).as_ref());
            let written = writeln!(new_file::create(path)?, "{}", escaped_json(&format!("{report:#}")));
            written.map_err(|error| Error::at(&path.display().to_string(), error))?;
        }
        Ok((checks, printed))
    }
}
