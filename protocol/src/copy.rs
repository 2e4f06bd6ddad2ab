//! Copies of bytes for which a microcontroller calls no `memcpy`: that takes 80 to 88 B of stack.

#[cfg(any(feature = "alpha1", feature = "xarm"))]
use core::hint;

/// Copies `from` to the front of `to`, as far as there is room.
///
/// A loop that may end early is not made a call, which would take more time, too, for a part of a frame.
#[cfg(target_pointer_width = "32")]
#[inline(always)]
pub(crate) fn copy(from: &[u8], to: &mut [u8]) {
    for (at, byte) in from.iter().enumerate() {
        let Some(place) = to.get_mut(at) else { break };
        *place = *byte;
    }
}

/// Copies `from` to the front of `to`, if there is room.
#[cfg(not(target_pointer_width = "32"))]
#[inline(always)]
pub(crate) fn copy(from: &[u8], to: &mut [u8]) {
    match (from, to) {
        // Byte by byte, a call to copy one takes longer than all else.
        ([byte], [place, ..]) => *place = *byte,
        (_, to) => {
            if let Some(to) = to.get_mut(..from.len()) {
                to.copy_from_slice(from);
            }
        }
    }
}

/// The same value, of which the compiler of a microcontroller knows nothing. It makes no call of a loop over bytes that each are
/// hidden, and unrolls none over a slice that is.
#[cfg(any(feature = "alpha1", feature = "xarm"))]
pub(crate) fn hidden<T>(value: T) -> T {
    match cfg!(target_pointer_width = "32") {
        true => hint::black_box(value),
        false => value,
    }
}
