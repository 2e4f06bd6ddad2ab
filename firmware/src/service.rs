//! The service of the line: an interrupt handler that answers the arm and the host ahead of all tasks.
//!
//! | Priority | Context | Work |
//! |---|---|---|
//! | 0 | the UART and its DMA | time stamps and errors; pends the service |
//! | 1 | USB, the timer, CAN | the HAL's handlers: wake tasks |
//! | 2 | the service | passes received bytes to the bridge, a packet to USB, and the next burst to the UART |
//! | | tasks | everything else |
//!
//! The service has the vector of a peripheral that no board uses, and is pended by software. It and the tasks share
//! state in a [`Ceiling`](crate::ceiling::Ceiling) only: a task that uses the state masks the service, which runs as
//! soon as the task is done. Handlers of a higher priority share atomics and critical sections with both, and do not
//! call the bridge.

use embassy_sync::once_lock::OnceLock;

use crate::adapter::Adapter;
use crate::board::ServiceInterrupt;
use crate::board::hal::interrupt::typelevel::{Handler, Interrupt};
use crate::ceiling::SERVICE;
use crate::progress::{Task, progress};
use crate::usb::pipe::SharedEndpoint;

/// The adapter, and the endpoint of the serial port's packets to the host.
static SERVED: OnceLock<(&'static Adapter, &'static SharedEndpoint)> = OnceLock::new();

/// Starts the service.
pub(crate) fn start(adapter: &'static Adapter, port: &'static SharedEndpoint) {
    if SERVED.init((adapter, port)).is_err() {
        unreachable!()
    }
    ServiceInterrupt::set_priority(SERVICE);
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
