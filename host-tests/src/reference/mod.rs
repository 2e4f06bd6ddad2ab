//! Plain decoders of whole recordings, for comparison with the streaming decoder.
//!
//! They are written from the documents alone (`docs/protocols`): each scans a whole recording, copies a frame, and
//! continues at the byte after it. From the crate under test they use only the names of expectations and errors.
//!
//! ```
//! use armwire::framing::Reason;
//! use armwire_host_tests::reference::{Piece, decode, ling};
//!
//! let pieces = decode(&[0x11, 0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF], ling::scan);
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

/// The piece at the start of a non-empty sequence of bytes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Scan {
    /// A frame, with its length in bytes and its content.
    Frame {
        /// Bytes on the wire.
        len: usize,
        /// All that varies between frames of one length: header, length, checksum and end mark are left out.
        content: Vec<u8>,
    },
    /// A byte that fills the room between frames.
    Padding,
    /// No frame, and why.
    Noise(Reason),
    /// A possible frame: this number of bytes is missing up to its end or its length.
    Incomplete(usize),
}

/// A part of a recording.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Piece {
    /// A frame.
    Frame {
        /// The position of the frame.
        at: Range<usize>,
        /// The content, as in [`Scan::Frame`].
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

impl Piece {
    /// The position of a frame. `None` for noise.
    pub fn frame(&self) -> Option<Range<usize>> {
        match self {
            Self::Frame { at, .. } => Some(at.clone()),
            Self::Noise { .. } => None,
        }
    }
}

/// The pieces of a recording after which the line was silent.
///
/// From the first byte on: either a frame begins here, and the next piece begins after it, or this byte is noise, and
/// the next piece begins at the next byte. Bytes beside each other that begin nothing are one piece. Padding is none.
pub fn decode(recording: &[u8], scan: impl Fn(&[u8]) -> Scan) -> Vec<Piece> {
    let mut pieces = Vec::new();
    let mut start = 0;
    while start < recording.len() {
        let len = match scan(&recording[start..]) {
            Scan::Frame { len, content } => {
                let at = start..start + len;
                pieces.push(Piece::Frame { at, content });
                len
            }
            Scan::Padding => 1,
            Scan::Noise(reason) => {
                let at = start..start + 1;
                pieces.push(Piece::Noise { at, reason });
                1
            }
            Scan::Incomplete(missing) => {
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

/// The piece with a frame's header, if the frame has `len` bytes: the last byte is the end mark, and the byte before it
/// is `sum` of all bytes but the first `uncovered`. These are the parameters of the protocol.
fn checked(bytes: &[u8], len: usize, uncovered: usize, sum: fn(&[u8]) -> u8, mark: u8) -> Result<Vec<u8>, Scan> {
    if bytes.len() < len {
        return Err(Scan::Incomplete(len - bytes.len()));
    }
    let (expected, got) = (mark, bytes[len - 1]);
    if expected != got {
        return Err(Scan::Noise(Reason::Tail { expected, got }));
    }
    let (expected, got) = (sum(&bytes[uncovered..len - 2]), bytes[len - 2]);
    if expected != got {
        return Err(Scan::Noise(Reason::Checksum { expected, got }));
    }
    Ok(bytes[uncovered..len - 2].to_vec())
}
