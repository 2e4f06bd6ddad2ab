//! The units of a recording, and their data.

use std::borrow::Cow;

use super::doubts::{Doubt, Place};
use super::framed::Recorded;
use super::log::Logged;
use crate::args::Speaker;

/// What a unit of a recording is: a line, a packet, a record, a run of bytes. The result of a reader is this or a
/// [`Doubt`]. There is no other: a reader cannot skip.
#[derive(Debug, PartialEq)]
pub(super) enum Unit<'a> {
    /// A frame of a CAN bus.
    Can(Logged<'a>),
    /// Bytes of a line.
    Bytes(Bytes<'a>),
    /// A frame of an arm, or bytes between frames, from a recording of such.
    #[cfg_attr(
        not(feature = "recordings"),
        expect(dead_code, reason = "of MCAP and pcapng files only")
    )]
    Frame(Recorded<'a>),
    /// A comment, a heading, a blank line, or a part of the file's structure.
    Comment,
    /// A record of this kind, which has neither frames nor bytes of an arm.
    Other(&'static str),
    /// Frames that the logging program lost.
    Dropped(u64),
}

impl Unit<'_> {
    /// A line of a text that has none of the bytes.
    pub(super) const NO_BYTES: Unit<'static> = Unit::Other("lines without bytes");
}

/// The result of a reader for one unit.
pub(super) type Read<'a> = Result<Unit<'a>, Doubt>;

/// A consumer of units, each with its place.
pub(super) type Take<'a> = dyn FnMut(Place<'_>, Read<'_>) + 'a;

/// Bytes of a line.
#[derive(Debug, PartialEq)]
pub(super) struct Bytes<'a> {
    pub(super) hint: Hint,
    pub(super) bytes: Cow<'a, [u8]>,
    /// Time in ns; 0 if the recording has no times.
    pub(super) nanos: u64,
    /// The transfer that had them; `None` for a recording of one line.
    pub(super) transfer: Option<Transfer>,
    /// The reason why bytes before these are missing.
    pub(super) gap: Option<Doubt>,
}

impl<'a> Bytes<'a> {
    /// Bytes without a mark of their direction.
    pub(super) fn new(bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        Self::of(Hint::None, bytes)
    }

    pub(super) fn of(hint: Hint, bytes: impl Into<Cow<'a, [u8]>>) -> Self {
        Self {
            hint,
            bytes: bytes.into(),
            nanos: 0,
            transfer: None,
            gap: None,
        }
    }
}

/// What a recording says about the direction of bytes. Frames may say otherwise.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Hint {
    None,
    /// The mark of this sender.
    From(Speaker),
    /// No mark, behind bytes with one.
    Continued,
}

impl From<Option<Speaker>> for Hint {
    fn from(from: Option<Speaker>) -> Self {
        from.map_or(Self::None, Self::From)
    }
}

/// A transfer of USB.
#[derive(Debug, PartialEq)]
pub(super) struct Transfer {
    /// Bus and address of the device.
    pub(super) device: (u16, u16),
    pub(super) endpoint: u8,
    /// Time and endpoint, as they are printed.
    pub(super) place: String,
}
