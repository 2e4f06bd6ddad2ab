//! CAN1, a bxCAN (RM0090, chapter 32): [`Core`] is the controller; this file connects it to the peripheral bus and the
//! CAN bus.

mod core;
mod filter;
mod registers;

use self::core::Core;
use crate::can::bus::Bus;
use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

/// The controller, on the CAN bus.
#[derive(Debug)]
pub(super) struct Can {
    core: Core,
    bus: Shared<Bus>,
    /// The time of the bus's next event.
    wake: Option<Nanos>,
    /// A frame ended since the last check.
    progress: bool,
}

impl Can {
    pub(super) fn new(bus: Shared<Bus>) -> Self {
        Self {
            core: Core::new(),
            bus,
            wake: None,
            progress: false,
        }
    }

    pub(super) fn set_clock(&mut self, hz: u64, now: Nanos) {
        if hz != self.core.clock_hz {
            self.core.clock_hz = hz;
            self.settle(now);
        }
    }

    /// The levels of the interrupt lines TX, RX0, RX1 and SCE (32.8).
    #[inline]
    pub(super) fn interrupts(&self) -> [bool; 4] {
        self.core.interrupts()
    }

    /// Returns true if a frame ended since the last call.
    pub(super) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }

    /// Returns true if nodes have unread frames of the board.
    pub(super) fn has_unread(&self) -> bool {
        lock(&self.bus).unread() > 0
    }

    /// Passes changes on to the bus.
    pub(super) fn settle(&mut self, now: Nanos) {
        self.core.now = now;
        let mut bus = lock(&self.bus);
        self.core.keep_from_initialization(bus.keeps_from_initialization());
        self.wake = bus.poll(now, &mut self.core);
        self.progress |= bus.take_progress();
    }
}

impl Peripheral for Can {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        if registers::has(offset) {
            Ok(self.core.read(offset))
        } else {
            Err(Refused::NoRegister)
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if !registers::has(offset) {
            return Err(Refused::NoRegister);
        }
        self.core.now = now;
        self.core.write(offset, value);
        self.settle(now);
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        self.wake
    }

    /// Resets the controller, but not the bus and the clock.
    fn reset(&mut self, now: Nanos) {
        let clock_hz = self.core.clock_hz;
        self.core = Core::new();
        self.core.clock_hz = clock_hz;
        self.settle(now);
    }
}
