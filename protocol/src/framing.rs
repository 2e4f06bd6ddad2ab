//! Where frames begin and end.

use core::fmt;

use crate::error::write_either;

/// What a [`Framing`] makes of the bytes at the front of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scan {
    /// No verdict before this many more bytes arrive (at least one).
    Need(usize),
    /// The first `n` bytes are a frame.
    Frame(usize),
    /// The first `n` bytes (at least one) belong to no frame. They may be more than the window has, where a length says
    /// where the next frame begins.
    Skip(usize, Reason),
    /// The first `n` bytes (at least one) show that nothing from here on can be read. Only on a
    /// [`RELIABLE`](Framing::RELIABLE) line.
    Broken(usize, Reason),
    /// The first `n` bytes (at least one) fill the room between frames, as zeros fill a USB HID report. They are no
    /// error and are dropped without a word.
    Fill(usize),
}

/// Why bytes were not part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
// On a microcontroller fields lie as declared: behind a tag of two bytes there are two or four, then words. To copy three bytes
// at an odd address a Cortex-M0 calls `memcpy`, which takes nearly as much stack as the decoder. A computer is faster with what
// the compiler chooses. The layout is no promise.
#[cfg_attr(target_pointer_width = "32", repr(u16))]
pub enum Reason {
    /// No frame starts here.
    Stray,
    /// A frame seemed to start here, but no message of this protocol has such a length.
    Length {
        /// The least that the length field of a message may say.
        min: u16,
        /// The most that the length field of a message may say.
        max: u16,
        /// What it said.
        got: u16,
    },
    /// A frame seemed to start here, but a byte that may have few values has another.
    Byte {
        /// Where it is, in bytes from the start of the frame.
        offset: u8,
        /// What it is.
        got: u8,
        /// What it may be.
        expected: &'static [u8],
    },
    /// A frame seemed to start here, but its checksum does not match.
    Checksum {
        /// The checksum of the bytes that arrived.
        expected: u8,
        /// The checksum that arrived with them.
        got: u8,
    },
    /// A frame seemed to start here, but its end mark is missing.
    Tail {
        /// The end mark of this protocol.
        expected: u8,
        /// The byte in its place.
        got: u8,
    },
    /// A frame seemed to start here, but the line went idle before its end.
    Truncated {
        /// How many bytes were still to come.
        missing: usize,
    },
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Stray => write!(f, "no frame starts here"),
            Self::Length { min, max, got } => write!(f, "length field says {got}, must be {min}..={max}"),
            Self::Byte { offset, expected, got } => {
                write!(f, "byte {offset} is {got:#04x}, expected ")?;
                write_either(f, expected, |f, byte| write!(f, "{byte:#04x}"))
            }
            Self::Checksum { expected, got } => write!(f, "checksum {got:#04x}, expected {expected:#04x}"),
            Self::Tail { expected, got } => write!(f, "end mark {got:#04x}, expected {expected:#04x}"),
            Self::Truncated { missing } => write!(f, "line went idle with {missing} bytes missing"),
        }
    }
}

/// A run of bytes that was dropped, and why.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Noise {
    /// Where the run starts, in bytes since the decoder was made.
    pub offset: u64,
    /// How many bytes were dropped.
    pub len: usize,
    /// Why.
    pub reason: Reason,
}

impl fmt::Display for Noise {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{} bytes at {}: {}", self.len, self.offset, self.reason)
    }
}

impl core::error::Error for Noise {}

/// Where frames begin and end on one kind of line.
///
/// An implementation is stateless: it is shown the bytes received so far and says what the front of them is. All
/// state lives in the [`Decoder`](crate::Decoder). `ling::Ling` is the one to read as an example.
pub trait Framing {
    /// The longest frame, in bytes. A decoder's buffer must hold one.
    const MAX_FRAME: usize;

    /// Whether the line gives every byte, in order, as TCP does. Then there is no noise to look past: bytes that cannot
    /// begin a frame break the stream for good ([`Scan::Broken`]), and a pause means nothing.
    const RELIABLE: bool;

    /// What the reader knows about the next frame, for protocols whose frames do not carry their own end. `()` where
    /// framing stands alone. What was found holds as long as the same is expected.
    type Expect: Copy + PartialEq;

    /// A frame whose envelope is good, borrowed from the decoder.
    type Frame<'a>: Copy;

    /// Says what the front of `window` is. The verdict on a prefix never changes when more bytes follow, except from
    /// [`Scan::Need`].
    fn scan(window: &[u8], expect: Self::Expect) -> Scan;

    /// What the front of `window`, for which [`scan`](Self::scan) waits for `missing` more bytes, is on a line that
    /// went idle: a false header, unless a protocol knows better.
    fn scan_idle(_window: &[u8], _expect: Self::Expect, missing: usize) -> Scan {
        Scan::Skip(1, Reason::Truncated { missing })
    }

    /// Views bytes for which [`scan`](Self::scan) said [`Scan::Frame`]. What `scan` has verified is not verified again:
    /// others may be `None` or a frame that is none.
    fn view(bytes: &[u8]) -> Option<Self::Frame<'_>>;
}

/// The verdict on a window that starts with a header, if the frame has `total` bytes: it ends with a checksum over all but
/// its first `uncovered` bytes, and an end mark.
#[cfg(any(feature = "ling", feature = "alpha1"))]
pub(crate) fn verify(
    window: &[u8],
    total: usize,
    uncovered: usize,
    checksum: impl Fn(&[u8]) -> u8,
    end_mark: u8,
) -> Scan {
    let skip = |reason| Scan::Skip(1, reason);
    match window.get(uncovered..total) {
        Some(&[ref covered @ .., got, end]) if end == end_mark => match checksum(covered) {
            expected if expected == got => Scan::Frame(total),
            expected => skip(Reason::Checksum { expected, got }),
        },
        Some(&[.., got]) => skip(Reason::Tail {
            expected: end_mark,
            got,
        }),
        Some([]) | None => Scan::Need(total.saturating_sub(window.len()).max(1)),
    }
}
