//! The arm's side.

use armwire::xarm::{MAX_FRAME, Response, XArm};

use super::message::{ArmwireXarmRequest, ArmwireXarmResponse};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// Size of a device, in words of 64 bits.
pub const ARMWIRE_XARM_DEVICE_WORDS: usize = 56;

/// The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. The caller owns its
/// memory. The content is private.
#[repr(C)]
pub struct ArmwireXarmDevice {
    opaque: [u64; ARMWIRE_XARM_DEVICE_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireXarmDevice {
    type Value = State<XArm, MAX_FRAME>;
    const TAG: u32 = memory::tag(6);
}

/// Initializes a device. `version` is ARMWIRE_VERSION.
///
/// ARMWIRE_STATUS_VERSION if header and library differ.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_init(device: Option<&mut ArmwireXarmDevice>, version: u32) -> ArmwireStatus {
    device::init(device, version, XArm::PRIVATE).into()
}

/// The next event. Call it again after every event except WAIT, and after bytes were received.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_poll(
    device: Option<&mut ArmwireXarmDevice>,
    event: Option<&mut ArmwireEvent>,
    request: Option<&mut ArmwireXarmRequest>,
) -> ArmwireStatus {
    device::poll(device, event, request, |flat, request, key| flat.set(request, key)).into()
}

/// Writes a response to `out` and its length to `len`. `to` is the request, or NULL for an unsolicited response. 260
/// bytes hold every response.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE for an invalid value, ARMWIRE_STATUS_UNKNOWN_KIND for an unknown kind,
/// ARMWIRE_STATUS_BUFFER_TOO_SHORT if the response is longer than `size`. `len` is its length then, too.
///
/// # Safety
///
/// `out` is NULL, or has `size` bytes; so has the `data` of the response `data_len`.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_xarm_device_respond(
    device: Option<&mut ArmwireXarmDevice>,
    to: Option<&ArmwireXarmRequest>,
    response: Option<&ArmwireXarmResponse>,
    out: *mut u8,
    size: usize,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    let Some(response) = response else {
        return ArmwireStatus::Null;
    };
    let to = to.map(ArmwireXarmRequest::key);
    // SAFETY: guaranteed by the caller.
    let (response, out) = unsafe { (response.get(), memory::room(out, size)) };
    device::respond(device, response, to, out, len).into()
}

/// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never empty after a
/// WAIT event.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_space(
    device: Option<&mut ArmwireXarmDevice>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    device::space(device, space, len).into()
}

/// The first `len` bytes of `space` arrived.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_received(device: Option<&mut ArmwireXarmDevice>, len: usize) -> ArmwireStatus {
    device::received(device, len)
}

/// Copies in as many of the received bytes as fit and writes their number to `taken`. Poll until WAIT, then pass in the
/// rest.
///
/// # Safety
///
/// `bytes` is NULL, or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_xarm_device_receive(
    device: Option<&mut ArmwireXarmDevice>,
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
pub extern "C" fn armwire_xarm_device_idle(device: Option<&mut ArmwireXarmDevice>) -> ArmwireStatus {
    device::idle(device)
}

/// The last rejected value or length, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_fault(
    device: Option<&mut ArmwireXarmDevice>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    device::fault(device, fault)
}

/// The response of an arm to an invalid request, from the fault of the UNKNOWN event: an invalid state in the private
/// protocol, an illegal function in standard Modbus.
///
/// ARMWIRE_STATUS_UNKNOWN_KIND if the frame has no register or function.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_refusal(
    fault: Option<&ArmwireFault>,
    response: Option<&mut ArmwireXarmResponse>,
) -> ArmwireStatus {
    let (Some(fault), Some(response)) = (fault, response) else {
        return ArmwireStatus::Null;
    };
    let refusal = fault.parse_error().and_then(|error| Response::refusal(&error));
    response.set(refusal);
    match refusal {
        Some(_) => ArmwireStatus::Ok,
        None => ArmwireStatus::UnknownKind,
    }
}
