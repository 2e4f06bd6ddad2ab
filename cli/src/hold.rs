//! `armwire hold`: gives the line between an adapter and its arm to the host on USB alone.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::control::{HOLD_LEASE_MS, Request};
use clap::Args;

use crate::adapter::AdapterPort;
use crate::error::Error;
use crate::output::print_line;

/// Period of the lease's renewal: a fraction of the lease.
const RENEWAL_PERIOD: Duration = Duration::from_millis(HOLD_LEASE_MS as u64 / 5);
/// Period of the checks for Ctrl-C.
const POLL_PERIOD: Duration = Duration::from_millis(50);

/// The arguments of `armwire hold`.
#[derive(Args)]
pub(crate) struct Hold {
    #[command(flatten)]
    adapter: AdapterPort,
}

impl Hold {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let mut control = self.adapter.open()?;
        control.call(Request::HoldLine)?;
        let name = control.name().to_owned();
        let report = |what: &str| print_line(format_args!("{name}: {what}"));
        report("the line is held for USB: no polls, no CAN, no torque-off; Ctrl-C releases it")?;
        let mut renewal = Instant::now() + RENEWAL_PERIOD;
        while !stop.load(Ordering::Relaxed) {
            if renewal <= Instant::now() {
                control.call(Request::HoldLine)?;
                renewal = Instant::now() + RENEWAL_PERIOD;
            }
            thread::sleep(POLL_PERIOD);
        }
        control.call(Request::ReleaseLine)?;
        report("the line is released")
    }
}
