//! The log of the line: every byte of both directions once, as frames with their meaning or as noise with its reason.

use std::collections::VecDeque;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::Reason;
use armwire::ling::{Ling, MAX_FRAME};
use armwire::time::Instant;

use crate::describe;

/// Maximum number of queued records. A page that does not take them, as in a hidden tab, loses the oldest.
const MAX_RECORDS: usize = 512;

/// Kind of a record. Its numbers are part of the interface to the page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Event {
    /// A frame to the arm.
    Sent = 1,
    /// A message from the arm.
    Received = 2,
    /// A valid frame from the arm that is not a response.
    Unknown = 3,
    /// Bytes from the arm outside of frames.
    Noise = 4,
    /// A request without an answer in time. It has no bytes.
    Unanswered = 5,
}

/// A row of the log.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Record {
    /// Time at which the host wrote or read the last byte.
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
    decoder: Decoder<Ling, MAX_FRAME>,
    records: VecDeque<Record>,
    bad_checksums: u64,
    noise_bytes: u64,
}

impl Log {
    /// Logs a frame to the arm.
    pub fn sent(&mut self, at: Instant, frame: &[u8]) {
        self.push(at, Event::Sent, frame.to_vec(), describe::request(frame));
    }

    /// Logs bytes from the arm, in chunks of any size.
    pub fn received(&mut self, at: Instant, mut bytes: &[u8]) {
        while !bytes.is_empty() {
            bytes = self.decoder.push(bytes);
            self.decode(at);
        }
    }

    /// Logs the timeout of the request with this text. An incomplete frame becomes noise.
    pub fn unanswered(&mut self, at: Instant, request: &str) {
        self.decoder.idle();
        self.decode(at);
        self.push(at, Event::Unanswered, Vec::new(), format!("no answer to \"{request}\""));
    }

    /// Takes the oldest queued record.
    pub fn take(&mut self) -> Option<Record> {
        self.records.pop_front()
    }

    /// Returns the number of frame candidates with a wrong checksum.
    pub fn bad_checksums(&self) -> u64 {
        self.bad_checksums
    }

    /// Returns the number of bytes outside of frames.
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
        let meanings = ["read joints", "stroke: 50 mm"].map(str::to_owned);
        let [sent, received] = meanings;
        assert_eq!(
            taken(&mut log),
            [(Event::Sent, 7, sent), (Event::Received, 7, received)]
        );
    }

    #[test]
    fn damaged_frame_is_noise_with_its_reason() {
        let mut log = Log::default();
        let mut damaged = STROKE;
        damaged[5] = 0x01;
        log.received(Instant::ZERO, &damaged);
        let records = taken(&mut log);
        assert_eq!(records, [(Event::Noise, 7, "checksum 0x01, expected 0x00".to_owned())]);
        assert_eq!((log.bad_checksums(), log.noise_bytes()), (1, 7));
    }

    #[test]
    fn incomplete_frame_is_noise_after_the_timeout() {
        let mut log = Log::default();
        log.received(Instant::ZERO, &STROKE[..4]);
        assert_eq!(taken(&mut log), []);
        log.unanswered(Instant::ZERO, "read gripper stroke");
        let records = taken(&mut log);
        assert_eq!(records[0].2, "line went idle with 3 bytes missing");
        assert_eq!(records.last().unwrap().2, "no answer to \"read gripper stroke\"");
    }

    #[test]
    fn full_log_keeps_the_newest_records() {
        let mut log = Log::default();
        for micros in 0..=MAX_RECORDS as u64 {
            log.sent(Instant::from_micros(micros), &READ_JOINTS);
        }
        assert_eq!(log.take().unwrap().at, Instant::from_micros(1));
    }
}
