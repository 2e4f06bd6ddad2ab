//! A virtual follower behind a line with faults. Bytes arrive in chunks, at the times of the page.

use armwire::time::{Duration, Instant};
use armwire_sim::faults::{Injected, Line, Rates};
use armwire_sim::ling::{Config, LingArm, Plant};
use armwire_sim::serial::SerialDevice;

/// A byte at 1 Mbaud.
const BYTE_TIME: Duration = Duration::from_micros(10);
/// Maximum delay of a byte. It exceeds the timeout of an answer, so that some answers are late.
pub const MAX_DELAY: Duration = Duration::from_millis(150);

/// The label of each kind of fault.
pub const FAULTS: [&str; 5] = [
    "bytes lost",
    "bytes damaged",
    "bytes repeated",
    "bytes delayed",
    "bytes inserted",
];

/// The arm and its line.
#[derive(Debug)]
pub struct VirtualArm {
    line: Line<LingArm>,
    /// The time at the arm. It is ahead of the page's time by the line time of a chunk.
    now: Instant,
}

impl VirtualArm {
    /// An arm on a line without faults. The seed determines later faults.
    pub fn new(seed: u64, plant: Plant) -> Self {
        let arm = LingArm::new(Config {
            plant,
            ..Config::follower()
        });
        Self {
            line: Line::new(arm, Rates::NONE, Rates::NONE, seed),
            now: Instant::ZERO,
        }
    }

    /// Sets the rates of faults in both directions, in parts per million of the bytes. Delays are up to [`MAX_DELAY`].
    pub fn set_faults(&mut self, rates: Rates) {
        let rates = Rates {
            max_delay: MAX_DELAY,
            ..rates
        };
        self.line.set_rates(rates, rates);
    }

    /// Receives the bytes that the host wrote at `now`.
    pub fn receive(&mut self, now: Instant, bytes: &[u8]) {
        self.now = self.now.max(now);
        for &byte in bytes {
            self.now += BYTE_TIME;
            self.line.receive(self.now, byte);
        }
    }

    /// Writes the bytes that are available to the host at `now` at the front of `out` and returns their number.
    pub fn transmit(&mut self, now: Instant, out: &mut [u8]) -> usize {
        self.now = self.now.max(now);
        let mut len = 0;
        for to in out {
            let Some(byte) = self.line.transmit(self.now) else {
                break;
            };
            *to = byte;
            len += 1;
            self.now += BYTE_TIME;
        }
        len
    }

    /// The time of the next call of [`transmit`](Self::transmit); `None` if the arm waits for a request.
    pub fn timeout(&self) -> Option<Instant> {
        self.line.poll_timeout()
    }

    /// Counts of faults in both directions, in the order of [`FAULTS`].
    pub fn injected(&self) -> [u64; FAULTS.len()] {
        let counts = |injected: Injected| {
            let Injected {
                dropped,
                corrupted,
                duplicated,
                delayed,
                noise,
                ..
            } = injected;
            [dropped, corrupted, duplicated, delayed, noise]
        };
        let mut sums = counts(self.line.injected_to_device());
        for (sum, count) in sums.iter_mut().zip(counts(self.line.injected_from_device())) {
            *sum += count;
        }
        sums
    }

    /// The arm.
    #[cfg(test)]
    pub(crate) fn arm(&self) -> &LingArm {
        self.line.device()
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::{Frame, READ_JOINTS};

    use super::*;

    #[test]
    fn answer_is_ready_after_line_time_and_turnaround() {
        let mut arm = VirtualArm::new(1, Plant::IDEAL);
        let mut out = [0; 64];
        arm.receive(Instant::ZERO, &READ_JOINTS);
        assert_eq!(arm.transmit(Instant::ZERO, &mut out), 0);
        let due = arm.timeout().unwrap();
        assert_eq!(due, Instant::from_micros(7 * 10 + 200));
        let len = arm.transmit(due, &mut out);
        assert_eq!(Frame::parse(&out[..len]).map(|frame| frame.data.len()), Some(15));
    }

    #[test]
    fn line_that_loses_every_byte_counts_them() {
        let mut arm = VirtualArm::new(1, Plant::IDEAL);
        let drop = 1_000_000;
        arm.set_faults(Rates { drop, ..Rates::NONE });
        arm.receive(Instant::ZERO, &READ_JOINTS);
        assert_eq!(arm.timeout(), None);
        assert_eq!(arm.injected(), [7, 0, 0, 0, 0]);
    }
}
