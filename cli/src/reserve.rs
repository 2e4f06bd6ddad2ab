//! `armwire reserve`: reserves the line between an adapter and its arm for the host on USB.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use clap::Args;

use crate::adapter::AdapterPort;
use crate::error::Error;
use crate::output::print_line;

/// Period of the checks for Ctrl-C.
const POLL_PERIOD: Duration = Duration::from_millis(50);

/// The arguments of `armwire reserve`.
#[derive(Args)]
pub(crate) struct Reserve {
    #[command(flatten)]
    adapter: AdapterPort,
}

impl Reserve {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let mut control = self.adapter.open()?;
        let name = control.name().to_owned();
        let mut line = control.reserve_line()?;
        let report = |what: &str| print_line(format_args!("{name}: {what}"));
        report("the line is reserved for USB: no polls, no CAN, no torque-off; Ctrl-C releases it")?;
        while !stop.load(Ordering::Relaxed) {
            line.renew()?;
            thread::sleep(POLL_PERIOD);
        }
        line.release()?;
        report("the line is released")
    }
}
