//! Random runs of the adapter in virtual time, through its public interface only: a virtual arm, hosts on USB and on CAN,
//! polls, cyclic commands and the dead-man, all at once.
//!
//! [`run`] makes one of them and panics if what `docs/safety.md` promises does not hold in it. A test draws thousands from a
//! seed, and a fuzz target makes them of what the fuzzer chooses.

mod arm;
mod oracle;
mod plan;
mod rig;

use crate::random::Random;

/// What happened in a run.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Circumstances {
    /// A self-check went out, and the arm did not answer it.
    pub open_self_check: bool,
    /// The arm owed the host on USB more than 8 answers that were not late.
    pub many_in_flight: bool,
    /// A request of the host on USB was not tracked.
    pub untracked: bool,
    /// The host on USB stopped in the middle of a frame.
    pub half_frame: bool,
    /// The line was at another rate than the arm's.
    pub other_rate: bool,
    /// `hold-line` gave the line to the host on USB alone.
    pub hold_line: bool,
    /// Flash was written.
    pub save: bool,
    /// A save was refused because a stream was armed.
    pub refused_save: bool,
    /// Frames that the arm said unasked, 40 ms apart.
    pub unasked: u32,
    /// An answer came more than 50 ms after the last byte of its request.
    pub late_answer: bool,
    /// A host that streamed motion fell silent.
    pub host_timeout: bool,
    /// And the torque went off.
    pub torque_off: bool,
    /// The adapter started again.
    pub restart: bool,
}

impl Circumstances {
    /// What is to happen in one of twenty runs at least, by name.
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

/// Makes a run of these choices.
///
/// # Panics
///
/// If something did not hold in it.
pub fn run(random: Random) -> Circumstances {
    plan::Plan::new(random, false).run()
}

/// The same, and prints what happens on the line, at the hosts and on the control port, each with its time in µs.
///
/// # Panics
///
/// If something did not hold in it.
pub fn run_and_print(random: Random) -> Circumstances {
    plan::Plan::new(random, true).run()
}

/// How long so many bytes take at 1 Mbaud, in µs.
const fn byte_times(bytes: usize) -> u64 {
    10 * bytes as u64
}
