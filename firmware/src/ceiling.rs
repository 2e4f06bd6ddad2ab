//! State shared with interrupt handlers that must not delay the stamps.
//!
//! A critical section makes all handlers wait, also that of the UART, which takes the stamps. A [`Ceiling`] makes only
//! those wait that use its state.

use core::cell::RefCell;

use crate::board::hal::interrupt::Priority;

pub(crate) use crate::board::{DRIVERS, SERVICE, mask};

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
