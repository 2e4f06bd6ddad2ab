//! State shared by the tasks: the bridge, and the signals for their work.

use core::cell::{Cell, RefCell};

use armwire_bridge::config::{self, Config};
use armwire_bridge::control::Identity;
use armwire_bridge::{Action, Bridge, Instant, Start, Status};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;

use crate::restart;

/// A signal between tasks. All of them run on one executor, so it needs no interrupt lock.
type Notice<T = ()> = Signal<NoopRawMutex, T>;

/// A kind of work, for which a task waits.
#[derive(Clone, Copy)]
pub(crate) enum Work {
    /// Bytes for the arm, or a change of the line.
    Uart,
    /// Torque-off must cut the bytes that the UART is sending.
    UartCut,
    /// A packet for the host on the serial port.
    Port,
    /// Room for a packet from that host.
    PortRoom,
    /// A new session of that host, or a port that was opened or closed.
    PortSession,
    /// A packet for the host on the control interface.
    Control,
    /// Room for a packet from that host.
    ControlRoom,
    /// A new session of that host.
    ControlSession,
    /// A frame for the CAN bus.
    Can,
    /// A check of all other kinds.
    Dispatch,
}

/// Number of kinds.
const WORKS: usize = Work::Dispatch as usize + 1;

/// The bridge, and a signal for each kind of work.
pub(crate) struct Adapter {
    bridge: RefCell<Bridge>,
    works: [Notice; WORKS],
    /// The next action of the bridge.
    pub(crate) action: Notice<Action>,
    /// A new configuration for the CAN controller.
    pub(crate) can_restart: Notice<config::Can>,
    /// The status at the last dispatch.
    pub(crate) status: Cell<Status>,
    /// Length of the last packet in the serial port's endpoint.
    pub(crate) last_packet: Cell<usize>,
}

impl Adapter {
    /// An adapter without a USB host.
    pub(crate) fn new(identity: Identity, config: Config, start: Start) -> Self {
        Self {
            bridge: RefCell::new(Bridge::new(identity, config, start)),
            works: [const { Notice::new() }; WORKS],
            action: Notice::new(),
            can_restart: Notice::new(),
            status: Cell::new(Status::default()),
            last_packet: Cell::new(0),
        }
    }

    /// Calls the bridge without waking a task.
    pub(crate) fn take<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        f(&mut self.bridge.borrow_mut())
    }

    /// Calls the bridge, and wakes the task that transmits to the arm, where microseconds count. The dispatch to all
    /// others follows.
    ///
    /// A task that is woken without work waits again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        let result = self.take(f);
        self.wake(Work::Uart);
        self.wake(Work::Dispatch);
        result
    }

    /// Wakes the task that waits for this work.
    // One copy, not one for each call: 0.6 kB.
    #[inline(never)]
    pub(crate) fn wake(&self, work: Work) {
        self.works[work as usize].signal(());
    }

    pub(crate) async fn wait(&self, work: Work) {
        self.works[work as usize].wait().await;
    }

    /// Clears the signal for this work.
    pub(crate) fn reset(&self, work: Work) {
        self.works[work as usize].reset();
    }

    /// Wakes all tasks that have work.
    pub(crate) fn dispatch(&self) {
        let bridge = &mut *self.bridge.borrow_mut();
        let now = now();
        // One at a time: the next is fetched after this one was taken.
        if !self.action.signaled()
            && let Some(action) = bridge.action(now)
        {
            self.action.signal(action);
        }
        let status = bridge.update(now);
        self.status.set(status);
        restart::armed(status.is_armed);
        for (is_due, work) in [
            (status.uart, Work::Uart),
            (status.uart_cut, Work::UartCut),
            (status.usb, Work::Port),
            (status.usb_room, Work::PortRoom),
            (status.can, Work::Can),
            (status.control, Work::Control),
            (status.control_room, Work::ControlRoom),
        ] {
            if is_due {
                self.wake(work);
            }
        }
    }
}

/// The current time of the microsecond timer.
pub(crate) fn now() -> Instant {
    Instant::from_micros(embassy_time::Instant::now().as_micros())
}
