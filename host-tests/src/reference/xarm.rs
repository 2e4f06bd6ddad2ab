//! xArm frames, by the vendor's page: transaction id, protocol id and length, each two bytes and big-endian, then the
//! number of bytes given by the length.

use armwire::framing::Reason;
use armwire::xarm::Direction;

use super::{Piece, length};

/// The longest body that armwire takes: that of Modbus TCP.
const MAX_BODY: usize = 254;

/// The pieces of all bytes of a connection. Bytes with another protocol id are the last piece: they break the
/// connection. An incomplete frame, or incomplete skipped bytes, give no piece.
///
/// A frame's content is its transaction id, its protocol id and its body.
pub fn decode(recording: &[u8], direction: Direction) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut start = 0;
    while let Some(found) = scan(&recording[start..], direction) {
        match found {
            Ok(len) => {
                let at = start..start + len;
                let (ids, body) = (&recording[start..start + 4], &recording[start + 6..at.end]);
                let content = [ids, body].concat();
                start = at.end;
                pieces.push(Piece::Frame { at, content });
            }
            Err((seen, reason)) => {
                let at = start..start + seen;
                start = at.end;
                if start > recording.len() {
                    break;
                }
                pieces.push(Piece::Noise { at, reason });
                if seen < 6 {
                    break;
                }
            }
        }
    }
    pieces
}

/// The length of the frame at the start of `bytes`, or the length of invalid bytes with the reason: less than a header
/// if they break the connection. `None` if there are too few bytes.
fn scan(bytes: &[u8], direction: Direction) -> Option<Result<usize, (usize, Reason)>> {
    // A protocol id is at most 3, so its first byte is 0.
    for (offset, expected) in [(2_u8, &[0][..]), (3, &[0, 1, 2, 3][..])] {
        let at = usize::from(offset);
        let got = *bytes.get(at)?;
        if !expected.contains(&got) {
            return Some(Err((at + 1, Reason::Byte { offset, expected, got })));
        }
    }
    let protocol = bytes[3];
    let got = usize::from(*bytes.get(4)?) * 256 + usize::from(*bytes.get(5)?);
    // Standard Modbus has a unit and a function, a request a register, and a response a register and a state.
    let (min, max) = match (protocol, direction) {
        (1, _) => (2, 2),
        (0, _) | (_, Direction::Responses) => (2, MAX_BODY),
        (_, Direction::Requests) => (1, MAX_BODY - 1),
    };
    if got < min || got > max {
        return Some(Err((6 + got, length(min, max, got))));
    }
    let frame = bytes.get(..6 + got)?;
    if protocol == 1 {
        // The heartbeat, 00 00 00 01 00 02 00 00, is always the same.
        for offset in [0_u8, 1, 6, 7] {
            let got = frame[usize::from(offset)];
            if got != 0 {
                return Some(Err((
                    8,
                    Reason::Byte {
                        offset,
                        expected: &[0],
                        got,
                    },
                )));
            }
        }
    }
    Some(Ok(frame.len()))
}

/// A frame.
pub fn frame(transaction: u16, protocol: u16, body: &[u8]) -> Vec<u8> {
    let header = [transaction, protocol, body.len() as u16];
    let mut frame: Vec<u8> = header.into_iter().flat_map(u16::to_be_bytes).collect();
    frame.extend(body);
    frame
}
