//! The boundary to C: pointers become references, or an error.

use core::slice;

use crate::status::ArmwireStatus;

/// Memory of C that contains a value.
///
/// # Safety
///
/// It must be `repr(C)`, have no padding, be valid with any bytes, and be at least as large and as aligned as a
/// [`Tagged`] value. [`CHECK`](Memory::CHECK) checks the last two.
pub(crate) unsafe trait Memory: Sized {
    /// The value.
    type Value;

    /// The first word, which identifies the type and distinguishes it from uninitialized memory.
    const TAG: u32;

    /// Fails to compile if the value does not fit.
    const CHECK: () = assert!(
        size_of::<Tagged<Self::Value>>() <= size_of::<Self>()
            && align_of::<Tagged<Self::Value>>() <= align_of::<Self>(),
        "the value does not fit into its memory"
    );
}

/// The tag of all kinds of memory, without the kind. An unlikely value in uninitialized memory.
const TAGS: u32 = 0xA6E1_5C00;

/// The tag of this kind of memory.
pub(crate) const fn tag(kind: u8) -> u32 {
    TAGS | kind as u32
}

/// A value after its tag.
#[repr(C)]
pub(crate) struct Tagged<T> {
    tag: u32,
    value: T,
}

/// Writes a value to memory with any content.
pub(crate) fn init<M: Memory>(memory: Option<&mut M>, value: M::Value) -> Result<(), ArmwireStatus> {
    const { M::CHECK }
    let memory: *mut M = memory.ok_or(ArmwireStatus::Null)?;
    // SAFETY: `CHECK` proves that the value fits, and the reference is to writable memory. An earlier value needs no
    // drop: it owns nothing outside of itself.
    unsafe { memory.cast::<Tagged<M::Value>>().write(Tagged { tag: M::TAG, value }) };
    Ok(())
}

/// The value in memory initialized by [`init`].
pub(crate) fn open<M: Memory>(memory: Option<&mut M>) -> Result<&mut M::Value, ArmwireStatus> {
    const { M::CHECK }
    let memory: *mut M = memory.ok_or(ArmwireStatus::Null)?;
    // SAFETY: the reference is to at least this many bytes, aligned, and any of them are a valid `u32`.
    let tag = unsafe { memory.cast::<u32>().read() };
    if tag == M::TAG {
        // SAFETY: only `init` writes this tag, with a value of this type after it. The lifetime is that of `memory`.
        return Ok(unsafe { &mut (*memory.cast::<Tagged<M::Value>>()).value });
    }
    match tag & !0xFF {
        TAGS => Err(ArmwireStatus::WrongType),
        _ => Err(ArmwireStatus::NotInitialized),
    }
}

/// Writes a result of a function.
pub(crate) fn put<T>(to: Option<&mut T>, value: T) -> Result<(), ArmwireStatus> {
    *to.ok_or(ArmwireStatus::Null)? = value;
    Ok(())
}

/// Writes the place and the length of free space.
pub(crate) fn put_space(
    room: &mut [u8],
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> Result<(), ArmwireStatus> {
    let (Some(space), Some(len)) = (space, len) else {
        return Err(ArmwireStatus::Null);
    };
    (*space, *len) = (room.as_mut_ptr(), room.len());
    Ok(())
}

/// Hands bytes to a value, and writes the number that `receive` takes.
pub(crate) fn take<M: Memory>(
    memory: Option<&mut M>,
    bytes: Result<&[u8], ArmwireStatus>,
    taken: Option<&mut usize>,
    receive: impl FnOnce(&mut M::Value, &[u8]) -> usize,
) -> Result<(), ArmwireStatus> {
    let (bytes, taken) = (bytes?, taken.ok_or(ArmwireStatus::Null)?);
    *taken = receive(open(memory)?, bytes);
    Ok(())
}

/// Bytes to read. NULL is valid for zero bytes.
///
/// # Safety
///
/// `bytes` is NULL, or has `len` bytes during the lifetime of the result.
pub(crate) unsafe fn bytes<'a>(bytes: *const u8, len: usize) -> Result<&'a [u8], ArmwireStatus> {
    match (bytes.is_null(), len) {
        (_, 0) => Ok(&[]),
        (true, _) => Err(ArmwireStatus::Null),
        // SAFETY: it is not NULL, and the caller guarantees the rest.
        (false, _) => Ok(unsafe { slice::from_raw_parts(bytes, len.min(isize::MAX as usize)) }),
    }
}

/// Space to write to. NULL is valid for zero bytes.
///
/// # Safety
///
/// `room` is NULL, or has `len` bytes without any other access during the lifetime of the result.
pub(crate) unsafe fn room<'a>(room: *mut u8, len: usize) -> Result<&'a mut [u8], ArmwireStatus> {
    match (room.is_null(), len) {
        (_, 0) => Ok(&mut []),
        (true, _) => Err(ArmwireStatus::Null),
        // SAFETY: it is not NULL, and the caller guarantees the rest.
        (false, _) => Ok(unsafe { slice::from_raw_parts_mut(room, len.min(isize::MAX as usize)) }),
    }
}
