//! The log of the line: every byte of both directions once, as frames with their meaning or as noise with its reason.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::Reason;
use armwire::ling::{Ling, MAX_FRAME};
use armwire::time::Instant;

use crate::describe;

/// Records that wait for the page at most. A page that does not take them, as in a hidden tab, loses the oldest.
const MAX_RECORDS: usize = 512;

/// The kind of a record. The page knows the numbers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Event {
    /// A frame to the arm.
    Sent = 1,
    /// A message from the arm.
    Received = 2,
    /// A good frame from the arm that is no response.
    Unknown = 3,
    /// Bytes from the arm outside of frames.
    Noise = 4,
    /// A request without an answer in time. It has no bytes.
    Unanswered = 5,
}

/// A row of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// The time when the host wrote or read the last of it.
    pub at: Instant,
    /// The kind.
    pub event: Event,
    /// The bytes on the wire.
    pub bytes: Vec<u8>,
    /// The meaning or the error. Text of the arm is escaped.
    pub text: String,
}

/// The log.
#[derive(Debug, Default)]
pub struct Log {
    decoder: Decoder<MAX_FRAME>,
    records: VecDeque<Record>,
    bad_checksums: u64,
    noise_bytes: u64,
}

impl Log {
    /// A frame went to the arm.
    pub fn sent(&mut self, at: Instant, frame: &[u8]) {
        self.push(at, Event::Sent, frame.to_vec(), describe::request(frame));
    }

    /// Bytes came from the arm, in any chunks.
    pub fn received(&mut self, at: Instant, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            bytes = self.decoder.push(bytes);
            self.decode(at);
        }
    }

    /// The request with this text got no answer. Bytes that wait for the rest of a frame are none.
    pub fn unanswered(&mut self, at: Instant, request: &str) {
        self.decoder.idle();
        self.decode(at);
        self.push(at, Event::Unanswered, Vec::new(), format!("no answer to \"{request}\""));
    }

    /// The oldest record that was not taken yet.
    pub fn take(&mut self) -> Option<Record> {
        self.records.pop_front()
    }

    /// Candidates for a frame whose checksum did not match.
    pub fn bad_checksums(&self) -> u64 {
        self.bad_checksums
    }

    /// Bytes outside of frames.
    pub fn noise_bytes(&self) -> u64 {
        self.noise_bytes
    }

    fn decode(&mut self, at: Instant) {
        while let Some(item) = self.decoder.next(&Ling, ()) {
            let bytes = item.bytes.to_vec();
            // The rest of a damaged frame: one row for both.
            if let (Kind::Noise(Reason::Stray), Some(last)) = (item.kind, self.records.back_mut())
                && (last.event, last.at) == (Event::Noise, at)
            {
                self.noise_bytes += bytes.len() as u64;
                last.bytes.extend(bytes);
                continue;
            }
            let (event, text) = match item.kind {
                Kind::Frame | Kind::Padding => match describe::response(&bytes) {
                    Ok(text) => (Event::Received, text),
                    Err(text) => (Event::Unknown, text),
                },
                Kind::Noise(reason) | Kind::Broken(reason) => {
                    self.noise_bytes += bytes.len() as u64;
                    self.bad_checksums += u64::from(matches!(reason, Reason::Checksum { .. }));
                    (Event::Noise, reason.to_string())
                }
            };
            self.push(at, event, bytes, text);
        }
    }

    fn push(&mut self, at: Instant, event: Event, bytes: Vec<u8>, text: String) {
        if self.records.len() == MAX_RECORDS {
            self.records.pop_front();
        }
        self.records.push_back(Record { at, event, bytes, text });
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::READ_JOINTS;

    use super::*;

    fn taken(log: &mut Log) -> Vec<(Event, usize, String)> {
        let records = std::iter::from_fn(|| log.take());
        records
            .map(|record| (record.event, record.bytes.len(), record.text))
            .collect()
    }

    const STROKE: [u8; 7] = [0xAA, 0x04, 0x0E, 0x01, 0x00, 0x00, 0xFF];

    #[test]
    fn frames_of_both_directions_have_a_meaning() {
        let mut log = Log::default();
        log.sent(Instant::ZERO, &READ_JOINTS);
        log.received(Instant::ZERO, &STROKE[..3]);
        log.received(Instant::ZERO, &STROKE[3..]);
        let meanings = ["read joints", "gripper stroke 50 mm"].map(str::to_owned);
        let [sent, received] = meanings;
        assert_eq!(
            taken(&mut log),
            [(Event::Sent, 7, sent), (Event::Received, 7, received)]
        );
    }

    #[test]
    fn a_damaged_frame_is_noise_with_its_reason() {
        let mut log = Log::default();
        let mut damaged = STROKE;
        damaged[5] = 0x01;
        log.received(Instant::ZERO, &damaged);
        let records = taken(&mut log);
        assert_eq!(records, [(Event::Noise, 7, "checksum 0x01, expected 0x00".to_owned())]);
        assert_eq!((log.bad_checksums(), log.noise_bytes()), (1, 7));
    }

    #[test]
    fn half_a_frame_is_noise_once_its_answer_is_given_up() {
        let mut log = Log::default();
        log.received(Instant::ZERO, &STROKE[..4]);
        assert_eq!(taken(&mut log), []);
        log.unanswered(Instant::ZERO, "read gripper stroke");
        let records = taken(&mut log);
        assert_eq!(records[0].2, "line went idle with 3 bytes missing");
        assert_eq!(records.last().unwrap().2, "no answer to \"read gripper stroke\"");
    }

    #[test]
    fn a_full_log_keeps_the_newest_records() {
        let mut log = Log::default();
        for micros in 0..=MAX_RECORDS as u64 {
            log.sent(Instant::from_micros(micros), &READ_JOINTS);
        }
        assert_eq!(log.take().unwrap().at, Instant::from_micros(1));
    }
}
