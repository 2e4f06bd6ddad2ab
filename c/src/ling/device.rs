//! The arm's side.

use armwire::ling::{Ling, MAX_FRAME};

use super::message::{ArmwireLingRequest, ArmwireLingResponse};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::functions::device;
use crate::memory;
use crate::status::ArmwireStatus;

device! {
    /// The arm's side of a line: requests in, responses out. It implements the protocol, not the arm. The caller owns
    /// its memory. The content is private.
    ArmwireLingDevice: State<Ling, MAX_FRAME>, ARMWIRE_LING_DEVICE_WORDS = 32, tag 2, request ArmwireLingRequest;
    armwire_ling_device_init(Ling);
    armwire_ling_device_poll(|flat, request, _| flat.set(request));

    /// Writes a response to `out` and its length to `len`. 70 bytes hold every response.
    ///
    /// ARMWIRE_STATUS_OUT_OF_RANGE for an invalid value, ARMWIRE_STATUS_UNKNOWN_KIND for an unknown kind,
    /// ARMWIRE_STATUS_BUFFER_TOO_SHORT if the response is longer than `size`. `len` is its length then, too.
    ///
    /// # Safety
    ///
    /// `out` is NULL, or has `size` bytes.
    #[unsafe(no_mangle)]
    pub unsafe extern "C" fn armwire_ling_device_respond(
        device: Option<&mut ArmwireLingDevice>,
        response: Option<&ArmwireLingResponse>,
        out: *mut u8,
        size: usize,
        len: Option<&mut usize>,
    ) -> ArmwireStatus {
        let Some(response) = response else {
            return ArmwireStatus::Null;
        };
        // SAFETY: guaranteed by the caller.
        let out = unsafe { memory::room(out, size) };
        device::respond(device, response.get(), None, out, len).into()
    }

    armwire_ling_device_space;
    armwire_ling_device_received;
    armwire_ling_device_receive;
    armwire_ling_device_idle;
    armwire_ling_device_fault;
}
