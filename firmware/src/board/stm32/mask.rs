//! The mask of interrupt handlers.

use core::marker::PhantomData;

use cortex_m::register::{basepri, basepri_max};
use embassy_stm32::interrupt::Priority;

/// Handlers wait until this is dropped. It must not be held across an `await`.
#[must_use]
pub(crate) struct Masked {
    before: u8,
    /// The mask is that of the current context.
    not_send: PhantomData<*const ()>,
}

/// Makes the handlers of this priority and below wait.
pub(crate) fn mask(priority: Priority) -> Masked {
    let before = basepri::read();
    // It does not lower the mask of a caller.
    basepri_max::write(priority.into());
    Masked {
        before,
        not_send: PhantomData,
    }
}

impl Drop for Masked {
    fn drop(&mut self) {
        // SAFETY: masks are dropped in the reverse order, and this one protects nothing any more.
        unsafe { basepri::write(self.before) };
    }
}
