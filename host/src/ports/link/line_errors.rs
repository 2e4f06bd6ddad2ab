//! Errors on a line.

use std::ops::Add;

use armwire::framing::Reason;

/// Errors on a line since it was opened.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct LineErrors {
    /// Bytes outside frames.
    pub noise_bytes: usize,
    /// Frames with a wrong checksum.
    pub checksums: usize,
    /// Answers that did not keep the order of their requests. After the first, a lost answer is known by time alone.
    pub out_of_order: usize,
}

impl Add for LineErrors {
    type Output = Self;

    fn add(self, other: Self) -> Self {
        Self {
            noise_bytes: self.noise_bytes + other.noise_bytes,
            checksums: self.checksums + other.checksums,
            out_of_order: self.out_of_order + other.out_of_order,
        }
    }
}

impl LineErrors {
    pub(super) fn count(&mut self, noise: &[u8], reason: Reason) {
        self.noise_bytes += noise.len();
        self.checksums += usize::from(matches!(reason, Reason::Checksum { .. }));
    }
}
