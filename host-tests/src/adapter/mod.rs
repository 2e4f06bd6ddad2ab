//! Random runs of the adapter in virtual time, through its public interface only: a virtual arm, hosts on USB and on
//! CAN, polls, cyclic commands and the host timeout, all at once.
//!
//! [`run`] executes one run and panics if a promise of `docs/safety.md` is broken. A test draws thousands of runs from
//! a seed. A fuzz target derives them from the fuzzer's input.

mod arm;
mod oracle;
mod plan;
mod rig;

use crate::random::Random;

/// Conditions met in a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Circumstances {
    /// A self-check was sent and not answered.
    pub open_self_check: bool,
    /// The host on USB had more than 8 requests in flight.
    pub many_in_flight: bool,
    /// A request of the host on USB was untracked.
    pub untracked: bool,
    /// The host on USB stopped in the middle of a frame.
    pub half_frame: bool,
    /// The line had another rate than the arm's.
    pub other_rate: bool,
    /// `hold-line` reserved the line for the host on USB.
    pub hold_line: bool,
    /// The configuration was saved.
    pub save: bool,
    /// A save was refused because a stream was armed.
    pub refused_save: bool,
    /// Number of unasked frames of the arm, 40 ms apart.
    pub unasked: u32,
    /// An answer ended more than 50 ms after the last byte of its request.
    pub late_answer: bool,
    /// A host timed out in its motion stream.
    pub host_timeout: bool,
    /// The adapter switched the torque off.
    pub torque_off: bool,
    /// The adapter restarted.
    pub restart: bool,
}

impl Circumstances {
    /// Conditions, by name, required in at least one of twenty runs.
    pub fn often(&self) -> [(&'static str, bool); 11] {
        [
            ("open self-check", self.open_self_check),
            ("more than 8 requests in flight", self.many_in_flight),
            ("a request that is not tracked", self.untracked),
            ("half a frame", self.half_frame),
            ("another baud rate", self.other_rate),
            ("hold-line", self.hold_line),
            ("a save", self.save),
            ("an unasked frame every 40 ms", self.unasked >= 5),
            ("an answer 50 to 100 ms after its request", self.late_answer),
            ("a host that falls silent in its stream", self.host_timeout),
            ("torque-off", self.torque_off),
        ]
    }
}

/// Executes the run with these choices.
///
/// # Panics
///
/// If a promise is broken.
pub fn run(random: Random) -> Circumstances {
    plan::Plan::new(random, false).run()
}

/// Executes the run and prints the events on the line, at the hosts and on the control port, each with its time in µs.
///
/// # Panics
///
/// If a promise is broken.
pub fn run_and_print(random: Random) -> Circumstances {
    plan::Plan::new(random, true).run()
}

/// Duration of `bytes` bytes at 1 Mbaud, in µs.
const fn byte_times(bytes: usize) -> u64 {
    10 * bytes as u64
}
