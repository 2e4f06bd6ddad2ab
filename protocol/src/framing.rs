//! The boundaries of frames.
//!
//! This layer is for firmware, monitors and implementations of other arms. It is less stable than the
//! [client](crate::Client): see [Stability](crate#stability).

use core::fmt::{self, Debug};

use crate::BufferTooShort;
use crate::error::either;

/// The verdict of a [`Framing`] on the front of a window.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Scan {
    /// A verdict needs at least this many more bytes, one or more. It is the exact number of missing bytes once the
    /// header contains the frame's length.
    Need(usize),
    /// The first `n` bytes are a frame.
    Frame(usize),
    /// The first `n` bytes, at least one, are not part of a frame. If the length of a rejected frame is known, `n` may
    /// exceed the window.
    Noise(usize, Reason),
    /// The first `n` bytes, at least one, are padding between frames, for example zeros in a USB HID report. They are
    /// not an error.
    Padding(usize),
    /// No byte from here on can be decoded. Only on a [`LOSSLESS`](Framing::LOSSLESS) line.
    Broken(Reason),
}

/// The reason why bytes are not part of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
// Without a bound for each field: the bound for `&'static [u8]` is not provable where one for `&'a [u8]` is assumed.
#[cfg_attr(feature = "defmt", derive(defmt::Format), defmt(bound()))]
#[non_exhaustive]
pub enum Reason {
    /// No frame starts here.
    Stray,
    /// A frame seemed to start here, but its length is outside the limits of the protocol or the decoder.
    Length {
        /// The minimum length.
        min: u16,
        /// The maximum length.
        max: u16,
        /// The length.
        got: u16,
    },
    /// A frame seemed to start here, but a byte is not one of the allowed values.
    Byte {
        /// The byte's offset from the start of the frame.
        offset: u8,
        /// The byte.
        got: u8,
        /// The allowed values.
        expected: &'static [u8],
    },
    /// A frame seemed to start here, but its checksum does not match.
    Checksum {
        /// The checksum of the received bytes.
        expected: u8,
        /// The received checksum.
        got: u8,
    },
    /// A frame seemed to start here, but its terminator is missing.
    Tail {
        /// The terminator of this protocol.
        expected: u8,
        /// The byte in its place.
        got: u8,
    },
    /// A frame seemed to start here, but the line went idle before its end.
    Truncated {
        /// The number of missing bytes.
        missing: usize,
    },
    /// A request ended while it was partly transmitted. Only on a [`LOSSLESS`](Framing::LOSSLESS) line.
    Abandoned,
}

impl fmt::Display for Reason {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Stray => f.write_str("no frame starts here"),
            Self::Length { min, max, got } => write!(f, "length field is {got}, must be {min}..={max}"),
            Self::Byte { offset, got, expected } => {
                let expected = either(expected, |byte, f| write!(f, "{byte:#04x}"));
                write!(f, "byte {offset} is {got:#04x}, expected {expected}")
            }
            Self::Checksum { expected, got } => write!(f, "checksum {got:#04x}, expected {expected:#04x}"),
            Self::Tail { expected, got } => write!(f, "end mark {got:#04x}, expected {expected:#04x}"),
            Self::Truncated { missing } => write!(f, "line went idle with {missing} bytes missing"),
            Self::Abandoned => f.write_str("a request ended while it was partly transmitted"),
        }
    }
}

impl core::error::Error for Reason {}

/// The place of a frame's length, for a receiver that counts bytes without [`Framing::scan`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Length {
    /// The first byte of every frame.
    pub header: u8,
    /// The index of the length byte.
    pub at: usize,
    /// The maximum value of that byte.
    pub max: u8,
    /// The number of bytes of a frame that the value does not count.
    pub overhead: usize,
}

/// The length of a [void](Framing::VOID) for a protocol whose length field has one byte and counts all but at most six
/// bytes.
pub const LONGEST_VOID: usize = u8::MAX as usize + 6;

/// The boundaries of frames on one kind of line.
///
/// An implementation keeps no state of the stream: it classifies the front of the bytes received so far. The
/// [`Decoder`](crate::decoder::Decoder) keeps the bytes, the [`Exchange`](crate::exchange::Exchange) provides the
/// expectation.
pub trait Framing: Copy + Eq + Debug {
    /// True if the line delivers every byte, in order, as TCP does. On such a line silence has no meaning, and bytes
    /// that cannot begin a frame break the stream ([`Scan::Broken`]).
    const LOSSLESS: bool = false;

    /// The length of a *void*: zeros after which a receiver has discarded a partly transmitted request, whatever its bytes
    /// are, and has executed none. That is the longest frame that a receiver may wait for, if no request ends with a zero:
    /// [`LONGEST_VOID`] on most serial lines.
    ///
    /// `None` if zeros may complete a request, for example one that ends with a checksum: a [client](crate::Client) then
    /// transmits each request to its end. A [lossless](Self::LOSSLESS) line has no void, because it breaks instead.
    const VOID: Option<usize> = None;

    /// The expectation of the next frame, for protocols whose frames do not contain their length; otherwise `()`.
    type Expect: Copy + Eq + Debug;

    /// Classifies the front of `window`. A verdict other than [`Scan::Need`] does not change when more bytes follow, except
    /// that a run of stray bytes or padding may grow.
    fn scan(&self, window: &[u8], expect: Self::Expect) -> Scan;

    /// Classifies the front of `window` on an idle line: a frame that [`scan`](Self::scan) considers incomplete is
    /// truncated, unless silence ends a frame of this protocol.
    fn scan_idle(&self, window: &[u8], expect: Self::Expect) -> Scan {
        match self.scan(window, expect) {
            Scan::Need(missing) if !Self::LOSSLESS => Scan::Noise(1, Reason::Truncated { missing }),
            verdict => verdict,
        }
    }

    /// The last byte of every frame, if it is always the same.
    fn terminator(&self, expect: Self::Expect) -> Option<u8>;

    /// The place of the next frame's length. `None` if it is not one byte at a fixed place.
    fn length(&self, _expect: Self::Expect) -> Option<Length> {
        None
    }

    /// The length of the shortest frame, in bytes.
    fn shortest(&self, expect: Self::Expect) -> usize;

    /// The expectation of an arm, and of a monitor of its host.
    fn requests(&self) -> Self::Expect;

    /// The expectation of a host without a pending request.
    fn unsolicited(&self) -> Self::Expect;
}

/// The verdict on a window that starts with a header, if the frame has `total` bytes: it ends with a checksum over all
/// but its first `uncovered` bytes, and a terminator.
///
/// ```
/// use armwire::framing::{Reason, Scan, verify};
///
/// /// The low byte of the sum.
/// fn sum(bytes: &[u8]) -> u8 {
///     bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
/// }
/// let frame = [0x55, 0x01, 0x02, 0x03, 0xED];
/// assert_eq!(verify(&frame, 5, 1, sum, 0xED), Scan::Frame(5));
/// assert_eq!(verify(&frame[..3], 5, 1, sum, 0xED), Scan::Need(2));
/// let damaged = [0x55, 0x01, 0x02, 0x04, 0xED];
/// assert_eq!(verify(&damaged, 5, 1, sum, 0xED), Scan::Noise(1, Reason::Checksum { expected: 3, got: 4 }));
/// ```
pub fn verify(window: &[u8], total: usize, uncovered: usize, checksum: impl Fn(&[u8]) -> u8, terminator: u8) -> Scan {
    let noise = |reason| Scan::Noise(1, reason);
    match window.get(uncovered..total) {
        Some(&[ref covered @ .., got, end]) if end == terminator => match checksum(covered) {
            expected if expected == got => Scan::Frame(total),
            expected => noise(Reason::Checksum { expected, got }),
        },
        Some(&[.., got]) => noise(Reason::Tail {
            expected: terminator,
            got,
        }),
        Some([]) | None => Scan::Need(total.saturating_sub(window.len()).max(1)),
    }
}

/// Writes bytes at the front of `out` and returns their number.
///
/// # Errors
///
/// [`BufferTooShort`] if `out` is too short. Nothing is written then.
///
/// ```
/// use armwire::framing::write;
///
/// let (mut out, data) = ([0; 4], [1, 2]);
/// assert_eq!(write(&mut out, [0x55].into_iter().chain(data)), Ok(3));
/// assert_eq!(out, [0x55, 1, 2, 0]);
/// assert!(write(&mut out[..2], [0x55].into_iter().chain(data)).is_err());
/// ```
// Without it, a public generic function is compiled apart from its callers, which are larger then.
#[inline]
pub fn write(out: &mut [u8], bytes: impl Iterator<Item = u8> + Clone) -> Result<usize, BufferTooShort> {
    let (needed, got) = (bytes.clone().count(), out.len());
    let out = out.get_mut(..needed).ok_or(BufferTooShort { needed, got })?;
    let mut out = out.iter_mut();
    // `for_each` writes one part of the chain after the other; `zip` would compare before each byte.
    bytes.for_each(|byte| {
        if let Some(to) = out.next() {
            *to = byte;
        }
    });
    Ok(needed)
}
