//! The arm's side.

use armwire::xarm::{MAX_FRAME, Response, XArm};

use super::message::{ArmwireXarmRequest, ArmwireXarmResponse};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// Words in the memory of a device.
pub const ARMWIRE_XARM_DEVICE_WORDS: usize = 56;

/// The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. Its memory is yours, what is in
/// it is not.
#[repr(C)]
pub struct ArmwireXarmDevice {
    opaque: [u64; ARMWIRE_XARM_DEVICE_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireXarmDevice {
    type Value = State<XArm, MAX_FRAME>;
    const TAG: u32 = memory::tag(6);
}

/// Makes a device. `version` is ARMWIRE_VERSION.
///
/// ARMWIRE_STATUS_VERSION if header and library differ.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_init(device: Option<&mut ArmwireXarmDevice>, version: u32) -> ArmwireStatus {
    device::init(device, version, XArm::PRIVATE).into()
}

/// The next event. Call it again after every event but WAIT, and once bytes arrived.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_poll(
    device: Option<&mut ArmwireXarmDevice>,
    event: Option<&mut ArmwireEvent>,
    request: Option<&mut ArmwireXarmRequest>,
) -> ArmwireStatus {
    device::poll(device, event, request, |flat, request, key| flat.set(request, key)).into()
}

/// Writes a response to a request, or to none if `to` is NULL, to `out` and its length to `len`. 260 bytes hold every one.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE for a value, ARMWIRE_STATUS_UNKNOWN_KIND for a kind that the protocol does not have,
/// ARMWIRE_STATUS_BUFFER_TOO_SHORT: then `len` is the length of the response.
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

/// Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
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
/// ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_received(device: Option<&mut ArmwireXarmDevice>, len: usize) -> ArmwireStatus {
    device::received(device, len)
}

/// Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
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

/// The last value or length that was refused, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_device_fault(
    device: Option<&mut ArmwireXarmDevice>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    device::fault(device, fault)
}

/// Makes the response of an arm to a frame that is no request, from the fault of the UNKNOWN event: to one of its own that its
/// state is invalid, to standard Modbus that it does not have the function.
///
/// ARMWIRE_STATUS_UNKNOWN_KIND if the frame names nothing that could be answered.
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
