//! What the tasks share: the bridge, and signals that say where there may be something to do.

use core::cell::{Cell, RefCell};

use armwire_bridge::control::Identity;
use armwire_bridge::{Action, Bridge, config, time};
use embassy_sync::blocking_mutex::raw::NoopRawMutex;
use embassy_sync::signal::Signal;
use embassy_time::Instant;

use crate::restart;

/// A signal between tasks. All of them run on one executor, so it needs no interrupt lock.
pub(crate) type Notice<T = ()> = Signal<NoopRawMutex, T>;

/// The bridge and its signals.
pub(crate) struct Adapter {
    bridge: RefCell<Bridge>,
    /// How long the last packet was that was put in the serial port's endpoint.
    pub(crate) last_packet: Cell<usize>,
    /// There are bytes for the arm, or the line is to change.
    pub(crate) bytes: Notice,
    /// What the UART is sending is to be cut.
    pub(crate) cut: Notice,
    /// A packet for the host on the serial port is due.
    pub(crate) packet: Notice,
    /// There is room for a packet from the host on the serial port.
    pub(crate) room: Notice,
    /// A host came, went, opened or closed the serial port.
    pub(crate) session: Notice,
    /// A packet for the host on the control interface is due.
    pub(crate) control_packet: Notice,
    /// There is room for a packet from the host on the control interface.
    pub(crate) control_room: Notice,
    /// A host came or went.
    pub(crate) control_session: Notice,
    /// A frame for the CAN bus is due.
    pub(crate) frame: Notice,
    /// The CAN controller is to be set up anew.
    pub(crate) can_restart: Notice<config::Can>,
    /// Something was said to the bridge.
    pub(crate) changed: Notice,
    /// What only firmware can do.
    pub(crate) action: Notice<Action>,
}

impl Adapter {
    /// An adapter that no host has found yet.
    pub(crate) fn new(identity: Identity, config: config::Config) -> Self {
        Self {
            bridge: RefCell::new(Bridge::new(identity, config)),
            last_packet: Cell::new(0),
            bytes: Notice::new(),
            cut: Notice::new(),
            packet: Notice::new(),
            room: Notice::new(),
            session: Notice::new(),
            control_packet: Notice::new(),
            control_room: Notice::new(),
            control_session: Notice::new(),
            frame: Notice::new(),
            can_restart: Notice::new(),
            changed: Notice::new(),
            action: Notice::new(),
        }
    }

    /// Calls `f` with the bridge, and tells every task for which there is something to do then.
    ///
    /// So no caller needs to know what its call may lead to. A task that is told without need looks and waits again.
    pub(crate) fn with<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        let result = self.take(f);
        self.tell_of_the_arm();
        self.taken();
        result
    }

    /// Calls `f` with the bridge for something to send, and tells nobody: not before that is on its way.
    pub(crate) fn take<R>(&self, f: impl FnOnce(&mut Bridge) -> R) -> R {
        f(&mut self.bridge.borrow_mut())
    }

    /// Calls `f` with the bridge to look only.
    pub(crate) fn look<R>(&self, f: impl FnOnce(&Bridge) -> R) -> R {
        f(&self.bridge.borrow())
    }

    /// What was taken is on its way: who looks what else there is to do is told.
    pub(crate) fn taken(&self) {
        self.changed.signal(());
    }

    /// Tells those for whom a microsecond counts: who sends the host what the arm said, and who sends to the arm. Tell
    /// the others when these have run.
    // One piece of code, not one for each call.
    #[inline(never)]
    pub(crate) fn tell_of_the_arm(&self) {
        // To ask whether there is something takes as long as to take it.
        self.bytes.signal(());
        self.tell_of_bytes();
    }

    /// Tells those who can wait, but who sends to the bus before all others.
    pub(crate) fn tell_the_others(&self) {
        self.take(Bridge::share);
        if self.bridge.borrow().can_due(now()) {
            self.frame.signal(());
        }
        self.taken();
    }

    /// Tells who sends the host what the arm said, if there is something.
    pub(crate) fn tell_of_bytes(&self) {
        if self.bridge.borrow().usb_due() {
            self.packet.signal(());
        }
    }

    /// Tells all tasks for which there is something to do.
    pub(crate) fn tell(&self) {
        let bridge = &mut *self.bridge.borrow_mut();
        restart::armed(bridge.is_armed());
        // One at a time: the next is fetched when this one was taken.
        if !self.action.signaled()
            && let Some(action) = bridge.action()
        {
            self.action.signal(action);
        }
        let now = now();
        for (due, notice) in [
            (bridge.control_room(), &self.control_room),
            (bridge.control_due(), &self.control_packet),
            (bridge.can_due(now), &self.frame),
            (bridge.usb_room(), &self.room),
            (bridge.usb_due(), &self.packet),
            (bridge.uart_due(now), &self.bytes),
            (bridge.uart_cut(), &self.cut),
        ] {
            if due {
                notice.signal(());
            }
        }
    }
}

/// Now, by the microsecond timer.
pub(crate) fn now() -> time::Instant {
    time::Instant::from_micros(Instant::now().as_micros())
}
