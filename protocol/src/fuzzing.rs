//! Arbitrary parts of messages, for the fuzz targets.

use core::ops::RangeInclusive;

use arbitrary::{Result, Unstructured};

/// Bytes of a length in this range, at most the remaining ones if the minimum allows it.
pub(crate) fn bytes<'a>(u: &mut Unstructured<'a>, lengths: RangeInclusive<usize>) -> Result<&'a [u8]> {
    let min = *lengths.start();
    let len = u.int_in_range(lengths)?;
    u.bytes(len.min(u.len().max(min)))
}
