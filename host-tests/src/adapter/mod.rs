//! Random runs of the adapter in virtual time, through its public interface only: a virtual arm, hosts on USB and on
//! CAN, polls, cyclic commands and the host timeout, all at once.
//!
//! [`run`] executes one run and panics if a promise of `docs/safety.md` is broken. A test draws thousands of runs from
//! a seed. A fuzz target derives them from the fuzzer's input.

mod arm;
mod control_port;
mod measures;
mod oracle;
mod plan;
mod rig;

pub use control_port::ControlPort;
use measures::byte_times;
pub use measures::{Conditions, initiator};

use crate::random::Random;

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
