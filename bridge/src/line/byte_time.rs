//! The duration of bytes on the line.

use armwire::time::Duration;

use crate::line_coding::LineCoding;

/// The duration of a byte on the line.
#[derive(Clone, Copy)]
pub(crate) struct ByteTime {
    nanos: u32,
}

impl ByteTime {
    pub(super) fn of(coding: LineCoding) -> Self {
        Self {
            nanos: coding.nanos_a_byte(),
        }
    }

    /// The duration of this many bytes.
    pub(super) fn times(self, len: usize) -> Duration {
        Duration::from_micros(u64::from((len as u32).saturating_mul(self.nanos) / 1_000))
    }

    /// The number of whole bytes in this time.
    pub(super) fn bytes_in(self, nanos: u32) -> usize {
        nanos.checked_div(self.nanos).unwrap_or(0) as usize
    }
}
