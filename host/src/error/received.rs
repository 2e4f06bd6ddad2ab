//! The bytes received instead of an answer, and their probable cause.

use crate::describe::hex;
use crate::error::text::Text;

/// The probable cause of a missing answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub enum Missing {
    /// No bytes were received from the arm.
    Silent,
    /// The adapter does not answer on its control port.
    Adapter,
    /// Answers arrive damaged.
    Damaged,
    /// An answer arrived, but after its time.
    Late,
    /// The arm answers with a message that the protocol does not have.
    Unknown,
    /// Frames of the arm arrive, but not the answer.
    Elsewhere,
    /// Bytes arrive, but no frame of this arm.
    Foreign,
}

/// A hint for answers that come too late.
pub(crate) const LATE_HINT: &str = "is the arm, the line or this computer overloaded?";

/// The bytes received instead of an answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Received {
    /// Number of requests sent.
    pub(crate) sends: u8,
    /// In how many milliseconds.
    pub(crate) millis: u64,
    /// The bytes that arrived, as far as they are kept.
    pub(crate) bytes: Vec<u8>,
    /// Number of bytes received.
    pub(crate) count: usize,
    /// Good frames from an arm, though not the answer.
    pub(crate) frames: usize,
    /// Answers that came after their time.
    pub(crate) late: usize,
    /// The first good frame that is no message of the protocol.
    pub(crate) unknown: Option<String>,
    /// Requests of our own that came back.
    pub(crate) echoes: usize,
    /// Frames with a wrong checksum.
    pub(crate) checksums: usize,
    /// True if an answer begins somewhere in the bytes.
    pub(crate) begun: bool,
}

impl Received {
    /// The probable cause of a missing answer.
    pub(crate) fn missing(&self) -> Missing {
        let is_damaged = self.checksums > 0;
        if self.count == 0 && self.late == 0 {
            Missing::Silent
        } else if self.unknown.is_some() && !is_damaged {
            // A frame whose checksum happens to be good proves nothing where others are damaged.
            Missing::Unknown
        } else if self.late > 0 && !is_damaged {
            Missing::Late
        } else if self.begun || is_damaged {
            Missing::Damaged
        } else if self.frames > 0 {
            Missing::Elsewhere
        } else {
            Missing::Foreign
        }
    }

    /// The probable cause of a missing answer, in words, and a hint; `hint` is the line's.
    pub(crate) fn cause(&self, arm: &str, hint: Text) -> (String, Text) {
        let (millis, count, checksums) = (self.millis, self.count, self.checksums);
        let attempts = match self.sends {
            1 => "1 attempt".to_owned(),
            sends => format!("{sends} attempts"),
        };
        match (self.missing(), &self.unknown) {
            (Missing::Unknown, Some(error)) => (
                format!("the arm answers with {error}"),
                "does its firmware refuse the request, or not know it?".into(),
            ),
            (Missing::Late, _) => (
                format!("the answer came too late, {attempts} in {millis} ms"),
                LATE_HINT.into(),
            ),
            (Missing::Damaged, _) => (
                format!("the answers arrive damaged ({count} bytes, wrong checksums: {checksums})"),
                "check cable, ground and power, and that no other program has the port".into(),
            ),
            (Missing::Elsewhere, _) => (
                format!("frames arrive, but not the answer, {attempts}"),
                "does another program talk to the arm?".into(),
            ),
            (Missing::Unknown, None) | (Missing::Foreign, _) => self.foreign(arm, hint),
            _ => (format!("no answer in {millis} ms, {attempts}"), hint),
        }
    }

    /// Bytes without a frame of this arm, in words.
    fn foreign(&self, arm: &str, hint: Text) -> (String, Text) {
        let first = hex(&self.bytes[..self.bytes.len().min(16)]);
        let (cause, hint) = match self.echoes {
            0 => (format!("{} bytes arrive, but no frame of {arm}", self.count), hint),
            _ => (
                "only our own requests come back".to_owned(),
                "is the arm powered, and are RX and TX not joined?".into(),
            ),
        };
        (cause, hint.and(&format!(" (first bytes: {first})")))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn received(bytes: &[u8]) -> Received {
        Received {
            bytes: bytes.to_vec(),
            count: bytes.len(),
            ..Received::default()
        }
    }

    fn line(received: Received) -> String {
        let (cause, hint) = received.cause("a Ling arm", "is it on?".into());
        format!("{cause}: {hint}")
    }

    #[test]
    fn attempts_are_counted_in_words() {
        let cause = |sends| line(Received { sends, ..received(&[]) });
        assert!(cause(1).contains(" 1 attempt:") && cause(3).contains(" 3 attempts:"));
    }

    #[test]
    fn hints_name_no_culprit_alone() {
        let late = Received {
            late: 1,
            ..received(&[1])
        };
        assert!(line(late).ends_with("is the arm, the line or this computer overloaded?"));
        let damaged = Received {
            checksums: 1,
            ..received(&[1])
        };
        assert!(line(damaged).ends_with(", and that no other program has the port"));
    }

    #[test]
    fn every_cause_is_one_line() {
        let causes = [
            received(&[]),
            received(&[1; 500]),
            Received {
                checksums: 1,
                ..received(&[1])
            },
            Received {
                unknown: Some("command EE function 00: unknown".to_owned()),
                begun: true,
                ..received(&[1])
            },
            Received {
                echoes: 1,
                ..received(&[1])
            },
            Received {
                frames: 1,
                ..received(&[1])
            },
            Received {
                late: 1,
                ..received(&[1])
            },
        ];
        let mut lines = causes.map(line);
        assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 200));
        lines.sort();
        assert!(lines.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
