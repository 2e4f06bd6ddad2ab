//! The service of the line: an interrupt handler that answers the arm and the host ahead of all tasks.
//!
//! | Priority | Context | Work |
//! |---|---|---|
//! | 0 | the UART and its DMA | time stamps and errors; pends the service |
//! | 1 | USB, the timer, CAN | the HAL's handlers: wake tasks |
//! | 2 | the service | passes received bytes to the bridge, a packet to USB, and the next burst to the UART |
//! | | tasks | everything else |
//!
//! The service has the vector of a peripheral that no board uses, and is pended by software. It and the tasks share state
//! in a [`Ceiling`] only: a task that uses the state masks the service, which runs as soon as the task is done. Handlers
//! of a higher priority share atomics and critical sections with both, and do not call the bridge.

use core::cell::RefCell;
use core::marker::PhantomData;

use cortex_m::register::basepri;
use embassy_stm32::interrupt::Priority;
use embassy_stm32::interrupt::typelevel::{Handler, Interrupt};
use embassy_sync::once_lock::OnceLock;

use crate::adapter::Adapter;
use crate::board::ServiceInterrupt;
use crate::progress::{Task, progress};
use crate::usb::pipe::SharedEndpoint;

/// The lowest priority of all interrupts.
const PRIORITY: Priority = Priority::P2;

/// The adapter, and the endpoint of the serial port's packets to the host.
static SERVED: OnceLock<(&'static Adapter, &'static SharedEndpoint)> = OnceLock::new();

/// Starts the service.
pub(crate) fn start(adapter: &'static Adapter, port: &'static SharedEndpoint) {
    if SERVED.init((adapter, port)).is_err() {
        unreachable!()
    }
    ServiceInterrupt::set_priority(PRIORITY);
    // SAFETY: what the handler shares with tasks is in a `Ceiling`.
    unsafe { ServiceInterrupt::enable() };
}

/// Runs the service, or repeats it. Any context may call this.
pub(crate) fn pend() {
    ServiceInterrupt::pend();
}

pub(crate) struct ServiceHandler;

impl Handler<ServiceInterrupt> for ServiceHandler {
    unsafe fn on_interrupt() {
        progress(Task::Service);
        if let Some((adapter, port)) = SERVED.try_get() {
            adapter.serve(port);
        }
    }
}

/// State that tasks share with the service.
pub(crate) struct Ceiling<T>(RefCell<T>);

// SAFETY: one context at a time is in `with`. The service is masked there, tasks do not preempt each other, and no handler
// of a higher priority has access to a `Ceiling`.
unsafe impl<T: Send> Sync for Ceiling<T> {}

impl<T> Ceiling<T> {
    pub(crate) const fn new(value: T) -> Self {
        Self(RefCell::new(value))
    }

    /// Calls `f` with the state. The service waits meanwhile. Calls must not be nested.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut T) -> R) -> R {
        let _masked = mask();
        f(&mut self.0.borrow_mut())
    }
}

/// The service waits until this is dropped. It must not be held across an `await`.
#[must_use]
pub(crate) struct Masked {
    before: u8,
    /// The mask is that of the current context.
    not_send: PhantomData<*const ()>,
}

/// Makes the service wait.
pub(crate) fn mask() -> Masked {
    let before = basepri::read();
    // SAFETY: no critical section relies on BASEPRI.
    unsafe { basepri::write(PRIORITY.into()) };
    Masked {
        before,
        not_send: PhantomData,
    }
}

impl Drop for Masked {
    fn drop(&mut self) {
        // SAFETY: as in `mask`. Values are restored in the reverse order.
        unsafe { basepri::write(self.before) };
    }
}
