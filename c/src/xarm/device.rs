//! The arm's side.

use armwire::xarm::{MAX_FRAME, Response, XArm};

use super::message::{ArmwireXarmRequest, ArmwireXarmResponse};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::functions::device;
use crate::memory;
use crate::status::ArmwireStatus;

device! {
    /// The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. The caller owns
    /// its memory. The content is private.
    ArmwireXarmDevice: State<XArm, MAX_FRAME>, ARMWIRE_XARM_DEVICE_WORDS = 56, tag 6, request ArmwireXarmRequest;
    armwire_xarm_device_init(XArm::PRIVATE);
    armwire_xarm_device_poll(|flat, request, key| flat.set(request, key));

    /// Writes a response to `out` and its length to `len`. `to` is the request, or NULL for an unsolicited response.
    /// 260 bytes hold every response.
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

    armwire_xarm_device_space;
    armwire_xarm_device_received;
    armwire_xarm_device_receive;
    armwire_xarm_device_idle;
    armwire_xarm_device_fault;
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
