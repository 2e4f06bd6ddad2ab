//! Alpha1 frames, by the table of the PC protocol and the servos' manual: header, its nibbles swapped, DATA, CHECK, end
//! mark ED.

use armwire::framing::Reason;

use super::{Look, checked, length};

/// The sender, and the servo whose single byte is expected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Speaker {
    /// The PC.
    Host,
    /// The robot or a servo, and the id of the servo that is to acknowledge.
    Robot(Option<u8>),
}

/// The layout of the rest of a frame.
enum Row {
    /// A fixed length in bytes.
    Fixed(usize),
    /// The third byte counts itself and the text after it.
    Text,
    /// Four bytes without CHECK, the third AA or EE.
    Outcome,
}

/// The row of the table that a header names.
fn row(header: u8, speaker: Speaker) -> Option<Row> {
    let row = match (speaker, header) {
        (_, 0xFA | 0xFC) => Row::Fixed(10),
        (Speaker::Host, 0xF1 | 0xEF | 0xF2 | 0xF5 | 0xF4 | 0xF9) => Row::Fixed(10),
        (Speaker::Host, 0xFB) => Row::Fixed(33),
        (Speaker::Host, 0xF3) => Row::Text,
        (Speaker::Robot(_), 0xF1) => Row::Text,
        (Speaker::Robot(_), 0xEF) => Row::Fixed(8),
        (Speaker::Robot(_), 0xF5) => Row::Fixed(15),
        (Speaker::Robot(_), 0xFB) => Row::Fixed(10),
        (Speaker::Robot(_), 0xF2 | 0xF4 | 0xF9 | 0xF3) => Row::Outcome,
        _ => return None,
    };
    Some(row)
}

/// The item at the start of `bytes`. The content of a frame is the first byte of its header and DATA, or the single
/// byte of a servo.
pub fn look(bytes: &[u8], speaker: Speaker) -> Look {
    let acknowledges = match speaker {
        Speaker::Robot(Some(id)) => bytes[0] == id.wrapping_add(0xAA),
        _ => false,
    };
    let row = row(bytes[0], speaker);
    if let Some(row) = row
        && bytes.get(1).is_none_or(|second| *second == bytes[0].rotate_left(4))
    {
        // The byte of some servos looks like a header. With nothing behind it, it is none.
        return match look_at_row(bytes, row) {
            Look::Unfinished(_) if acknowledges && bytes.len() == 1 => single(bytes[0]),
            look => look,
        };
    }
    match bytes[0] {
        byte if acknowledges => single(byte),
        0 => Look::Filling,
        _ => Look::Nothing(Reason::Stray),
    }
}

fn single(byte: u8) -> Look {
    Look::Frame {
        len: 1,
        content: vec![byte],
    }
}

/// The item with the header of a row.
fn look_at_row(bytes: &[u8], row: Row) -> Look {
    if bytes.len() < 3 {
        // The third byte may contain the length, so only one more byte is certain.
        return Look::Unfinished(1);
    }
    let third = usize::from(bytes[2]);
    let len = match row {
        // Row FB has 01 here, and a frame of the Bluetooth protocol its length, less one.
        Row::Fixed(_) if bytes[0] == 0xFB && third != 1 => {
            if third < 6 {
                let (offset, expected, got) = (2, &[1], bytes[2]);
                return Look::Nothing(Reason::Byte { offset, expected, got });
            }
            third + 1
        }
        Row::Fixed(len) => len,
        Row::Text => {
            let (min, max, got) = (1, 255, third);
            if !(min..=max).contains(&got) {
                return Look::Nothing(length(min, max, got));
            }
            got + 4
        }
        Row::Outcome => return look_at_outcome(bytes),
    };
    match checked(bytes, len, 2, check, 0xED) {
        Ok(data) => Look::Frame {
            len,
            content: [&bytes[..1], &data].concat(),
        },
        Err(look) => look,
    }
}

fn look_at_outcome(bytes: &[u8]) -> Look {
    if bytes.len() < 4 {
        return Look::Unfinished(4 - bytes.len());
    }
    if ![0xAA, 0xEE].contains(&bytes[2]) {
        let (offset, expected, got) = (2, &[0xAA, 0xEE], bytes[2]);
        return Look::Nothing(Reason::Byte { offset, expected, got });
    }
    let (expected, got) = (0xED, bytes[3]);
    if expected != got {
        return Look::Nothing(Reason::Tail { expected, got });
    }
    Look::Frame {
        len: 4,
        content: vec![bytes[0], bytes[2]],
    }
}

/// A frame with a CHECK.
pub fn frame(header: u8, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![header, header.rotate_left(4)];
    frame.extend(data);
    frame.extend([check(data), 0xED]);
    frame
}

/// The low byte of the sum of DATA.
fn check(data: &[u8]) -> u8 {
    let sum: usize = data.iter().map(|byte| usize::from(*byte)).sum();
    (sum % 256) as u8
}
