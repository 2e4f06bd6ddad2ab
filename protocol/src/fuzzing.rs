//! Arbitrary parts of messages, for the fuzz targets.

use core::ops::RangeInclusive;

use arbitrary::{Result, Unstructured};

/// As few bytes as remain, but not fewer than allowed.
pub(crate) fn bytes<'a>(u: &mut Unstructured<'a>, lengths: RangeInclusive<usize>) -> Result<&'a [u8]> {
    let least = *lengths.start();
    let len = u.int_in_range(lengths)?;
    u.bytes(len.min(u.len().max(least)))
}
