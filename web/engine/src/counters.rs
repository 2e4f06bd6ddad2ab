//! Counters of the line on the host's side.

use armwire::time::Duration;

/// Events on the line since the session began.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Counters {
    /// Bytes to the arm.
    pub bytes_out: u64,
    /// Bytes from the arm.
    pub bytes_in: u64,
    /// Requests to the arm.
    pub requests: u64,
    /// Answers in time.
    pub answers: u64,
    /// Requests without an answer in time.
    pub unanswered: u64,
    /// Answers that arrived after their timeout.
    pub late: u64,
    /// Unsolicited responses.
    pub unsolicited: u64,
    /// Echoes of requests.
    pub echoes: u64,
    /// Valid frames that are not a known message.
    pub unknown: u64,
    /// Frame candidates with a wrong checksum.
    pub bad_checksums: u64,
    /// Bytes outside of frames.
    pub noise_bytes: u64,
}

/// The label of each counter, in the order of [`Counters::values`].
pub const LABELS: [&str; 11] = [
    "bytes to the arm",
    "bytes from the arm",
    "requests",
    "answers",
    "unanswered requests",
    "late answers",
    "unsolicited responses",
    "echoed requests",
    "unknown frames",
    "bad checksums",
    "bytes outside of frames",
];

impl Counters {
    /// Returns the counters in the order of the page.
    pub const fn values(&self) -> [u64; LABELS.len()] {
        [
            self.bytes_out,
            self.bytes_in,
            self.requests,
            self.answers,
            self.unanswered,
            self.late,
            self.unsolicited,
            self.echoes,
            self.unknown,
            self.bad_checksums,
            self.noise_bytes,
        ]
    }
}

/// Response times, from the write of a request's last byte to the read of its answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnswerTimes {
    /// Time of the last answer.
    pub last: Duration,
    /// Shortest time, zero before the first answer.
    pub shortest: Duration,
    /// Longest time.
    pub longest: Duration,
}

impl AnswerTimes {
    /// Adds the time of an answer.
    pub fn add(&mut self, time: Duration) {
        let is_first = *self == Self::default();
        self.last = time;
        self.shortest = if is_first { time } else { self.shortest.min(time) };
        self.longest = self.longest.max(time);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn answer_times_keep_the_shortest_and_the_longest() {
        let mut times = AnswerTimes::default();
        for millis in [5, 3, 9, 4] {
            times.add(Duration::from_millis(millis));
        }
        let [last, shortest, longest] = [4, 3, 9].map(Duration::from_millis);
        assert_eq!(
            times,
            AnswerTimes {
                last,
                shortest,
                longest
            }
        );
    }
}
