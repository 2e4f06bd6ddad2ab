//! USB OTG FS (RM0090, chapter 34): [`Core`] is the controller; this file connects it to the bus and the wire.

mod core;
mod registers;
mod variant;

use self::core::Core;
use self::registers::eptsiz;
pub use self::variant::OtgVariant;
use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused, check_reserved, forbidden};
use crate::time::Nanos;
use crate::timing::Clock;
use crate::usb::host::Host;

/// The clock of the PHY, and its tolerance: 0.25 % (34.3; USB 2.0, 7.1.11).
const PHY_HZ: u64 = 48_000_000;
const PHY_TOLERANCE_HZ: u64 = PHY_HZ / 400;

/// The controller, with a host at the other end of the cable.
#[derive(Debug)]
pub(super) struct Otg {
    core: Core,
    host: Shared<Host>,
    /// The time of the next event of host or controller.
    wake: Option<Nanos>,
    /// An event occurred on the wire since the last check.
    progress: bool,
}

impl Otg {
    pub(super) fn new(host: Shared<Host>, clock: Clock, variant: OtgVariant) -> Self {
        Self {
            core: Core::of(clock, variant),
            host,
            wake: None,
            progress: false,
        }
    }

    pub(super) fn set_clock(&mut self, hz: u64, now: Nanos) {
        let clocked = hz.abs_diff(PHY_HZ) <= PHY_TOLERANCE_HZ;
        if clocked != self.core.clocked {
            self.core.clocked = clocked;
            self.settle(now);
        }
    }

    /// The level of the global interrupt line (34.15).
    #[inline]
    pub(super) fn interrupts(&self) -> bool {
        self.core.interrupt()
    }

    /// Returns true if an event that a program may wait for occurred on the wire since the last call.
    pub(super) fn take_progress(&mut self) -> bool {
        std::mem::take(&mut self.progress)
    }

    /// Passes changes on to the host.
    pub(super) fn settle(&mut self, now: Nanos) {
        self.come_to(now);
        let mut host = lock(&self.host);
        let next = host.poll(now, &mut self.core);
        self.progress |= host.take_progress();
        self.wake = next.into_iter().chain(self.core.next_step()).min();
    }

    fn come_to(&mut self, now: Nanos) {
        self.core.now = now;
        self.core.advance();
    }
}

impl Peripheral for Otg {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        registers::name(offset).ok_or(Refused::NoRegister)?;
        self.come_to(now);
        let value = self.core.read(offset);
        // Only reads that free space in the receive FIFO concern the host.
        if registers::pops(offset) {
            self.settle(now);
        }
        Ok(value)
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        let name = registers::name(offset).ok_or(Refused::NoRegister)?;
        let counts = registers::is_reserved_count(offset, value);
        let value = if counts { value & !eptsiz::MCNT } else { value };
        check_reserved(name, value, registers::bits(offset))?;
        self.come_to(now);
        self.core.write(offset, value);
        let misuse = self.core.take_misuse();
        self.settle(now);
        match misuse {
            Some(reason) => Err(forbidden(name, reason)),
            None if counts => Err(Refused::Unimplemented("DIEPTSIZ0.MCNT")),
            None => Ok(()),
        }
    }

    fn advance(&mut self, now: Nanos) {
        self.settle(now);
    }

    fn due(&self) -> Option<Nanos> {
        self.wake
    }

    /// Resets the controller, but not the cable and the clock.
    fn reset(&mut self, now: Nanos) {
        let clocked = self.core.clocked;
        self.core = self.core.restarted();
        self.core.clocked = clocked;
        self.settle(now);
    }

    fn peek(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        registers::name(offset).ok_or(Refused::NoRegister)?;
        Ok(self.core.peek(offset))
    }
}
