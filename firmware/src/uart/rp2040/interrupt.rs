//! The state that the handlers of received bytes keep from one to the next.

use core::sync::atomic::{AtomicBool, AtomicUsize};

pub(in crate::uart) struct Interrupt {
    /// The position after the last byte that a handler has looked at.
    pub(super) seen: AtomicUsize,
    /// The line was found idle after the last byte. Without further bytes it is not found idle again: the bridge may wait
    /// for an idle line as long as a host reads nothing.
    pub(super) is_idle: AtomicBool,
}

impl Interrupt {
    pub(in crate::uart) const fn new() -> Self {
        Self {
            seen: AtomicUsize::new(0),
            is_idle: AtomicBool::new(true),
        }
    }
}
