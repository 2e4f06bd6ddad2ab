//! The arm's side.

use armwire::alpha1::{Alpha1, MAX_FRAME};

use super::message::{ArmwireAlpha1Request, ArmwireAlpha1Response};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// Size of a device, in words of 64 bits.
pub const ARMWIRE_ALPHA1_DEVICE_WORDS: usize = 56;

/// The side of the robot, or of its servos, on a line: requests in, responses out. It implements the protocol, not the
/// robot. The caller owns its memory. The content is private.
#[repr(C)]
pub struct ArmwireAlpha1Device {
    opaque: [u64; ARMWIRE_ALPHA1_DEVICE_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireAlpha1Device {
    type Value = State<Alpha1, MAX_FRAME>;
    const TAG: u32 = memory::tag(4);
}

/// Initializes a device. `version` is ARMWIRE_VERSION.
///
/// ARMWIRE_STATUS_VERSION if header and library differ.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_init(device: Option<&mut ArmwireAlpha1Device>, version: u32) -> ArmwireStatus {
    device::init(device, version, Alpha1).into()
}

/// The next event. Call it again after every event except WAIT, and after bytes were received.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_poll(
    device: Option<&mut ArmwireAlpha1Device>,
    event: Option<&mut ArmwireEvent>,
    request: Option<&mut ArmwireAlpha1Request>,
) -> ArmwireStatus {
    device::poll(device, event, request, |flat, request, _| flat.set(request)).into()
}

/// Writes a response to `out` and its length to `len`. 259 bytes hold every response.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE for an invalid value, ARMWIRE_STATUS_UNKNOWN_KIND for an unknown kind,
/// ARMWIRE_STATUS_BUFFER_TOO_SHORT if the response is longer than `size`. `len` is its length then, too.
///
/// # Safety
///
/// `out` is NULL, or has `size` bytes; so has the `text` of the response `text_len`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_alpha1_device_respond(
    device: Option<&mut ArmwireAlpha1Device>,
    response: Option<&ArmwireAlpha1Response>,
    out: *mut u8,
    size: usize,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    let Some(response) = response else {
        return ArmwireStatus::Null;
    };
    // SAFETY: guaranteed by the caller.
    let (response, out) = unsafe { (response.get(), memory::room(out, size)) };
    device::respond(device, response, None, out, len).into()
}

/// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never empty after a
/// WAIT event.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_space(
    device: Option<&mut ArmwireAlpha1Device>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    device::space(device, space, len).into()
}

/// The first `len` bytes of `space` arrived.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_received(
    device: Option<&mut ArmwireAlpha1Device>,
    len: usize,
) -> ArmwireStatus {
    device::received(device, len)
}

/// Copies in as many of the received bytes as fit and writes their number to `taken`. Poll until WAIT, then pass in the
/// rest.
///
/// # Safety
///
/// `bytes` is NULL, or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_alpha1_device_receive(
    device: Option<&mut ArmwireAlpha1Device>,
    bytes: *const u8,
    len: usize,
    taken: Option<&mut usize>,
) -> ArmwireStatus {
    // SAFETY: guaranteed by the caller.
    let bytes = unsafe { memory::bytes(bytes, len) };
    device::receive(device, bytes, taken).into()
}

/// The UART reported an idle line. Never call it for a gap between USB packets.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_idle(device: Option<&mut ArmwireAlpha1Device>) -> ArmwireStatus {
    device::idle(device)
}

/// The last rejected value or length, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_device_fault(
    device: Option<&mut ArmwireAlpha1Device>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    device::fault(device, fault)
}
