//! State shared with interrupt handlers that must not delay the stamps.
//!
//! A critical section makes all handlers wait, also that of the UART, which takes the stamps. A [`Ceiling`] makes only
//! those wait that use its state.

use core::cell::RefCell;
use core::marker::PhantomData;

use cortex_m::register::{basepri, basepri_max};
use embassy_stm32::interrupt::Priority;

/// The priority of the handlers of USB, the timer and CAN. Those of the UART and its DMA have a higher one.
pub(crate) const DRIVERS: Priority = Priority::P1;
/// The priority of the [service](crate::service), the lowest.
pub(crate) const SERVICE: Priority = Priority::P2;

/// State of tasks and of handlers up to a priority.
pub(crate) struct Ceiling<T> {
    priority: Priority,
    state: RefCell<T>,
}

// SAFETY: one context at a time is in `with`. Handlers up to the priority are masked there, tasks do not preempt each
// other, and handlers above do not use the state.
unsafe impl<T: Send> Sync for Ceiling<T> {}

impl<T> Ceiling<T> {
    /// `priority` is the highest of the handlers that use the state.
    pub(crate) const fn new(priority: Priority, state: T) -> Self {
        Self {
            priority,
            state: RefCell::new(state),
        }
    }

    /// Calls `f` with the state. The other handlers wait meanwhile. Calls must not be nested.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let _masked = mask(self.priority);
        f(&mut self.state.borrow_mut())
    }
}

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
