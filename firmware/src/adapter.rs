//! What the tasks share: the bridge, and the work that each of them waits for.

use core::cell::{Cell, RefCell};

use armwire_bridge::config::{self, Config};
use armwire_bridge::control::Identity;
use armwire_bridge::{Action, Bridge, Instant, Start, Status};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;

use crate::restart;

/// A signal between tasks. All of them run on one executor, so it needs no interrupt lock.
type Notice<T = ()> = Signal<NoopRawMutex, T>;

/// Work that a task waits for.
#[derive(Clone, Copy)]
pub(crate) enum Work {
    /// Bytes for the arm, or a change of the line.
    Uart,
    /// The bytes that the UART is sending are to be cut.
    UartCut,
    /// A packet for the host on the serial port.
    Port,
    /// Room for a packet of that host.
    PortRoom,
    /// That host came or went, or opened or closed the port.
    PortSession,
    /// A packet for the host on the control interface.
    Control,
    /// Room for a packet of that host.
    ControlRoom,
    /// That host came or went.
    ControlSession,
    /// A frame for the CAN bus.
    Can,
    /// A look at all the others.
    Dispatch,
}

/// How many kinds there are.
const WORKS: usize = Work::Dispatch as usize + 1;

/// The bridge, and the work there is.
pub(crate) struct Adapter {
    bridge: RefCell<Bridge>,
    works: [Notice; WORKS],
    /// An action that only firmware can take.
    pub(crate) action: Notice<Action>,
    /// The CAN controller is to be set up anew.
    pub(crate) can_restart: Notice<config::Can>,
    /// The status at the last dispatch.
    pub(crate) status: Cell<Status>,
    /// How long the last packet was that was put in the serial port's endpoint.
    pub(crate) last_packet: Cell<usize>,
}

impl Adapter {
    /// An adapter that no host has found yet.
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

    /// Calls the bridge and wakes nobody.
    pub(crate) fn take<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        f(&mut self.bridge.borrow_mut())
    }

    /// Calls the bridge and wakes who sends to the arm, for whom a microsecond counts. All others are looked after then.
    ///
    /// So no caller needs to know what its call may lead to. A task that is woken without need looks and waits again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        let result = self.take(f);
        self.wake(Work::Uart);
        self.wake(Work::Dispatch);
        result
    }

    /// Wakes the task that waits for this work.
    // One piece of code, not one for each call: 0.6 kB.
    #[inline(never)]
    pub(crate) fn wake(&self, work: Work) {
        self.works[work as usize].signal(());
    }

    /// Waits for this work.
    pub(crate) async fn wait(&self, work: Work) {
        self.works[work as usize].wait().await;
    }

    /// Forgets that there was such work.
    pub(crate) fn reset(&self, work: Work) {
        self.works[work as usize].reset();
    }

    /// Wakes all tasks for which there is work.
    pub(crate) fn dispatch(&self) {
        let bridge = &mut *self.bridge.borrow_mut();
        let now = now();
        // One at a time: the next is fetched when this one was taken.
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

/// Now, by the microsecond timer.
pub(crate) fn now() -> Instant {
    Instant::from_micros(embassy_time::Instant::now().as_micros())
}
