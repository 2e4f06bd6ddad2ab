//! What was received instead of an answer, and what that says of the line.

use crate::hex;

/// What was received instead of an answer.
#[derive(Clone, Debug, Default)]
pub(crate) struct Received {
    /// How often the arm was asked.
    pub(crate) sends: u8,
    /// In how many milliseconds.
    pub(crate) millis: u64,
    /// The bytes that arrived, as far as they are kept.
    pub(crate) bytes: Vec<u8>,
    /// How many there were.
    pub(crate) count: usize,
    /// Good frames from an arm, though not the answer.
    pub(crate) frames: usize,
    /// The first good frame that is no message of the protocol.
    pub(crate) unknown: Option<String>,
    /// Requests of our own that came back.
    pub(crate) echoes: usize,
    /// Frames with a wrong checksum.
    pub(crate) checksums: usize,
    /// Whether bytes start as the answer should.
    pub(crate) begun: bool,
}

impl Received {
    /// Why there is no answer, as far as what came tells; `hints` are the line's.
    pub(crate) fn cause(&self, arm: &str, hints: &str) -> String {
        let (millis, count, checksums) = (self.millis, self.count, self.checksums);
        let times = match self.sends {
            1 => "once".to_owned(),
            sends => format!("{sends} times"),
        };
        if count == 0 {
            return format!("no answer in {millis} ms, asked {times}: {hints}");
        }
        // A frame whose checksum happens to be good proves nothing where others are damaged.
        if let Some(error) = &self.unknown
            && checksums == 0
        {
            return format!("the arm answers with {error}: does its firmware refuse the request, or not know it?");
        }
        if checksums > 0 || self.begun {
            return format!(
                "the answers arrive damaged ({count} bytes, wrong checksums: {checksums}): check cable, ground and power"
            );
        }
        if self.frames > 0 {
            return format!(
                "frames arrive, but not the answer, asked for {times}: does another program talk to the arm?"
            );
        }
        let first = hex::show(&self.bytes[..self.bytes.len().min(16)]);
        if self.echoes > 0 {
            return format!(
                "only our own requests come back: is the arm powered, and are RX and TX not joined? (first bytes: {first})"
            );
        }
        format!("{count} bytes arrive, but no frame of {arm}: {hints} (first bytes: {first})")
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

    fn line(heard: Received) -> String {
        heard.cause("a Ling arm", "is it on?")
    }

    #[test]
    fn one_request_is_told_as_once() {
        let asked = |sends| line(Received { sends, ..received(&[]) });
        assert!(asked(1).contains("asked once:") && asked(3).contains("asked 3 times:"));
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
        ];
        let mut lines = causes.map(line);
        assert!(lines.iter().all(|line| !line.contains('\n') && line.len() < 200));
        lines.sort();
        assert!(lines.windows(2).all(|pair| pair[0] != pair[1]));
    }
}
