//! Ling frames, by section 1 of the document: header AA, command, function, length, data, checksum, end mark FF.

use armwire::framing::Reason;

use super::{Scan, checked, length};

/// The most data bytes that armwire takes; the document sets no limit.
const MAX_DATA: usize = 64;

/// The piece at the start of `bytes`. The content of a frame is its command, its function and its data.
pub fn scan(bytes: &[u8]) -> Scan {
    if bytes[0] != 0xAA {
        return Scan::Noise(Reason::Stray);
    }
    if bytes.len() < 4 {
        return Scan::Incomplete(4 - bytes.len());
    }
    let got = usize::from(bytes[3]);
    if got > MAX_DATA {
        return Scan::Noise(length(0, MAX_DATA, got));
    }
    // Section 2.6 prints one request, AA FE 00 00 FE 93 FF, with length 0 and a data byte nevertheless.
    let printed = bytes.starts_with(&[0xAA, 0xFE, 0x00, 0x00, 0xFE]);
    let len = if printed { 7 } else { 6 + got };
    match checked(bytes, len, 1, checksum, 0xFF) {
        Ok(mut content) => {
            content.remove(2);
            Scan::Frame { len, content }
        }
        Err(scan) => scan,
    }
}

/// A frame.
pub fn frame(command: u8, function: u8, data: &[u8]) -> Vec<u8> {
    let mut frame = vec![0xAA, command, function, data.len() as u8];
    frame.extend(data);
    frame.extend([checksum(&frame[1..]), 0xFF]);
    frame
}

/// The low byte of the CRC-32 of zlib and Ethernet, a bit at a time.
pub fn checksum(body: &[u8]) -> u8 {
    let mut crc = u32::MAX;
    for byte in body {
        crc ^= u32::from(*byte);
        for _ in 0..8 {
            crc = if crc % 2 == 1 { (crc / 2) ^ 0xEDB8_8320 } else { crc / 2 };
        }
    }
    (!crc % 256) as u8
}
