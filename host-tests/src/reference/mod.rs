//! Plain decoders of whole recordings, to hold the streaming ones against.
//!
//! They are written from the documents alone (`docs/protocols`). Each looks at all that was recorded, copies what it
//! likes and starts over at the next byte. Of the crate under test they take nothing but the names of what can be wrong.
//!
//! ```
//! use armwire::framing::Reason;
//! use armwire_host_tests::reference::{Piece, decode, ling};
//!
//! let pieces = decode(&[0x11, 0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF], ling::look);
//! let noise = Piece::Noise { at: 0..1, reason: Reason::Stray };
//! let frame = Piece::Frame { at: 1..8, content: vec![0x06, 0x00, 0xFE] };
//! assert_eq!(pieces, [noise, frame]);
//! ```

pub mod alpha1;
pub mod legacy;
pub mod ling;
#[path = "../../../protocol/tests/vectors/mod.rs"]
pub mod vectors;
pub mod xarm;

use std::ops::Range;

use armwire::framing::Reason;

/// The item at the start of a non-empty sequence of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Look {
    /// A frame, with its length in bytes and its content.
    Frame {
        /// Bytes on the wire.
        len: usize,
        /// All that varies between frames of one length: header, length, checksum and end mark are left out.
        content: Vec<u8>,
    },
    /// A byte that fills the room between frames.
    Filling,
    /// No frame, and why.
    Nothing(Reason),
    /// A possible frame: this number of bytes is missing up to its end or its length.
    Unfinished(usize),
}

/// A part of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// A frame.
    Frame {
        /// The position of the frame.
        at: Range<usize>,
        /// The content, as in [`Look::Frame`].
        content: Vec<u8>,
    },
    /// Bytes of no frame.
    Noise {
        /// The position of the bytes.
        at: Range<usize>,
        /// Why they are of no frame.
        reason: Reason,
    },
}

/// The pieces of a recording after which the line was silent.
///
/// From the first byte on: either a frame begins here, and the next piece begins after it, or this byte is noise, and
/// the next piece begins at the next byte. Bytes beside each other that begin nothing are one piece. Filling is none.
pub fn decode(recording: &[u8], look: impl Fn(&[u8]) -> Look) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut start = 0;
    while start < recording.len() {
        let len = match look(&recording[start..]) {
            Look::Frame { len, content } => {
                let at = start..start + len;
                pieces.push(Piece::Frame { at, content });
                len
            }
            Look::Filling => 1,
            Look::Nothing(reason) => {
                let at = start..start + 1;
                pieces.push(Piece::Noise { at, reason });
                1
            }
            Look::Unfinished(missing) => {
                let (at, reason) = (start..start + 1, Reason::Truncated { missing });
                pieces.push(Piece::Noise { at, reason });
                1
            }
        };
        start += len;
    }
    join_strays(pieces)
}

/// Makes one piece of stray bytes beside each other.
fn join_strays(pieces: Vec<Piece>) -> Vec<Piece> {
    let mut joined: Vec<Piece> = Vec::new();
    for piece in pieces {
        match (joined.last_mut(), piece) {
            (
                Some(Piece::Noise {
                    at: run,
                    reason: Reason::Stray,
                }),
                Piece::Noise {
                    at,
                    reason: Reason::Stray,
                },
            ) if run.end == at.start => {
                run.end = at.end;
            }
            (_, piece) => joined.push(piece),
        }
    }
    joined
}

/// A length that is not one of `min` to `max`.
fn length(min: usize, max: usize, got: usize) -> Reason {
    let [min, max, got] = [min, max, got].map(|length| u16::try_from(length).unwrap());
    Reason::Length { min, max, got }
}

/// The item with a frame's header, if the frame has `len` bytes: the last byte is the end mark, and the byte before it
/// is `sum` of all bytes but the first `uncovered`. These are the parameters of the protocol.
fn checked(bytes: &[u8], len: usize, uncovered: usize, sum: fn(&[u8]) -> u8, mark: u8) -> Result<Vec<u8>, Look> {
    if bytes.len() < len {
        return Err(Look::Unfinished(len - bytes.len()));
    }
    let (expected, got) = (mark, bytes[len - 1]);
    if expected != got {
        return Err(Look::Nothing(Reason::Tail { expected, got }));
    }
    let (expected, got) = (sum(&bytes[uncovered..len - 2]), bytes[len - 2]);
    if expected != got {
        return Err(Look::Nothing(Reason::Checksum { expected, got }));
    }
    Ok(bytes[uncovered..len - 2].to_vec())
}
