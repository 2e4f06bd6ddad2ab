//! Alpha1 frames, by the table of the PC protocol and the servos' manual: header, its nibbles swapped, DATA, CHECK, end
//! mark ED.

use armwire::alpha1::{Expect, ServoAnswer};
use armwire::framing::Reason;

use super::{Scan, checked, length};

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
fn row(header: u8, expect: Expect) -> Option<Row> {
    let row = match (expect, header) {
        (_, 0xFA | 0xFC) => Row::Fixed(10),
        (Expect::Requests, 0xF1 | 0xEF | 0xF2 | 0xF5 | 0xF4 | 0xF9) => Row::Fixed(10),
        (Expect::Requests, 0xFB) => Row::Fixed(33),
        (Expect::Requests, 0xF3) => Row::Text,
        (Expect::Responses(_), 0xF1) => Row::Text,
        (Expect::Responses(_), 0xEF) => Row::Fixed(8),
        (Expect::Responses(_), 0xF5) => Row::Fixed(15),
        (Expect::Responses(_), 0xFB) => Row::Fixed(10),
        (Expect::Responses(_), 0xF2 | 0xF4 | 0xF9 | 0xF3) => Row::Outcome,
        _ => return None,
    };
    Some(row)
}

/// The piece at the start of `bytes`. The content of a frame is the first byte of its header and DATA, or the single
/// byte of a servo.
pub fn scan(bytes: &[u8], expect: Expect) -> Scan {
    let acknowledges = match expect {
        Expect::Responses(Some(ServoAnswer::Acknowledgement(id))) => bytes[0] == id.get().wrapping_add(0xAA),
        _ => false,
    };
    let row = row(bytes[0], expect);
    if let Some(row) = row
        && bytes.get(1).is_none_or(|second| *second == bytes[0].rotate_left(4))
    {
        // The byte of some servos looks like a header. With nothing behind it, it is none.
        return match scan_row(bytes, row) {
            Scan::Incomplete(_) if acknowledges && bytes.len() == 1 => single(bytes[0]),
            scan => scan,
        };
    }
    match bytes[0] {
        byte if acknowledges => single(byte),
        0 => Scan::Padding,
        _ => Scan::Noise(Reason::Stray),
    }
}

fn single(byte: u8) -> Scan {
    Scan::Frame {
        len: 1,
        content: vec![byte],
    }
}

/// The piece with the header of a row.
fn scan_row(bytes: &[u8], row: Row) -> Scan {
    if bytes.len() < 3 {
        // The third byte may contain the length, so only one more byte is certain.
        return Scan::Incomplete(1);
    }
    let third = usize::from(bytes[2]);
    let len = match row {
        // Row FB has 01 here, and a frame of the Bluetooth protocol its length, less one.
        Row::Fixed(_) if bytes[0] == 0xFB && third != 1 => {
            if third < 6 {
                let (offset, expected, got) = (2, &[1], bytes[2]);
                return Scan::Noise(Reason::Byte { offset, expected, got });
            }
            third + 1
        }
        Row::Fixed(len) => len,
        Row::Text => {
            let (min, max, got) = (1, 255, third);
            if !(min..=max).contains(&got) {
                return Scan::Noise(length(min, max, got));
            }
            got + 4
        }
        Row::Outcome => return scan_outcome(bytes),
    };
    match checked(bytes, len, 2, check, 0xED) {
        Ok(data) => Scan::Frame {
            len,
            content: [&bytes[..1], &data].concat(),
        },
        Err(scan) => scan,
    }
}

fn scan_outcome(bytes: &[u8]) -> Scan {
    if bytes.len() < 4 {
        return Scan::Incomplete(4 - bytes.len());
    }
    if ![0xAA, 0xEE].contains(&bytes[2]) {
        let (offset, expected, got) = (2, &[0xAA, 0xEE], bytes[2]);
        return Scan::Noise(Reason::Byte { offset, expected, got });
    }
    let (expected, got) = (0xED, bytes[3]);
    if expected != got {
        return Scan::Noise(Reason::Tail { expected, got });
    }
    Scan::Frame {
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
