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

use crate::adapter::{Adapter, Shared, Work};
use crate::board::ServiceInterrupt;
use crate::board::hal::interrupt::typelevel::{Handler, Interrupt};
use crate::ceiling::SERVICE;
use crate::clock::now;
use crate::progress::{Task, progress};
use crate::uart;
use crate::usb::pipe::{self, SharedEndpoint};

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

pub(crate) struct ServiceHandler;

impl Handler<ServiceInterrupt> for ServiceHandler {
    unsafe fn on_interrupt() {
        progress(Task::Service);
        if let Some((adapter, port)) = SERVED.try_get() {
            adapter.serve(port);
        }
    }
}

impl Adapter {
    /// Serves the line: received bytes, then a packet for the host, then the next burst; a poll that follows an answer
    /// comes first. The service calls this.
    pub(crate) fn serve(&self, port: &SharedEndpoint) {
        self.shared.with(|shared| {
            let Shared {
                bridge, reader, sender, ..
            } = shared;
            let is_event = uart::take_event();
            let is_frame = match is_event {
                true => reader.read(bridge),
                // The bridge requires regular reads.
                false => bridge.uart_received(&[], now()) > 0,
            };
            let is_poll = is_frame && sender.transmit_ahead(bridge);
            if is_event {
                pipe::send(self, port, bridge);
            }
            let is_started = sender.transmit(bridge) || is_poll;
            if is_event {
                // Tasks run before the service reads what it has missed.
                shared.is_behind = uart::wait(bridge.rx_wait());
            }
            if is_frame || is_started || shared.is_behind {
                self.wake(Work::Dispatch);
            }
            if is_frame && bridge.has_delivery() {
                self.wake(Work::Can);
            }
        });
    }

    /// Runs the service again if it has left an event of the receiver to later.
    pub(crate) fn catch_up(&self) {
        if self.shared.with(|shared| core::mem::take(&mut shared.is_behind)) {
            uart::wake();
        }
    }
}
