//! The mask of interrupt handlers. This core has no BASEPRI: the interrupts are disabled one by one.

use core::marker::PhantomData;

use cortex_m::asm::{dsb, isb};
use cortex_m::peripheral::NVIC;
use embassy_rp::interrupt::Priority;
use embassy_rp::interrupt::typelevel::Interrupt as _;

use super::{LESS_URGENT, ServiceInterrupt};
use crate::board::urgency::DRIVERS;

/// Handlers wait until this is dropped. It must not be held across an `await`.
#[must_use]
pub(crate) struct Masked {
    /// The interrupts that were enabled, a bit each.
    enabled: u32,
    /// The mask is that of the current context.
    not_send: PhantomData<*const ()>,
}

/// Makes the handlers of this priority and below wait.
pub(crate) fn mask(priority: Priority) -> Masked {
    let service = 1 << ServiceInterrupt::IRQ as u16;
    let handlers = match priority <= DRIVERS {
        true => LESS_URGENT.iter().fold(service, |all, one| all | 1 << *one as u16),
        false => service,
    };
    // SAFETY: the registers are read and written as a whole. A handler in between restores what it finds.
    let nvic = unsafe { &*NVIC::PTR };
    let enabled = nvic.iser[0].read() & handlers;
    // SAFETY: a handler that waits breaks nothing.
    unsafe { nvic.icer[0].write(enabled) };
    // A handler may run until these are done.
    dsb();
    isb();
    Masked {
        enabled,
        not_send: PhantomData,
    }
}

impl Drop for Masked {
    fn drop(&mut self) {
        // SAFETY: masks are dropped in the reverse order, and this one protects nothing any more.
        unsafe { (*NVIC::PTR).iser[0].write(self.enabled) };
    }
}
