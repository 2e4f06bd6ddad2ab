//! Arbitrary parts of configurations and messages, for the fuzz targets.

use arbitrary::{Result, Unstructured};
use heapless::String;

pub(crate) fn mostly(u: &mut Unstructured<'_>, values: &[u32]) -> Result<u32> {
    match u.ratio(1, 8)? {
        true => u.arbitrary(),
        false => u.choose(values).copied(),
    }
}

/// A number up to one more than this maximum.
pub(crate) fn up_to_excess(u: &mut Unstructured<'_>, max: u16) -> Result<u16> {
    u.int_in_range(0..=max + 1)
}

/// A text, empty if the bytes at hand are too many.
pub(crate) fn text<const N: usize>(u: &mut Unstructured<'_>) -> Result<String<N, u8>> {
    Ok(u.arbitrary::<&str>()?.try_into().unwrap_or_default())
}

/// A value half of the time.
pub(crate) fn optional<'a, T>(
    u: &mut Unstructured<'a>,
    value: impl FnOnce(&mut Unstructured<'a>) -> Result<T>,
) -> Result<Option<T>> {
    u.arbitrary::<bool>()?.then(|| value(u)).transpose()
}
