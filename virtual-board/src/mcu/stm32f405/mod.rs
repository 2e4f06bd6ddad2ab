//! The STM32F405RG (RM0090). Sections are those of RM0090, revision 19; DS8626 is the data sheet.
//!
//! [`map`] says where everything is. This file joins the peripherals: it hands out accesses of the core, calls each
//! peripheral when something is due, and carries interrupts, DMA transfers and clocks between them.

mod bxcan;
mod capture;
mod dbgmcu;
mod dma;
mod flash;
mod map;
mod otg;
mod pwr;
mod rcc;
#[cfg(test)]
mod tests;
mod usart;

use std::sync::atomic::Ordering;

use self::bxcan::Can;
use self::capture::Capture;
use self::dbgmcu::Dbgmcu;
pub(crate) use self::dbgmcu::IDENTITY;
pub use self::dma::Reenabled;
use self::dma::{ALL_STREAMS, Dma, Request, Step};
use self::flash::Interface;
use self::map::{Block, interrupt};
use self::otg::Otg;
use self::pwr::Pwr;
use self::rcc::{BDCR, Clocks, Rcc};
use self::usart::Usart;
use super::common::gpio::{AtReset, Gpio};
use super::common::iwdg::Iwdg;
use super::common::syscfg::Syscfg;
use super::common::system_memory::starts_boot_loader;
use super::common::tim::Tim;
use crate::core::{self, Access, Bus, BusError, FlashTiming, Memory, Purpose, Width};
use crate::engine::News;
use crate::flash::SIZE;
use crate::line::{LOW, Pin};
use crate::shared::lock;
use crate::soc::clock::Clock;
use crate::soc::events::Events;
use crate::soc::lines::Lines;
use crate::soc::machine::{Cause, Chip, Edges};
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::soc::violations::Recorder;
use crate::time::Nanos;
use crate::trace::Trace;

/// DMA requests of USART2 (10.3.3, table 42).
const USART2_RX: Request = Request {
    controller: 0,
    stream: 5,
    channel: 4,
};
const USART2_TX: Request = Request {
    controller: 0,
    stream: 6,
    channel: 4,
};

/// The register that the DMA reads and writes.
const USART2_DR: u32 = 0x4000_4400 + usart::DR;

/// GPIOA's number, and its pin that USART2 sends on: PA2.
const PORT_A: u8 = 0;
const TX_PIN: u32 = 2;

/// What is called when its time has come. The number is the place among the events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    Rcc,
    Flash,
    Iwdg,
    Tim5,
    Usart2,
    Dma,
    Otg,
    Can,
}

const SLOTS: [Slot; 8] = [
    Slot::Rcc,
    Slot::Flash,
    Slot::Iwdg,
    Slot::Tim5,
    Slot::Usart2,
    Slot::Dma,
    Slot::Otg,
    Slot::Can,
];

/// Ports: GPIOA to GPIOI.
const PORTS: usize = 9;

/// Registers of GPIO ports after a reset (8.4.1, 8.4.3, 8.4.4). PA13 to PA15, PB3 and PB4 are the debugger's.
const fn gpio_at_reset(port: usize) -> AtReset {
    match port {
        0 => AtReset {
            moder: 0xA800_0000,
            ospeedr: 0,
            pupdr: 0x6400_0000,
        },
        1 => AtReset {
            moder: 0x0000_0280,
            ospeedr: 0x0000_00C0,
            pupdr: 0x0000_0100,
        },
        _ => AtReset {
            moder: 0,
            ospeedr: 0,
            pupdr: 0,
        },
    }
}

/// What a chip is, whatever is connected to it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Part {
    pub(crate) unique_id: [u8; 12],
    /// DBGMCU_IDCODE.
    pub(crate) idcode: u32,
    pub(crate) reenabled: Reenabled,
    /// The virtual time of a cycle, in percent.
    pub(crate) cycle_cost: u32,
    pub(crate) seed: u64,
}

/// The microcontroller, with an arm, a USB host and a CAN bus at its pins.
#[derive(Debug)]
pub(crate) struct Stm32f405 {
    part: Part,
    now: Nanos,
    /// Cycles of the core.
    clock: Clock,
    clocks: Clocks,
    edges: Edges,
    rcc: Rcc,
    pwr: Pwr,
    flash: Interface,
    iwdg: Iwdg,
    tim5: Tim,
    tim11: Capture,
    gpio: [Gpio; PORTS],
    syscfg: Syscfg,
    dbgmcu: Dbgmcu,
    usart2: Usart,
    dma: Dma,
    otg: Otg,
    can: Can,
    events: Events<{ SLOTS.len() }>,
    lines: Lines,
    /// No event is due before this, as far as the core knows.
    deadline: Nanos,
    powered: bool,
    /// The power was cut since this was last asked.
    was_cut: bool,
    in_boot_loader: bool,
    reset: Option<Cause>,
    clock_changed: bool,
    recorder: Recorder,
    trace: Trace,
}

impl Stm32f405 {
    /// A chip before its first reset.
    pub(crate) fn new(part: Part, edges: Edges) -> Self {
        let Part { seed, .. } = part;
        let (otg_clock, millivolts) = {
            let flash = lock(&edges.flash);
            (flash.clock, flash.millivolts)
        };
        let mut chip = Self {
            part,
            now: Nanos(0),
            clock: Clock::new(0, Nanos(0), 0),
            clocks: Clocks::default(),
            rcc: Rcc::new(edges.oscillator.clone(), seed),
            pwr: Pwr::new(millivolts, seed),
            flash: Interface::new(edges.flash.clone()),
            iwdg: Iwdg::new(false),
            tim5: Tim::new(),
            tim11: Capture::new(edges.oscillator.clone()),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), false)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::new(part.idcode),
            usart2: Usart::new(edges.line.clone()),
            dma: Dma::new(part.reenabled, seed),
            otg: Otg::new(edges.host.clone(), otg_clock),
            can: Can::new(edges.can.clone()),
            edges,
            events: Events::default(),
            lines: Lines::default(),
            deadline: Nanos(u64::MAX),
            powered: true,
            was_cut: false,
            in_boot_loader: false,
            reset: None,
            clock_changed: false,
            recorder: Recorder::default(),
            trace: Trace::default(),
        };
        lock(&chip.edges.line).set_pin(Pin::Free);
        chip.follow_clocks();
        chip
    }

    /// Core and memory of the chip, with this in the flash.
    pub(crate) fn core(flash: Vec<u8>) -> core::Core {
        let config = core::Config {
            interrupts: map::INTERRUPTS,
            priority_bits: map::PRIORITY_BITS,
            vector_table: map::FLASH,
            mpu_regions: 8,
            bit_band: true,
        };
        core::Core::new(config, Memory::new(map::FLASH, flash, map::RAM, map::RAM_SIZE))
    }

    /// Tells each peripheral the rate of its clock, and checks that supply and flash bear it.
    fn follow_clocks(&mut self) {
        let clocks = self.rcc.clocks(self.now);
        let hz = clocks.ahb * 100 / u64::from(self.part.cycle_cost);
        if hz != self.clock.hz() {
            self.clock.set_hz(hz, self.now);
            self.clock_changed = true;
        }
        let faults = [
            ("RCC", self.rcc.fault(self.now)),
            ("PWR", self.pwr.fault(clocks.ahb)),
            ("FLASH", self.flash.fault(clocks.ahb)),
        ];
        for (instance, fault) in faults {
            if let Some(Refused::Forbidden { register, reason }) = fault {
                self.recorder.forbidden(instance, register, reason);
            }
        }
        if clocks != self.clocks {
            self.clocks = clocks;
            self.tim5.set_clock(clocks.apb1_timers, self.now);
            self.tim11.set_clock(clocks.apb2_timers);
            self.usart2.set_clock(clocks.apb1, self.now);
            self.can.set_clock(clocks.apb1, self.now);
            self.otg.set_clock(clocks.usb, self.now);
            self.settle_all();
        }
    }

    fn settle_all(&mut self) {
        for slot in SLOTS {
            self.settle(slot);
        }
    }

    /// Takes over what changed in a peripheral: its interrupt, its DMA requests, when it wants to be called.
    #[inline]
    fn settle(&mut self, slot: Slot) {
        let due = match slot {
            Slot::Rcc => self.rcc.due(),
            Slot::Flash => {
                self.lines.set(interrupt::FLASH, self.flash.interrupts());
                self.flash.due()
            }
            Slot::Iwdg => self.iwdg.due(),
            Slot::Tim5 => {
                self.lines.set(interrupt::TIM5, self.tim5.interrupts());
                self.tim5.due()
            }
            Slot::Usart2 => {
                self.lines.set(interrupt::USART2, self.usart2.interrupts());
                self.follow_requests();
                self.events.set(Slot::Dma as usize, self.dma.due());
                self.usart2.due()
            }
            Slot::Dma => {
                for stream in 0..ALL_STREAMS {
                    self.lines.set(interrupt::DMA[stream], self.dma.interrupts(stream));
                }
                self.follow_requests();
                self.dma.due()
            }
            Slot::Otg => {
                self.lines.set(interrupt::OTG_FS, self.otg.interrupts());
                self.otg.due()
            }
            Slot::Can => {
                for (line, high) in interrupt::CAN1.into_iter().zip(self.can.interrupts()) {
                    self.lines.set(line, high);
                }
                self.can.due()
            }
        };
        self.events.set(slot as usize, due);
    }

    /// Whether a request is high.
    fn is_high(usart: &Usart, edges: &Edges, request: Request) -> bool {
        match request {
            USART2_RX => usart.requests_receive() && !edges.starve.load(Ordering::Relaxed),
            USART2_TX => usart.requests_transmit(),
            _ => false,
        }
    }

    fn follow_requests(&mut self) {
        for request in [USART2_RX, USART2_TX] {
            if Self::is_high(&self.usart2, &self.edges, request) {
                self.dma.request(request, self.now);
            }
        }
    }

    /// A step of a DMA stream.
    fn step_dma(&mut self, memory: &mut Memory) {
        let (usart, edges) = (&self.usart2, &self.edges);
        let Some((stream, step)) = self.dma.step(|request| Self::is_high(usart, edges, request), self.now) else {
            return;
        };
        match step {
            Step::ReadPeripheral(USART2_DR) => {
                match self.usart2.read(usart::DR, self.now) {
                    Ok(value) => self.dma.fetched(stream, value as u8, self.now),
                    Err(refused) => self.refuse_dma(stream, refused),
                }
                self.settle(Slot::Usart2);
            }
            Step::ReadMemory(address) => match memory.read(address, Width::Byte) {
                Some(value) => self.dma.fetched(stream, value as u8, self.now),
                None => self.fail_dma(stream, address),
            },
            Step::WritePeripheral(USART2_DR, value) => {
                if let Err(refused) = self.usart2.write(usart::DR, value.into(), self.now) {
                    self.refuse_dma(stream, refused);
                }
                self.settle(Slot::Usart2);
            }
            Step::WriteMemory(address, value) => {
                if memory.write(address, Width::Byte, value.into()).is_none() {
                    self.fail_dma(stream, address);
                }
            }
            Step::ReadPeripheral(address) | Step::WritePeripheral(address, _) => self.fail_dma(stream, address),
            Step::Counted => {}
        }
    }

    fn refuse_dma(&mut self, stream: usize, refused: Refused) {
        self.dma.fail(stream);
        self.recorder.register("USART2", refused, USART2_DR, 0, false);
    }

    fn fail_dma(&mut self, stream: usize, address: u32) {
        self.dma.fail(stream);
        self.recorder
            .refused(address, 0, "a DMA transfer that the bus does not take");
    }

    /// Does what reset bits of RCC say, as they are written.
    fn follow_resets(&mut self) {
        if !self.rcc.gates().holds_any() {
            return;
        }
        let blocks = [
            Block::Tim5,
            Block::Tim11,
            Block::Usart2,
            Block::Can1,
            Block::Pwr,
            Block::Syscfg,
            Block::Dma1,
            Block::Dma2,
            Block::OtgFs,
        ];
        let ports = (0..PORTS as u8).map(Block::Gpio);
        for block in blocks.into_iter().chain(ports) {
            if block.gate().is_some_and(|gate| self.rcc.gates().is_held(gate)) {
                self.reset_block(block);
            }
        }
        self.settle_all();
    }

    fn reset_block(&mut self, block: Block) {
        match block {
            Block::Tim5 => self.tim5.reset(self.now),
            Block::Tim11 => self.tim11.reset(),
            Block::Usart2 => self.usart2.reset(self.now),
            Block::Can1 => self.can.reset(self.now),
            Block::Pwr => self.pwr.reset(),
            Block::Syscfg => self.syscfg.reset(),
            Block::Dma1 => self.dma.reset(0),
            Block::Dma2 => self.dma.reset(1),
            Block::OtgFs => self.otg.reset(self.now),
            Block::Gpio(port) => {
                self.gpio[usize::from(port)].reset();
                self.follow_pin();
            }
            Block::Iwdg | Block::Exti | Block::Rcc | Block::Flash | Block::Dbgmcu => {}
        }
    }

    /// Tells the line who drives the pin that the UART sends on. Whether it is low now and was not before.
    fn follow_pin(&mut self) -> bool {
        let port = &self.gpio[usize::from(PORT_A)];
        let pin = port.driver(TX_PIN);
        let mut line = lock(&self.edges.line);
        let was_low = line.is_pin_low();
        line.set_pin(pin);
        line.is_pin_low() && !was_low
    }

    #[inline]
    fn read_block(&mut self, block: Block, offset: u32) -> Result<u32, Refused> {
        let now = self.now;
        match block {
            Block::Usart2 => {
                if offset == usart::DR && self.usart2.requests_receive() {
                    lock(&self.edges.line).take_byte();
                }
                let value = self.usart2.read(offset, now);
                self.settle(Slot::Usart2);
                value
            }
            Block::OtgFs => {
                let value = self.otg.read(offset, now);
                self.settle(Slot::Otg);
                value
            }
            Block::Tim5 => {
                let value = self.tim5.read(offset, now);
                self.settle(Slot::Tim5);
                value
            }
            Block::Can1 => self.can.read(offset, now),
            Block::Dma1 => self.dma.read(0, offset),
            Block::Dma2 => self.dma.read(1, offset),
            Block::Tim11 => self.tim11.read(offset, now),
            Block::Gpio(port) => self.gpio[usize::from(port)].read(offset, now),
            Block::Rcc => self.rcc.read(offset, now),
            Block::Pwr => self.pwr.read(offset, now),
            Block::Flash => self.flash.read(offset, now),
            Block::Iwdg => self.iwdg.read(offset, now),
            Block::Syscfg => self.syscfg.read(offset, now),
            Block::Dbgmcu => self.dbgmcu.read(offset, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
        }
    }

    fn write_block(&mut self, block: Block, offset: u32, value: u32) -> Result<(), Refused> {
        let now = self.now;
        match block {
            Block::Usart2 => {
                let written = self.usart2.write(offset, value, now);
                self.settle(Slot::Usart2);
                written
            }
            Block::OtgFs => {
                let written = self.otg.write(offset, value, now);
                self.settle(Slot::Otg);
                written
            }
            Block::Tim5 => {
                let written = self.tim5.write(offset, value, now);
                self.settle(Slot::Tim5);
                written
            }
            Block::Can1 => {
                let written = self.can.write(offset, value, now);
                self.settle(Slot::Can);
                written
            }
            Block::Dma1 | Block::Dma2 => {
                let written = self.dma.write(usize::from(block == Block::Dma2), offset, value);
                self.settle(Slot::Dma);
                written
            }
            Block::Tim11 => self.tim11.write(offset, value, now),
            Block::Gpio(port) => {
                let written = self.gpio[usize::from(port)].write(offset, value, now);
                if port == PORT_A && self.follow_pin() {
                    return Err(forbidden("MODER/ODR/BSRR", LOW));
                }
                written
            }
            Block::Rcc if offset == BDCR && !self.pwr.opens_backup_domain() => {
                Err(forbidden("BDCR", "5.4.1: written while DBP is clear"))
            }
            Block::Rcc => {
                let written = self.rcc.write(offset, value, now);
                self.follow_resets();
                self.follow_clocks();
                self.settle(Slot::Rcc);
                written
            }
            Block::Pwr if self.rcc.pll_is_on() && self.pwr.changes_scale(offset, value) => {
                Err(forbidden("CR", "5.1.3: VOS written while the PLL is on"))
            }
            Block::Pwr => {
                let written = self.pwr.write(offset, value, now);
                self.follow_clocks();
                written
            }
            Block::Flash => {
                let written = self.flash.write(offset, value, now);
                self.settle(Slot::Flash);
                self.follow_clocks();
                written
            }
            Block::Iwdg => {
                let written = self.iwdg.write(offset, value, now);
                if self.iwdg.runs() {
                    self.rcc.keep_lsi_on(now);
                    self.settle(Slot::Rcc);
                }
                self.settle(Slot::Iwdg);
                written
            }
            Block::Syscfg => self.syscfg.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
        }
    }

    /// The block at an address and the offset within it, if it takes the access.
    #[inline]
    fn block(&mut self, access: Access) -> Result<Option<(Block, u32)>, BusError> {
        let Some((block, offset)) = Block::at(access.address) else {
            self.recorder.unmapped(access.address, access.pc);
            return Err(BusError);
        };
        let reason = if !block.takes(access.width) {
            "not an access of this width"
        } else if block.gate().is_some_and(|gate| !self.rcc.gates().is_enabled(gate)) {
            "its clock is off"
        } else if block.gate().is_some_and(|gate| self.rcc.gates().is_held(gate)) {
            "it is held in reset"
        } else {
            return Ok(Some((block, offset)));
        };
        self.recorder.refused(access.address, access.pc, reason);
        Ok(None)
    }

    /// The instant of an access.
    #[inline]
    fn come_to(&mut self, access: Access) {
        if let Some(at) = self.clock.instant(access.cycle) {
            self.now = self.now.max(at);
        }
    }

    #[inline]
    fn trace(&mut self, access: Access, value: u32) {
        let (address, value) = (u64::from(access.address), u64::from(value));
        self.trace.add(address << 32 | value);
        self.trace.add(access.cycle);
    }

    /// Reads a register without leaving a trace or a violation, and without what reading it does.
    fn read_for_debugger(&mut self, access: Access) -> Result<u32, BusError> {
        if access.address >> 16 == 0x1FFF {
            return map::SYSTEM_MEMORY.read(access, &self.part.unique_id).ok_or(BusError);
        }
        let (block, offset) = Block::at(access.address).ok_or(BusError)?;
        let value = match block {
            Block::Usart2 => self.usart2.peek(offset),
            Block::OtgFs => self.otg.peek(offset),
            _ => self.read_block(block, offset),
        };
        value.map_err(|_| BusError)
    }

    fn read_system_memory(&mut self, access: Access) -> Result<u32, BusError> {
        if starts_boot_loader(access) {
            self.in_boot_loader = true;
        }
        let value = map::SYSTEM_MEMORY.read(access, &self.part.unique_id);
        value.ok_or_else(|| {
            self.recorder.unmapped(access.address, access.pc);
            BusError
        })
    }
}

impl Bus for Stm32f405 {
    fn read(&mut self, access: Access, _: &mut Memory) -> Result<u32, BusError> {
        if access.purpose == Purpose::Debug {
            return self.read_for_debugger(access);
        }
        self.come_to(access);
        if access.address >> 16 == 0x1FFF {
            return self.read_system_memory(access);
        }
        let Some((block, offset)) = self.block(access)? else {
            return Ok(0);
        };
        let value = self.read_block(block, offset).unwrap_or_else(|refused| {
            self.recorder
                .register(block.name(), refused, access.address, access.pc, false);
            0
        });
        self.trace(access, value);
        Ok(value)
    }

    fn write(&mut self, access: Access, value: u32, _: &mut Memory) -> Result<(), BusError> {
        self.come_to(access);
        self.trace(access, value);
        let flash_offset = access.address.wrapping_sub(map::FLASH);
        let (name, written) = if (flash_offset as usize) < SIZE {
            let stored = self.flash.store(flash_offset, access.width, value, self.now);
            self.settle(Slot::Flash);
            ("FLASH", stored)
        } else {
            let Some((block, offset)) = self.block(access)? else {
                return Ok(());
            };
            (block.name(), self.write_block(block, offset, value))
        };
        if let Err(refused) = written {
            self.recorder.register(name, refused, access.address, access.pc, true);
        }
        Ok(())
    }

    #[inline]
    fn needs_attention(&self) -> bool {
        self.lines.changed()
            || self.events.next() < self.deadline
            || self.clock_changed
            || self.in_boot_loader
            || self.flash.is_busy()
    }
}

impl Chip for Stm32f405 {
    fn clock(&self) -> &Clock {
        &self.clock
    }

    fn come_near(&mut self, now: Nanos) {
        self.clock.come_near(now);
    }

    fn flash_timing(&self) -> FlashTiming {
        self.flash.timing()
    }

    fn next_event(&self) -> Nanos {
        self.events.next()
    }

    fn set_deadline(&mut self, deadline: Nanos) {
        self.deadline = deadline;
        self.clock_changed = false;
    }

    fn handle_event(&mut self, memory: &mut Memory) {
        let due = self.events.next();
        let Some(slot) = self.events.take(due) else {
            return;
        };
        self.now = self.now.max(due);
        self.trace.add(self.now.0);
        self.trace.add(slot as u64);
        match SLOTS[slot] {
            Slot::Rcc => {
                self.rcc.advance(self.now);
                self.follow_clocks();
            }
            Slot::Flash => {
                if self.flash.take_cut(self.now) {
                    lock(&self.edges.flash).cut = Some(self.now);
                    self.was_cut = true;
                    self.power_off(memory);
                } else {
                    self.flash.finish(self.now, memory);
                }
            }
            Slot::Iwdg => {
                self.iwdg.advance(self.now);
                if self.iwdg.take_expired() {
                    self.reset = Some(Cause::Watchdog);
                }
            }
            Slot::Tim5 => self.tim5.advance(self.now),
            Slot::Usart2 => self.usart2.advance(self.now),
            Slot::Dma => self.step_dma(memory),
            Slot::Otg => self.otg.advance(self.now),
            Slot::Can => self.can.advance(self.now),
        }
        self.settle(SLOTS[slot]);
    }

    fn look(&mut self, now: Nanos, memory: &mut Memory) {
        self.now = self.now.max(now);
        self.usart2.look(self.now);
        self.otg.settle(self.now);
        self.can.settle(self.now);
        self.rcc.look(self.now);
        self.pwr.set_supply(self.flash.millivolts());
        for slot in [Slot::Usart2, Slot::Otg, Slot::Can, Slot::Rcc] {
            self.settle(slot);
        }
        let supply = lock(&self.edges.flash).supply.take();
        match supply {
            Some(true) => self.reset = Some(Cause::Power),
            Some(false) => self.power_off(memory),
            None => {}
        }
    }

    fn take_interrupt(&mut self) -> Option<(u16, bool)> {
        self.lines.take_change()
    }

    fn take_nmi(&mut self) -> bool {
        false
    }

    fn take_reset(&mut self) -> Option<Cause> {
        self.reset.take()
    }

    fn holds_core(&self) -> bool {
        !self.powered || self.in_boot_loader || self.flash.is_busy()
    }

    fn is_in_boot_loader(&self) -> bool {
        self.in_boot_loader
    }

    fn take_news(&mut self) -> News {
        let can = self.can.take_progress();
        News {
            any: self.otg.take_progress() || can,
            heard: can && self.can.has_unread(),
            cut: std::mem::take(&mut self.was_cut),
        }
    }

    fn restart(&mut self, cause: Cause, now: Nanos, memory: &mut Memory) {
        self.now = self.now.max(now);
        self.restart_peripherals(memory);
        self.powered = true;
        self.rcc.reset(cause);
        if cause == Cause::Power {
            self.dbgmcu.reset();
        }
        self.follow_clocks();
        self.settle_all();
    }

    fn recorder(&self) -> &Recorder {
        &self.recorder
    }

    fn trace(&self) -> Trace {
        self.trace
    }
}

impl Stm32f405 {
    /// Everything that a system reset resets but the clocks (7.1.1).
    fn restart_peripherals(&mut self, memory: &mut Memory) {
        self.flash.restart(memory);
        self.pwr.reset();
        self.iwdg = Iwdg::new(false);
        self.tim5.reset(self.now);
        self.tim11.reset();
        self.gpio.iter_mut().for_each(Gpio::reset);
        self.follow_pin();
        self.syscfg.reset();
        self.usart2.reset(self.now);
        self.dma.reset(0);
        self.dma.reset(1);
        self.otg.reset(self.now);
        self.can.reset(self.now);
        self.in_boot_loader = false;
        self.reset = None;
        self.events = Events::default();
        self.lines = Lines::default();
    }

    fn power_off(&mut self, memory: &mut Memory) {
        self.powered = false;
        self.restart_peripherals(memory);
        self.settle_all();
    }
}
