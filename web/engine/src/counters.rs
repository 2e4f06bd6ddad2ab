//! Counters of the line, as the host sees it.

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
    /// Answers to requests that were given up.
    pub late: u64,
    /// Responses that answer nothing.
    pub unsolicited: u64,
    /// Requests that the line gave back.
    pub echoes: u64,
    /// Good frames that are no message.
    pub unknown: u64,
    /// Candidates for a frame whose checksum does not match.
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
    /// The counters in the order in which a page shows them.
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

/// Times from the last byte of a request, as handed to the port, to its answer, as taken from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct AnswerTimes {
    /// Time of the newest answer.
    pub last: Duration,
    /// The shortest. Zero before the first answer.
    pub shortest: Duration,
    /// The longest.
    pub longest: Duration,
}

impl AnswerTimes {
    /// Takes the time of one more answer.
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
