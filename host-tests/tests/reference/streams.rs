//! Streams on a line: intact frames, damaged ones, nested frames, noise.

use armwire_host_tests::reference::{alpha1, legacy, ling, xarm};
use oorandom::Rand32;

/// The frames of a line and the bytes that look like parts of them.
pub(crate) struct Dialect {
    /// Any frame.
    pub(crate) frame: fn(&mut Rand32) -> Vec<u8>,
    /// Headers, end marks, lengths and other bytes with a meaning.
    pub(crate) marks: &'static [u8],
}

pub(crate) fn below(random: &mut Rand32, end: usize) -> usize {
    random.rand_range(0..end as u32) as usize
}

fn byte(random: &mut Rand32) -> u8 {
    random.rand_range(0..256) as u8
}

fn pick<T: Copy>(random: &mut Rand32, from: &[T]) -> T {
    from[below(random, from.len())]
}

impl Dialect {
    /// The bytes between two silences.
    pub(crate) fn stream(&self, random: &mut Rand32) -> Vec<u8> {
        let parts = 1 + below(random, 6);
        (0..parts).flat_map(|_| self.part(random)).collect()
    }

    /// A frame, part of a frame, or noise.
    fn part(&self, random: &mut Rand32) -> Vec<u8> {
        let frame = (self.frame)(random);
        match random.rand_range(0..8) {
            0..3 => frame,
            3 => {
                let len = below(random, 25);
                self.bytes(random, len)
            }
            4 => frame[..below(random, frame.len() + 1)].to_vec(),
            5 => {
                // A frame in the middle of another.
                let (start, end) = frame.split_at(below(random, frame.len() + 1));
                [start, &(self.frame)(random), end].concat()
            }
            6 => {
                // A wrong length, or another wrong byte near the front.
                let mut frame = frame;
                let at = below(random, frame.len().min(6));
                frame[at] = self.mark(random);
                frame
            }
            _ => self.damaged(random, frame),
        }
    }

    /// The frame with one or two faults.
    fn damaged(&self, random: &mut Rand32, mut frame: Vec<u8>) -> Vec<u8> {
        for _ in 0..1 + below(random, 2) {
            let at = below(random, frame.len().max(1));
            match random.rand_range(0..5) {
                _ if frame.is_empty() => {}
                0 => frame[at] ^= 1 << random.rand_range(0..8),
                1 => frame[at] = self.mark(random),
                2 => drop(frame.remove(at)),
                3 => frame.insert(at, frame[at]),
                _ => frame.insert(at, self.mark(random)),
            }
        }
        frame
    }

    /// A byte that is a mark more often than by chance.
    fn mark(&self, random: &mut Rand32) -> u8 {
        if random.rand_range(0..2) == 0 {
            pick(random, self.marks)
        } else {
            byte(random)
        }
    }

    fn bytes(&self, random: &mut Rand32, len: usize) -> Vec<u8> {
        (0..len).map(|_| self.mark(random)).collect()
    }
}

/// A length that is short more often than by chance.
fn length(random: &mut Rand32, most: usize) -> usize {
    let most = pick(random, &[2, 4, 16, most]);
    below(random, most + 1)
}

fn ling_data(random: &mut Rand32, most: usize) -> Vec<u8> {
    let len = length(random, most);
    LING.bytes(random, len)
}

/// A Ling line, in either direction.
pub(crate) const LING: Dialect = Dialect {
    frame: |random| {
        let data = ling_data(random, 64);
        match random.rand_range(0..8) {
            0 => vec![0xAA, 0xFE, 0x00, 0x00, 0xFE, 0x93, 0xFF],
            1 => ling::frame(0xFE, 0x00, &[]),
            _ => ling::frame(pick(random, &[0x01, 0x04, 0x05, 0x06, 0xFE]), byte(random) % 4, &data),
        }
    },
    marks: &[
        0xAA, 0xAA, 0xAA, 0xFF, 0xFF, 0xFE, 0x93, 0xC8, 0x00, 0x01, 0x06, 0x0F, 0x40, 0x41,
    ],
};

/// A line of Ling's older generation.
pub(crate) const LEGACY: Dialect = Dialect {
    frame: |random| {
        let data = ling_data(random, 59);
        legacy::frame(pick(random, &[0x02, 0x04, 0x12, 0x14]), &data)
    },
    marks: &[0xAA, 0xAA, 0xFF, 0xFF, 0x14, 0x12, 0x07, 0x00, 0x01, 0x3B, 0x3C],
};

/// Requests to an xArm.
pub(crate) const XARM_HOST: Dialect = Dialect {
    frame: |random| xarm_frame(random, 1),
    marks: XARM_MARKS,
};

/// Answers of an xArm.
pub(crate) const XARM_ARM: Dialect = Dialect {
    frame: |random| xarm_frame(random, 2),
    marks: XARM_MARKS,
};

const XARM_MARKS: &[u8] = &[0, 0, 0, 0, 1, 2, 2, 3, 4, 6, 0x10, 0x2A, 0xFD, 0xFE, 0xFF];

fn xarm_frame(random: &mut Rand32, least: usize) -> Vec<u8> {
    if random.rand_range(0..8) == 0 {
        return xarm::frame(0, 1, &[0, 0]);
    }
    let protocol = pick(random, &[0, 2, 2, 2, 3]);
    let least = if protocol == 0 { 2 } else { least };
    let len = least + length(random, 252);
    let body = XARM_HOST.bytes(random, len);
    xarm::frame(random.rand_range(0..0x1_0000) as u16, protocol, &body)
}

/// Requests to an Alpha1 and its servos.
pub(crate) const ALPHA1_HOST: Dialect = Dialect {
    frame: |random| match random.rand_range(0..6) {
        0 if random.rand_range(0..4) == 0 => false_count(random, 0xF3),
        0 => alpha1::frame(0xF3, &alpha1_text(random)),
        1 => {
            let mut data = ALPHA1_HOST.bytes(random, 29);
            data[0] = 1;
            alpha1::frame(0xFB, &data)
        }
        2 => alpha1_bluetooth(random),
        _ => {
            let data = ALPHA1_HOST.bytes(random, 6);
            alpha1::frame(pick(random, &[0xF1, 0xEF, 0xF2, 0xF5, 0xF4, 0xF9, 0xFA, 0xFC]), &data)
        }
    },
    marks: ALPHA1_MARKS,
};

/// Answers of an Alpha1 and its servos.
pub(crate) const ALPHA1_ROBOT: Dialect = Dialect {
    frame: |random| match random.rand_range(0..8) {
        0 if random.rand_range(0..4) == 0 => false_count(random, 0xF1),
        0 => alpha1::frame(0xF1, &alpha1_text(random)),
        1 => alpha1::frame(0xEF, &ALPHA1_ROBOT.bytes(random, 4)),
        2 => alpha1::frame(0xF5, &ALPHA1_ROBOT.bytes(random, 11)),
        3 => alpha1::frame(0xFB, &[1, 0xAA, 0, 0, 0, 0]),
        4 => alpha1_bluetooth(random),
        5 => vec![byte(random)],
        6 => {
            let header: u8 = pick(random, &[0xF2, 0xF4, 0xF9, 0xF3]);
            vec![header, header.rotate_left(4), pick(random, &[0xAA, 0xEE]), 0xED]
        }
        _ => alpha1::frame(pick(random, &[0xFA, 0xFC]), &ALPHA1_ROBOT.bytes(random, 6)),
    },
    marks: ALPHA1_MARKS,
};

const ALPHA1_MARKS: &[u8] =
    b"\xF1\x1F\xEF\xFE\xF2\x2F\xF5\x5F\xFB\xBF\xF4\x4F\xF9\x9F\xF3\x3F\xFA\xAF\xFC\xCF\xED\xED\xAA\xEE\x01\x06\0\0\x3C\x3D";

/// The header of a text frame, or of a Bluetooth frame of the robot, with a count below the minimum.
fn false_count(random: &mut Rand32, header: u8) -> Vec<u8> {
    match random.rand_range(0..3) {
        0 => vec![0xFB, 0xBF, pick(random, &[0, 2, 5])],
        _ => vec![header, header.rotate_left(4), 0],
    }
}

fn alpha1_text(random: &mut Rand32) -> Vec<u8> {
    let len = length(random, 254);
    let mut data = ALPHA1_HOST.bytes(random, len + 1);
    data[0] = data.len() as u8;
    data
}

fn alpha1_bluetooth(random: &mut Rand32) -> Vec<u8> {
    let len = 3 + length(random, 57);
    let mut data = ALPHA1_HOST.bytes(random, len);
    data[0] = len as u8 + 3;
    alpha1::frame(0xFB, &data)
}
