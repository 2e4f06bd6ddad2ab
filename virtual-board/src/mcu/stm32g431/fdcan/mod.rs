//! FDCAN1 with its message RAM (RM0440, chapter 44).
//!
//! [`controller`] has the controller, [`ram`] the layout of the message RAM, [`registers`] the names. This file
//! connects the controller to the CAN bus.

mod controller;
mod ram;
mod registers;
#[cfg(test)]
mod tests;

use self::controller::Controller;
use crate::can::bus::Bus;
use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

/// The offset of the message RAM from the first register.
pub(super) const RAM: u32 = 0x4000;

/// The controller, on the CAN bus.
#[derive(Debug)]
pub(super) struct Fdcan {
    controller: Controller,
    bus: Shared<Bus>,
    /// The time of the bus's next event.
    wake: Option<Nanos>,
    progress: bool,
}

impl Fdcan {
    pub(super) fn new(bus: Shared<Bus>) -> Self {
        Self {
            controller: Controller::new(),
            bus,
            wake: None,
            progress: false,
        }
    }

    pub(super) fn set_clock(&mut self, hz: u64, now: Nanos) {
        if self.controller.set_clock(hz) {
            self.settle(now);
        }
    }

    /// The levels of the interrupt lines 0 and 1.
    pub(super) fn interrupts(&self) -> [bool; 2] {
        self.controller.interrupts()
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
        self.controller.come_to(now);
        let mut bus = lock(&self.bus);
        self.wake = bus.poll(now, &mut self.controller);
        self.progress |= bus.take_progress();
    }
}

impl Peripheral for Fdcan {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset.checked_sub(RAM) {
            Some(offset) => self.controller.ram().read(offset).ok_or(Refused::NoRegister),
            None => self.controller.read(offset),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        if let Some(offset) = offset.checked_sub(RAM) {
            let written = self.controller.ram_mut().write(offset, value);
            return written.ok_or(Refused::NoRegister);
        }
        self.controller.come_to(now);
        let written = self.controller.write(offset, value);
        self.settle(now);
        written
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        self.wake
    }

    /// Resets the controller, but not the bus, the clock and the message RAM.
    fn reset(&mut self, now: Nanos) {
        self.controller.reset();
        self.settle(now);
    }
}
