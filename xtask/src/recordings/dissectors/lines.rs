//! Frames of each line to an arm, with other values, and damaged.

use std::fmt::{self, Display};
use std::fs;
use std::ops::Range;

use anyhow::{Result, ensure};
use crc::{CRC_32_ISO_HDLC, Crc};

use crate::workspace::root;

const CORPUS: &str = "host-tests/fuzz/corpus/decode";

/// A heartbeat with a wrong last byte, and a frame without a register.
const XARM_ERRORS: [&[u8]; 2] = [&[0, 0, 0, 1, 0, 2, 0, 5], &[0, 1, 0, 2, 0, 0]];
/// More data bytes of a Ling arm: joints are an Alicia-D's with the first, and a Bessica-D's with the last.
const MORE: [u8; 3] = [1, 2, 18];
/// The protocol id of a heartbeat, which has one length.
const HEARTBEAT: u8 = 1;
/// Bytes with a meaning in some frame: codes, answers, end marks, limits.
const VALUES: [u8; 16] = [
    0x00, 0x01, 0x02, 0x03, 0x04, 0x10, 0x11, 0x5A, 0x80, 0xAA, 0xE1, 0xE2, 0xED, 0xEE, 0xFE, 0xFF,
];

/// One direction of a line.
pub(super) struct Line {
    pub(super) arm: &'static str,
    /// The sender, as an argument of `armwire decode --from`.
    pub(super) from: &'static str,
    /// The frames of the documents: files of the fuzz corpus, and the number of bytes before the frame in them.
    documents: &'static [(&'static str, usize)],
}

pub(super) const LINES: [Line; 7] = [
    Line::new("ling", "host", &[("ling-request", 1)]),
    Line::new("ling", "arm", &[("ling-response", 1)]),
    // A recording has one generation.
    Line::new("ling", "arm", OLDER),
    Line::new("xarm", "host", &[("xarm-request", 2)]),
    Line::new("xarm", "arm", &[("xarm-response", 2)]),
    Line::new("alpha1", "host", &[("alpha1-request", 2)]),
    Line::new("alpha1", "arm", &[("alpha1-response", 2), ("servo-angles", 3)]),
];

/// The servo bus of an Alpha1, both directions.
pub(super) const SERVO_BUS: Line = Line::new("alpha1-servo", "arm", &[]);

/// The frames of the older generation.
const OLDER: &[(&str, usize)] = &[("legacy", 1)];

impl Display for Line {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let generation = if self.is_older() {
            " of the older generation"
        } else {
            ""
        };
        write!(f, "{}{generation}, from the {}", self.arm, self.from)
    }
}

impl Line {
    const fn new(arm: &'static str, from: &'static str, documents: &'static [(&'static str, usize)]) -> Self {
        Self { arm, from, documents }
    }

    /// The name of the protocol in Wireshark and sigrok.
    pub(super) fn protocol(&self) -> &'static str {
        self.arm.trim_end_matches("-servo")
    }

    pub(super) fn is_older(&self) -> bool {
        self.documents == OLDER
    }

    /// The frames of the documents, at least one.
    pub(super) fn document_frames(&self) -> Result<Vec<Vec<u8>>> {
        let mut frames = Vec::new();
        for (name, start) in self.documents {
            frames.extend(document_frames(name, *start)?);
        }
        Ok(frames)
    }

    /// A frame for each header, with one value or none. The older generation has no short frames.
    pub(super) fn short_frames(&self) -> Vec<Vec<u8>> {
        let all = 0..=u8::MAX;
        match self.arm {
            "ling" if self.is_older() => Vec::new(),
            "ling" => all
                .clone()
                .flat_map(|command| (0..=u8::MAX).map(move |f| ling_frame(command, f)))
                .collect(),
            "xarm" => all.flat_map(xarm_frames).collect(),
            _ => all.flat_map(alpha1_frames).collect(),
        }
    }

    /// Frames with one changed data byte. The first and the last byte are set to each of [`VALUES`].
    pub(super) fn variants(&self, frame: &[u8]) -> Vec<Vec<u8>> {
        let (data, check) = self.data(frame);
        let mut variants = Vec::new();
        if (self.arm, self.from) == ("ling", "arm") && !self.is_older() {
            variants.extend(MORE.map(|more| longer_ling_frame(frame, more)));
        }
        if (self.arm, self.from) == ("xarm", "arm") && frame[3] != HEARTBEAT {
            variants.push(longer_xarm_frame(frame));
        }
        for at in data.clone() {
            let is_end = at == data.start || at + 1 == data.end;
            for (nth, value) in VALUES.iter().enumerate() {
                if is_end || nth == at % VALUES.len() {
                    let mut variant = frame.to_vec();
                    variant[at] = *value;
                    if let Some((from, check)) = check {
                        variant[data.end] = check(&variant[from..data.end]);
                    }
                    variants.push(variant);
                }
            }
        }
        variants
    }

    /// The place of the data in a frame, the start of the bytes in its checksum, and the checksum. It follows the data.
    fn data(&self, frame: &[u8]) -> (Range<usize>, Option<(usize, Check)>) {
        let end = frame.len().saturating_sub(2);
        match (self.arm, self.from) {
            ("ling", _) if self.is_older() => (3..end, Some((3, parity))),
            ("ling", _) => (4..end, Some((1, crc))),
            // The state: others are floating-point numbers, whose text has another precision.
            ("xarm", "arm") => (7..8, None),
            ("xarm", _) => (7..frame.len(), None),
            // A status has no checksum.
            _ if frame.len() <= 4 => (0..0, None),
            _ => (2..end, Some((2, sum))),
        }
    }

    /// A recording of every frame, whole and damaged in several ways.
    pub(super) fn damage(&self, frames: &[Vec<u8>]) -> Vec<u8> {
        let mut recording = Vec::new();
        // The first frames are damaged behind their headers, which identify the older generation.
        for (nth, frame) in (4..).zip(frames) {
            recording.extend(frame);
            for damaged in self.damaged(frame, nth) {
                recording.extend(damaged);
                recording.extend(frame);
            }
        }
        recording
    }

    /// A frame with a flipped bit, without a byte, with another end, without its end; and a false header. TCP damages
    /// nothing, but an arm may be wrong.
    fn damaged(&self, frame: &[u8], nth: usize) -> Vec<Vec<u8>> {
        if self.arm == "xarm" {
            return XARM_ERRORS.map(<[u8]>::to_vec).into();
        }
        let at = nth % frame.len();
        let (before, after) = frame.split_at(at);
        let flipped = [before, &[after[0] ^ 1 << (nth % 8)], &after[1..]].concat();
        let lost = [before, &after[1..]].concat();
        let other_end = [&frame[..frame.len() - 1], &[0x55]].concat();
        vec![flipped, lost, other_end, before.to_vec(), vec![0x55, 0xAA]]
    }
}

/// Frames of the fuzz corpus, in order.
pub(super) fn document_frames(name: &str, start: usize) -> Result<Vec<Vec<u8>>> {
    let mut frames = Vec::new();
    for nth in 0.. {
        let path = root().join(CORPUS).join(format!("document-{name}-{nth}"));
        if !path.exists() {
            break;
        }
        frames.push(fs::read(path)?.split_off(start));
    }
    ensure!(!frames.is_empty(), "{CORPUS} has no document-{name}-0");
    Ok(frames)
}

/// A checksum of bytes.
type Check = fn(&[u8]) -> u8;

fn crc(bytes: &[u8]) -> u8 {
    Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(bytes) as u8
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

fn parity(bytes: &[u8]) -> u8 {
    sum(bytes) & 1
}

/// A frame with the data byte of most requests.
fn ling_frame(command: u8, function: u8) -> Vec<u8> {
    let body = [command, function, 1, 0xFE];
    [&[0xAA][..], &body, &[crc(&body), 0xFF]].concat()
}

/// A frame with this number of more data bytes.
fn longer_ling_frame(frame: &[u8], more: u8) -> Vec<u8> {
    let data = &frame[4..frame.len() - 2];
    let extra: Vec<u8> = (0x77..).take(more.into()).collect();
    let body = [&frame[1..3], &[data.len() as u8 + more], data, &extra].concat();
    [&[0xAA][..], &body, &[crc(&body), 0xFF]].concat()
}

/// A frame with two more parameters.
fn longer_xarm_frame(frame: &[u8]) -> Vec<u8> {
    [&frame[..5], &[frame[5] + 2], &frame[6..], &[0x77, 0x78]].concat()
}

/// Frames with no parameter, and with one.
fn xarm_frames(register: u8) -> [Vec<u8>; 2] {
    [
        vec![0, 1, 0, 2, 0, 2, register, 0],
        vec![0, 1, 0, 2, 0, 3, register, 0, 1],
    ]
}

/// The frames of a row, and of a command to a servo, with no value and with one.
fn alpha1_frames(byte: u8) -> Vec<Vec<u8>> {
    let frame = |row: u8, data: [u8; 6]| [&[row, row.rotate_left(4)][..], &data, &[sum(&data), 0xED]].concat();
    vec![
        frame(byte, [0; 6]),
        frame(byte, [1, 0, 0, 0, 0, 0]),
        frame(0xFA, [1, byte, 0, 0, 0, 0]),
        frame(0xFC, [1, byte, 0, 0, 0, 0]),
    ]
}
