//! Random runs of the adapter in virtual time, through its public interface only: a virtual arm, hosts on USB and on
//! CAN, polls, cyclic commands and the host timeout, all at once.
//!
//! [`run`] executes one run and panics if a promise of `docs/safety.md` is broken. A test draws thousands of runs from
//! a seed. A fuzz target derives them from the fuzzer's input.

mod arm;
mod control_port;
mod oracle;
mod plan;
mod rig;

use armwire_bridge::Counters;
use armwire_bridge::control::Initiator;

pub use control_port::ControlPort;

use crate::random::Random;

/// Conditions, by name, each required in at least one of twenty runs, and true for those met in this run.
pub type Conditions = [(&'static str, bool); 15];

/// Executes the run with these choices.
///
/// # Panics
///
/// If a promise is broken.
pub fn run(random: Random) -> Conditions {
    plan::Plan::new(random, false).run()
}

/// Executes the run and prints the events on the line, at the hosts and on the control port, each with its time in µs.
///
/// # Panics
///
/// If a promise is broken.
pub fn run_and_print(random: Random) -> Conditions {
    plan::Plan::new(random, true).run()
}

/// Duration of `bytes` bytes at 1 Mbaud, in µs.
const fn byte_times(bytes: usize) -> u64 {
    10 * bytes as u64
}

/// The initiator of a burst for the arm, by the counters before and after it.
///
/// # Panics
///
/// If the burst has requests of several initiators.
pub fn initiator(before: &Counters, after: &Counters) -> Initiator {
    let others = [
        (Initiator::Can, after.requests_can - before.requests_can),
        (Initiator::Poll, after.requests_poll - before.requests_poll),
        (Initiator::Command, after.requests_command - before.requests_command),
        (Initiator::Adapter, after.requests_adapter - before.requests_adapter),
    ];
    let Some(&(initiator, _)) = others.iter().find(|(_, requests)| *requests > 0) else {
        return Initiator::Usb;
    };
    let requests: u32 = others.iter().map(|(_, requests)| requests).sum();
    assert_eq!((requests, after.requests_usb), (1, before.requests_usb));
    initiator
}
