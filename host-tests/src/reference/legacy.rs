//! Frames of Ling's older generation, by `docs/protocols/ling.md`: header AA, command, length, data, parity, end mark FF.

use armwire::framing::Reason;

use super::{Scan, checked, length};

/// The most data bytes that the vendor's drivers take.
const MAX_DATA: usize = 59;

/// The piece at the start of `bytes`. The content of a frame is its command and its data.
pub fn scan(bytes: &[u8]) -> Scan {
    if bytes[0] != 0xAA {
        return Scan::Noise(Reason::Stray);
    }
    if bytes.len() < 3 {
        return Scan::Incomplete(3 - bytes.len());
    }
    let got = usize::from(bytes[2]);
    if got > MAX_DATA {
        return Scan::Noise(length(0, MAX_DATA, got));
    }
    let len = 5 + got;
    match checked(bytes, len, 3, parity, 0xFF) {
        Ok(data) => Scan::Frame {
            len,
            content: [&bytes[1..2], &data].concat(),
        },
        Err(scan) => scan,
    }
}

/// A frame.
pub fn frame(command: u8, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xAA, command, data.len() as u8];
    frame.extend(data);
    frame.extend([parity(data), 0xFF]);
    frame
}

/// The sum of the data modulo 2.
fn parity(data: &[u8]) -> u8 {
    let sum: usize = data.iter().map(|byte| usize::from(*byte)).sum();
    (sum % 2) as u8
}
