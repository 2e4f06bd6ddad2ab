//! The STM32F405: the library's models of what it shares with the STM32F427, on its own bus, with what the library
//! lacks.
//!
//! [`map`] says what there is. To add a model: give it a field here, hand it out in [`Mcu::split`], and let
//! [`Stm32f405::new`] know its slot; if something outside it speaks to it, add the slot to those that are polled.

mod capture;
mod clocks;
mod dma;
mod flash;
pub(crate) mod map;
mod pins;
pub(crate) mod port;

use rigless::device::{Device, ErasedDevice, ResetCause};
use rigless::mcu::{Mcu, Operate};
use rigless::soc::stm32f427::Stm32f427;
use rigless::soc::stm32f427::generated::{dbg, pwr, rcc, rtc};
use rigless::soc::stm32f427::peripherals::dma::Dma;
use rigless::soc::{Bus, Error};
use rigless::time::VirtualNanos;

use self::capture::Capture;
use self::clocks::Clocks;
use self::dma::Dma1;
use self::flash::Interface;
use self::map::{ARM_PORT, CAPTURE, FLASH, PWR, RCC};
use self::pins::PortA;
use self::port::Port;
use crate::bxcan::{self, Can};
use crate::engine::News;
use crate::mcu::stm32f405::{IDENTITY, Reenabled};
use crate::otg::Otg;
use crate::shared::lock;
use crate::soc::machine::Edges;

/// Where our models are on the bus.
#[derive(Clone, Copy, Debug)]
struct Slots {
    port: usize,
    otg: usize,
    can: usize,
    flash: usize,
    dma1: usize,
    dma2: usize,
    rcc: usize,
    capture: usize,
    pins: usize,
    pwr: usize,
    rtc: usize,
    dbg: usize,
}

/// The microcontroller, with an arm, a USB host and a CAN bus at its pins.
#[derive(Debug)]
pub(crate) struct Stm32f405 {
    bus: Bus,
    slots: Slots,
    /// The models that the part shares with the F427. Its own bus is not used, but for what a reset keeps.
    shared: Stm32f427,
    /// The slot that each of our slots has on the F427's bus.
    twins: Vec<Option<usize>>,
    clocks: Clocks,
    capture: Capture,
    pins: PortA,
    port: Port,
    otg: Otg,
    can: Can,
    flash: Interface,
    dma1: Dma1,
    dma2: Dma,
    /// Whether what is outside may have changed unseen.
    looks: bool,
    /// The supply as the part knows it.
    millivolts: u32,
    /// DBGMCU_IDCODE.
    idcode: u32,
}

impl Stm32f405 {
    /// A part with a crystal.
    ///
    /// # Errors
    ///
    /// Only if its description contradicts itself.
    pub(crate) fn new(reenabled: Reenabled, edges: Edges) -> Result<Self, Error> {
        let Edges {
            line,
            starve,
            host,
            can,
            flash,
            oscillator,
        } = edges;
        let bus = map::bus()?;
        let clock = lock(&flash).clock;
        let shared = Stm32f427::new()?;
        let twins = bus
            .slots()
            .iter()
            .map(|slot| shared.bus().slot_of(slot.peripheral().name))
            .collect();
        let slots = Slots {
            port: bus.slot(ARM_PORT)?,
            otg: bus.slot(crate::otg::PERIPHERAL.name)?,
            can: bus.slot(bxcan::CAN)?,
            flash: bus.slot(FLASH)?,
            dma1: bus.slot("DMA1")?,
            dma2: bus.slot("DMA2")?,
            rcc: bus.slot(RCC)?,
            capture: bus.slot(CAPTURE)?,
            pins: bus.slot("GPIOA")?,
            pwr: bus.slot(PWR)?,
            rtc: bus.slot("RTC")?,
            dbg: bus.slot("DBG")?,
        };
        let mut part = Self {
            bus,
            slots,
            shared,
            twins,
            clocks: Clocks::new(oscillator.clone()),
            capture: Capture::new(oscillator),
            pins: PortA::new(line.clone()),
            port: Port::new(line),
            otg: Otg::new(host, clock),
            can: Can::new(can),
            flash: Interface::new(flash),
            dma1: Dma1::new(reenabled, starve),
            dma2: dma::controller(1),
            looks: true,
            millivolts: 0,
            idcode: IDENTITY,
        };
        part.supply();
        part.check()?;
        Ok(part)
    }

    /// Makes it another revision of the part (38.6.1).
    pub(crate) fn set_idcode(&mut self, idcode: u32) {
        self.idcode = idcode;
        let registers = self.bus.slot_mut(self.slots.dbg).registers_mut();
        registers.set(dbg::Register::DbgmcuIdcode, idcode.into());
    }

    /// Whether [`poll`](Mcu::poll) looks outside, as it does at first. It need not where nobody but the models themselves
    /// changed anything: they ask for an event at whatever instant something is due out there.
    pub(crate) fn set_looking(&mut self, looks: bool) {
        self.looks = looks;
    }

    /// Whether the flash is busy: the core waits for it.
    pub(crate) fn is_flash_busy(&self) -> bool {
        self.flash.is_busy()
    }

    /// What happened since this was last asked that a program may wait for.
    pub(crate) fn take_news(&mut self) -> News {
        let can = self.can.take_progress();
        News {
            any: self.otg.take_progress() || can,
            heard: can && self.can.has_unread(),
            cut: false,
        }
    }

    fn poll_outside(&mut self, now: VirtualNanos) {
        if self.flash.millivolts() != self.millivolts {
            self.supply();
        }
        let (registers, mut context) = self.bus.drive(now, self.slots.port);
        Device::poll(&mut self.port, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.otg);
        Device::poll(&mut self.otg, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.can);
        Device::poll(&mut self.can, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.flash);
        Device::poll(&mut self.flash, registers, &mut context);
        let (registers, mut context) = self.bus.drive(now, self.slots.rcc);
        Device::poll(&mut self.clocks, registers, &mut context);
    }

    /// The voltage detector sees the supply (5.2.3).
    fn supply(&mut self) {
        self.millivolts = self.flash.millivolts();
        let registers = self.bus.slot_mut(self.slots.pwr).registers_mut();
        self.shared.pwr.set_supply(self.millivolts, registers);
    }
}

impl Mcu for Stm32f405 {
    fn bus(&self) -> &Bus {
        &self.bus
    }

    fn bus_mut(&mut self) -> &mut Bus {
        &mut self.bus
    }

    /// A system reset (7.1.1): everything starts over but the reset flags, the backup domain (7.1.3) and what a debugger
    /// set up (38.16.3).
    fn reset(&mut self, at: VirtualNanos, cause: ResetCause) {
        let registers = |slot: usize| self.bus.slots()[slot].registers();
        let csr = registers(self.slots.rcc).get(rcc::Register::Csr);
        let bdcr = registers(self.slots.rcc).get(rcc::Register::Bdcr);
        let regulator = registers(self.slots.pwr).get(pwr::Register::Csr);
        let calendar = registers(self.slots.rtc).clone();
        let debug = registers(self.slots.dbg).clone();

        self.shared = Stm32f427::new().expect("it was made once");
        self.clocks = self.clocks.restarted();
        self.bus.reset();

        // Without power, none of it lasts.
        if cause != ResetCause::PowerOn {
            let registers = self.bus.slot_mut(self.slots.rcc).registers_mut();
            registers.set(rcc::Register::Bdcr, bdcr);
            self.clocks.library.restarted(cause, csr, registers);
            let registers = self.bus.slot_mut(self.slots.pwr).registers_mut();
            self.shared.pwr.keep_backup_regulator(regulator, registers);
            let registers = self.bus.slot_mut(self.slots.rtc).registers_mut();
            for register in rtc::Register::ALL {
                registers.set(register, calendar.get(register));
            }
            let registers = self.bus.slot_mut(self.slots.dbg).registers_mut();
            for register in dbg::Register::ALL {
                registers.set(register, debug.get(register));
            }
        }
        self.supply();
        self.set_idcode(self.idcode);

        Device::reset(&mut self.capture);
        Device::reset(&mut self.pins);
        Device::reset(&mut self.dma1);
        Device::reset(&mut self.port);
        Device::reset(&mut self.otg);
        Device::reset(&mut self.can);
        self.dma2 = dma::controller(1);
        let (registers, mut context) = self.bus.drive(at, self.slots.port);
        self.port.restarted(registers, &mut context);
        let (_, mut context) = self.bus.drive(at, self.slots.otg);
        self.otg.restarted(&mut context);
        let (_, mut context) = self.bus.drive(at, self.slots.can);
        self.can.restarted(&mut context);
        let (_, mut context) = self.bus.drive(at, self.slots.flash);
        self.flash.restarted(&mut context);
    }

    /// What is outside the part speaks to these. What the DMA holds back may go on at any time.
    fn poll(&mut self, now: VirtualNanos) {
        if self.looks {
            self.poll_outside(now);
        }
        let (registers, mut context) = self.bus.drive(now, self.slots.dma1);
        Device::poll(&mut self.dma1, registers, &mut context);
    }

    fn split(&mut self, slot: usize) -> (&mut Bus, Option<&mut dyn ErasedDevice>) {
        let slots = self.slots;
        let model: Option<&mut dyn ErasedDevice> = if slot == slots.port {
            Some(&mut self.port)
        } else if slot == slots.rcc {
            Some(&mut self.clocks)
        } else if slot == slots.capture {
            Some(&mut self.capture)
        } else if slot == slots.pins {
            Some(&mut self.pins)
        } else if slot == slots.otg {
            Some(&mut self.otg)
        } else if slot == slots.can {
            Some(&mut self.can)
        } else if slot == slots.flash {
            Some(&mut self.flash)
        } else if slot == slots.dma1 {
            Some(&mut self.dma1)
        } else if slot == slots.dma2 {
            Some(&mut self.dma2)
        } else {
            self.twins[slot].and_then(|twin| self.shared.split(twin).1)
        };
        (&mut self.bus, model)
    }
}

#[cfg(test)]
mod tests;
