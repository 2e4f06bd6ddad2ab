//! Recordings of frames: those of `armwire monitor --mcap` and of `armwire decode --pcapng`.

use std::borrow::Cow;

use armwire_host::describe::Protocol;

use super::meaning::frame_meaning;
use super::output::{Item, OnLine, Output};
use super::sum::Part;
use crate::args::Speaker;

/// A frame on an arm's line, or a run of bytes between frames.
#[derive(Debug, PartialEq)]
pub(super) struct Recorded<'a> {
    /// Time in ns.
    pub(super) stamp: i64,
    pub(super) protocol: Protocol,
    /// The sender; `None` if it is unknown.
    pub(super) from: Option<Speaker>,
    pub(super) bytes: Cow<'a, [u8]>,
}

/// Shows frames, and counts them.
#[derive(Default)]
pub(super) struct Framed {
    pub(super) frames: u64,
    noise_bytes: u64,
    /// Number of frames without a known message.
    unknown: u64,
}

impl Framed {
    pub(super) fn take(&mut self, recorded: &Recorded<'_>, out: &dyn Output) {
        let Recorded {
            stamp,
            protocol,
            from,
            bytes,
        } = recorded;
        let meaning = frame_meaning(*protocol, bytes, *from);
        match &meaning {
            Ok(meaning) => {
                self.frames += 1;
                self.unknown += u64::from(!meaning.is_message);
            }
            Err(_) => self.noise_bytes += bytes.len() as u64,
        }
        let direction = match from {
            Some(Speaker::Host) => "to arm",
            Some(Speaker::Arm) => "from arm",
            None => "unknown",
        };
        let (seconds, nanos) = (stamp.div_euclid(1_000_000_000), stamp.rem_euclid(1_000_000_000));
        out.item(&Item {
            place: format_args!("{seconds}.{nanos:09}  {direction:8}"),
            bytes,
            text: meaning.as_ref().map_or_else(|reason| reason, |meaning| &meaning.text),
            on_line: Some(OnLine {
                protocol: *protocol,
                from: *from,
                nanos: stamp.cast_unsigned(),
            }),
        });
    }

    pub(super) fn has_bytes(&self) -> bool {
        self.frames + self.noise_bytes > 0
    }

    /// The counts for the sum.
    pub(super) fn parts(&self) -> Vec<Part> {
        vec![
            Part::always("frames", self.frames),
            Part::always("noise bytes", self.noise_bytes).flaw(),
            Part::some("frames without a message", self.unknown).flaw(),
        ]
    }
}
