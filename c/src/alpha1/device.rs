//! The arm's side.

use armwire::alpha1::{Alpha1, MAX_FRAME};

use super::message::{ArmwireAlpha1Request, ArmwireAlpha1Response};
use crate::device::{self, State};
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::functions::device;
use crate::memory;
use crate::status::ArmwireStatus;

device! {
    /// The side of the robot, or of its servos, on a line: requests in, responses out. It implements the protocol, not
    /// the robot. The caller owns its memory. The content is private.
    ArmwireAlpha1Device: State<Alpha1, MAX_FRAME>, ARMWIRE_ALPHA1_DEVICE_WORDS = 56, tag 4,
        request ArmwireAlpha1Request;
    armwire_alpha1_device_init(Alpha1);
    armwire_alpha1_device_poll(|flat, request, _| flat.set(request));

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

    armwire_alpha1_device_space;
    armwire_alpha1_device_received;
    armwire_alpha1_device_receive;
    armwire_alpha1_device_idle;
    armwire_alpha1_device_fault;
}
