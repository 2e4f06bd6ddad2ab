//! The STM32G431xB (RM0440). Sections are those of RM0440, revision 8; DS12589 is the data sheet.
//!
//! [`map`] says where everything is. This file joins the peripherals: it hands out accesses of the core, calls each
//! peripheral when something is due, and carries interrupts, DMA transfers and clocks between them.

mod crs;
mod dbgmcu;
mod dma;
mod fdcan;
mod flash;
mod map;
mod pwr;
mod rcc;
mod usart;
mod usb;

use self::crs::Crs;
use self::dbgmcu::Dbgmcu;
use self::dma::{ALL_CHANNELS, CHANNELS, Dma, Step};
use self::fdcan::Fdcan;
use self::flash::Interface;
use self::map::{Block, interrupt};
use self::pwr::Pwr;
use self::rcc::{Clocks, Rcc};
use self::usart::Usart;
use self::usb::Usb;
use super::common::gpio::{AtReset, Gpio};
use super::common::iwdg::Iwdg;
use super::common::syscfg::Syscfg;
use super::common::system_memory::starts_boot_loader;
use super::common::tim::Tim;
use crate::core::{self, Access, Bus, BusError, FlashTiming, Memory, Purpose, Width};
use crate::engine::News;
use crate::shared::lock;
use crate::soc::clock::Clock;
use crate::soc::events::Events;
use crate::soc::lines::Lines;
use crate::soc::machine::{Cause, Chip, Edges};
use crate::soc::peripheral::{Peripheral, Refused};
use crate::soc::violations::Recorder;
use crate::time::Nanos;
use crate::trace::Trace;

/// The pin of port A that USART2 sends on.
const TX_PIN: u32 = 2;

/// What a pin that sends and is low says of the firmware.
const LOW: &str = "9.3.2, 37.5.5: nothing drives PA2, or it is low, and the arm may take that for a start bit";

/// Requests of the DMAMUX (13.3.2, table 91).
const USART2_RX: u32 = 26;
const USART2_TX: u32 = 27;

/// Registers that the DMA reads and writes.
const USART2_RDR: u32 = 0x4000_4424;
const USART2_TDR: u32 = 0x4000_4428;

/// What is called when its time has come. The number is the place among the events.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Slot {
    Rcc,
    Flash,
    Iwdg,
    Tim2,
    Usart2,
    Dma,
    Usb,
    Fdcan,
}

const SLOTS: [Slot; 8] = [
    Slot::Rcc,
    Slot::Flash,
    Slot::Iwdg,
    Slot::Tim2,
    Slot::Usart2,
    Slot::Dma,
    Slot::Usb,
    Slot::Fdcan,
];

/// Registers of GPIO ports after a reset (9.4.1, 9.4.3, 9.4.4). PA13 to PA15, PB3 and PB4 are the debugger's.
const fn gpio_at_reset(port: usize) -> AtReset {
    match port {
        0 => AtReset {
            moder: 0xABFF_FFFF,
            ospeedr: 0x0C00_0000,
            pupdr: 0x6400_0000,
        },
        1 => AtReset {
            moder: 0xFFFF_FEBF,
            ospeedr: 0x0000_00C0,
            pupdr: 0x0000_0100,
        },
        _ => AtReset {
            moder: 0xFFFF_FFFF,
            ospeedr: 0,
            pupdr: 0,
        },
    }
}

/// The microcontroller, with an arm, a USB host and a CAN bus at its pins.
#[derive(Debug)]
pub(crate) struct Stm32g431 {
    now: Nanos,
    /// Cycles of the core.
    clock: Clock,
    /// The virtual time of a cycle, in percent.
    cycle_cost: u64,
    clocks: Clocks,
    unique_id: [u8; 12],
    edges: Edges,
    rcc: Rcc,
    pwr: Pwr,
    flash: Interface,
    iwdg: Iwdg,
    tim2: Tim,
    gpio: [Gpio; 7],
    syscfg: Syscfg,
    dbgmcu: Dbgmcu,
    crs: Crs,
    usart2: Usart,
    dma: Dma,
    usb: Usb,
    fdcan: Fdcan,
    events: Events<{ SLOTS.len() }>,
    lines: Lines,
    /// No event is due before this, as far as the core knows.
    deadline: Nanos,
    powered: bool,
    /// The power was cut since this was last asked.
    was_cut: bool,
    in_boot_loader: bool,
    reset: Option<Cause>,
    nmi: bool,
    clock_changed: bool,
    recorder: Recorder,
    trace: Trace,
}

impl Stm32g431 {
    /// A chip before its first reset.
    pub(crate) fn new(unique_id: [u8; 12], cycle_cost: u32, seed: u64, edges: Edges) -> Self {
        let rcc = Rcc::new(edges.oscillator.clone(), seed);
        let mut chip = Self {
            now: Nanos(0),
            clock: Clock::new(0, Nanos(0), 0),
            cycle_cost: cycle_cost.into(),
            clocks: Clocks::default(),
            unique_id,
            rcc,
            pwr: Pwr::default(),
            flash: Interface::new(edges.flash.clone()),
            iwdg: Iwdg::new(true),
            tim2: Tim::new(),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), true)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::default(),
            crs: Crs::default(),
            usart2: Usart::new(edges.line.clone()),
            dma: Dma::new(seed),
            usb: Usb::new(edges.host.clone()),
            fdcan: Fdcan::new(edges.can.clone()),
            edges,
            events: Events::default(),
            lines: Lines::default(),
            deadline: Nanos(u64::MAX),
            powered: true,
            was_cut: false,
            in_boot_loader: false,
            reset: None,
            nmi: false,
            clock_changed: false,
            recorder: Recorder::default(),
            trace: Trace::default(),
        };
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
        let hz = clocks.ahb * 100 / self.cycle_cost;
        if hz != self.clock.hz() {
            self.clock.set_hz(hz, self.now);
            self.clock_changed = true;
        }
        if let Some(Refused::Forbidden { register, reason }) = self.rcc.fault(self.now) {
            self.recorder.forbidden("RCC", register, reason);
        }
        let fault = self.pwr.supply().fault(clocks.ahb, self.flash.wait_states());
        if let Some((instance, Refused::Forbidden { register, reason })) = fault {
            self.recorder.forbidden(instance, register, reason);
        }
        if clocks != self.clocks {
            self.clocks = clocks;
            self.tim2.set_clock(clocks.apb1_timers, self.now);
            self.usart2.set_clock(clocks.usart2, self.now);
            self.usb.set_clock(clocks.usb, self.now);
            self.fdcan.set_clock(clocks.fdcan, self.now);
            self.settle_all();
        }
    }

    fn settle_all(&mut self) {
        for slot in SLOTS {
            self.settle(slot);
        }
    }

    /// Takes over what changed in a peripheral: its interrupt, its DMA requests, when it wants to be called.
    fn settle(&mut self, slot: Slot) {
        let due = match slot {
            Slot::Rcc => self.rcc.due(),
            Slot::Flash => self.flash.due(),
            Slot::Iwdg => self.iwdg.due(),
            Slot::Tim2 => {
                self.lines.set(interrupt::TIM2, self.tim2.interrupts());
                self.tim2.due()
            }
            Slot::Usart2 => {
                self.lines.set(interrupt::USART2, self.usart2.interrupts());
                let requests = Requests::of(&self.usart2, &self.edges);
                self.dma.follow_requests(|request| requests.is_high(request), self.now);
                self.events.set(Slot::Dma as usize, self.dma.due());
                self.usart2.due()
            }
            Slot::Dma => {
                self.settle_dma_interrupts();
                let requests = Requests::of(&self.usart2, &self.edges);
                self.dma.follow_requests(|request| requests.is_high(request), self.now);
                self.dma.due()
            }
            Slot::Usb => {
                self.lines.set(interrupt::USB_LP, self.usb.interrupts());
                if self.usb.take_start_of_frame() {
                    self.crs.start_of_frame();
                }
                self.usb.due()
            }
            Slot::Fdcan => {
                let [line_0, line_1] = self.fdcan.interrupts();
                self.lines.set(interrupt::FDCAN1_IT0, line_0);
                self.lines.set(interrupt::FDCAN1_IT1, line_1);
                self.fdcan.due()
            }
        };
        self.events.set(slot as usize, due);
    }

    fn settle_dma_interrupts(&mut self) {
        for channel in 0..ALL_CHANNELS {
            let line = match channel {
                0..CHANNELS => interrupt::DMA1_CHANNEL1 + channel as u16,
                11 => interrupt::DMA2_CHANNEL6,
                _ => interrupt::DMA2_CHANNEL1 + (channel - CHANNELS) as u16,
            };
            self.lines.set(line, self.dma.interrupts(channel));
        }
    }

    /// A step of a DMA channel.
    fn step_dma(&mut self, memory: &mut Memory) {
        let requests = Requests::of(&self.usart2, &self.edges);
        let Some((channel, step)) = self.dma.step(|request| requests.is_high(request), self.now) else {
            return;
        };
        match step {
            Step::ReadPeripheral(USART2_RDR) => {
                match self.usart2.read(USART2_RDR & 0x3FF, self.now) {
                    Ok(value) => self.dma.fetched(channel, value as u8, self.now),
                    Err(refused) => self.refuse_dma(channel, USART2_RDR, refused),
                }
                self.settle(Slot::Usart2);
            }
            Step::ReadMemory(address) => match memory.read(address, Width::Byte) {
                Some(value) => self.dma.fetched(channel, value as u8, self.now),
                None => self.fail_dma(channel, address),
            },
            Step::WritePeripheral(USART2_TDR, value) => {
                if let Err(refused) = self.usart2.write(USART2_TDR & 0x3FF, value.into(), self.now) {
                    self.refuse_dma(channel, USART2_TDR, refused);
                }
                self.settle(Slot::Usart2);
            }
            Step::WriteMemory(address, value) => {
                if memory.write(address, Width::Byte, value.into()).is_none() {
                    self.fail_dma(channel, address);
                }
            }
            Step::ReadPeripheral(address) | Step::WritePeripheral(address, _) => self.fail_dma(channel, address),
            Step::Counted => {}
        }
    }

    fn refuse_dma(&mut self, channel: usize, address: u32, refused: Refused) {
        self.dma.fail(channel);
        self.recorder.register("USART2", refused, address, 0, false);
    }

    fn fail_dma(&mut self, channel: usize, address: u32) {
        self.dma.fail(channel);
        self.recorder
            .refused(address, 0, "a DMA transfer that the bus does not take");
    }

    /// Does what reset bits of RCC say, as they are written.
    fn follow_resets(&mut self) {
        let held = |block: Block| block.gate().is_some_and(|gate| self.rcc.gates().is_held(gate));
        let resets = [
            Block::Tim2,
            Block::Crs,
            Block::Usart2,
            Block::Usb,
            Block::Fdcan1,
            Block::Pwr,
            Block::Syscfg,
            Block::Dma1,
            Block::Dma2,
            Block::Dmamux1,
            Block::Flash,
        ]
        .map(|block| (block, held(block)));
        let ports: [bool; 7] = std::array::from_fn(|port| held(Block::Gpio(port as u8)));
        for (block, _) in resets.into_iter().filter(|(_, held)| *held) {
            match block {
                Block::Tim2 => self.tim2.reset(self.now),
                Block::Crs => self.crs = Crs::default(),
                Block::Usart2 => self.usart2.reset(self.now),
                Block::Usb => self.usb.reset(self.now),
                Block::Fdcan1 => self.fdcan.reset(self.now),
                Block::Pwr => self.pwr = Pwr::default(),
                Block::Syscfg => self.syscfg.reset(),
                Block::Dma1 => self.dma.reset(0),
                Block::Dma2 => self.dma.reset(1),
                Block::Dmamux1 => self.dma.reset_multiplexer(),
                Block::Flash => self.flash.reset(),
                _ => {}
            }
        }
        for (port, _) in self.gpio.iter_mut().zip(ports).filter(|(_, held)| *held) {
            port.reset();
        }
        self.settle_all();
    }

    fn read_block(&mut self, block: Block, offset: u32) -> Result<u32, Refused> {
        let now = self.now;
        match block {
            Block::Tim2 => {
                let value = self.tim2.read(offset, now);
                self.settle(Slot::Tim2);
                value
            }
            Block::Usart2 => {
                let value = self.usart2.read(offset, now);
                self.settle(Slot::Usart2);
                value
            }
            Block::Usb => self.usb.read(offset, now),
            Block::PacketMemory => Ok(self.usb.read_packet_memory(offset)),
            Block::Dma1 => self.dma.read(0, offset),
            Block::Dma2 => self.dma.read(1, offset),
            Block::Dmamux1 => self.dma.read_multiplexer(offset),
            Block::Gpio(port) => self.gpio[usize::from(port)].read(offset, now),
            Block::Rcc => self.rcc.read(offset, now),
            Block::Pwr => self.pwr.read(offset, now),
            Block::Flash => self.flash.read(offset, now),
            Block::Iwdg => self.iwdg.read(offset, now),
            Block::Crs => self.crs.read(offset, now),
            Block::Syscfg => self.syscfg.read(offset, now),
            Block::Dbgmcu => self.dbgmcu.read(offset, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
            Block::Fdcan1 => self.fdcan.read(offset, now),
            Block::MessageRam => self.fdcan.read_ram(offset),
        }
    }

    fn write_block(&mut self, block: Block, offset: u32, value: u32) -> Result<(), Refused> {
        let now = self.now;
        match block {
            Block::Tim2 => {
                let written = self.tim2.write(offset, value, now);
                self.settle(Slot::Tim2);
                written
            }
            Block::Usart2 => {
                let written = self.usart2.write(offset, value, now);
                self.settle(Slot::Usart2);
                self.follow_pin("USART2", "CR1");
                written
            }
            Block::Usb => {
                let written = self.usb.write(offset, value, now);
                self.settle(Slot::Usb);
                written
            }
            Block::PacketMemory => {
                self.usb.write_packet_memory(offset, value);
                Ok(())
            }
            Block::Dma1 | Block::Dma2 => {
                let written = self.dma.write(usize::from(block == Block::Dma2), offset, value);
                self.settle(Slot::Dma);
                written
            }
            Block::Dmamux1 => {
                let written = self.dma.write_multiplexer(offset, value);
                self.settle(Slot::Dma);
                written
            }
            Block::Gpio(port) => {
                let written = self.gpio[usize::from(port)].write(offset, value, now);
                self.follow_pin("GPIOA", "MODER");
                written
            }
            Block::Rcc => {
                let written = self.rcc.write(offset, value, now);
                self.follow_resets();
                self.follow_clocks();
                written
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
            Block::Crs => self.crs.write(offset, value, now),
            Block::Syscfg => self.syscfg.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
            Block::Fdcan1 => {
                let written = self.fdcan.write(offset, value, now);
                self.settle(Slot::Fdcan);
                written
            }
            Block::MessageRam => self.fdcan.write_ram(offset, value),
        }
    }

    /// Tells the line who drives PA2. Nobody, or low, is a violation of the register that made it so.
    fn follow_pin(&mut self, instance: &'static str, register: &'static str) {
        let mut line = lock(&self.edges.line);
        let was_low = line.is_pin_low();
        line.set_pin(self.gpio[0].driver(TX_PIN));
        line.set_transmits(self.usart2.transmits());
        if line.is_pin_low() && !was_low {
            self.recorder.forbidden(instance, register, LOW);
        }
    }

    /// The block at an address, if it takes the access.
    fn block(&mut self, access: Access) -> Result<Option<Block>, BusError> {
        let Some(block) = Block::at(access.address) else {
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
            return Ok(Some(block));
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

    /// Reads a register without leaving a trace or a violation. One that changes as it is read does so here, too.
    fn read_for_debugger(&mut self, access: Access) -> Result<u32, BusError> {
        let block = Block::at(access.address).ok_or(BusError)?;
        self.read_block(block, access.address & 0x3FF).map_err(|_| BusError)
    }

    fn read_system_memory(&mut self, access: Access) -> Result<u32, BusError> {
        if starts_boot_loader(access) {
            self.in_boot_loader = true;
        }
        let value = map::SYSTEM_MEMORY.read(access, &self.unique_id);
        value.ok_or_else(|| {
            self.recorder.unmapped(access.address, access.pc);
            BusError
        })
    }
}

/// Levels of the DMA requests.
#[derive(Clone, Copy, Debug)]
struct Requests {
    receive: bool,
    transmit: bool,
}

impl Requests {
    fn of(usart: &Usart, edges: &Edges) -> Self {
        Self {
            receive: usart.requests_receive() && !edges.starve.load(std::sync::atomic::Ordering::Relaxed),
            transmit: usart.requests_transmit(),
        }
    }

    fn is_high(self, request: u32) -> bool {
        match request {
            USART2_RX => self.receive,
            USART2_TX => self.transmit,
            _ => false,
        }
    }
}

impl Bus for Stm32g431 {
    fn read(&mut self, access: Access, memory: &mut Memory) -> Result<u32, BusError> {
        if access.purpose == Purpose::Debug {
            return self.read_for_debugger(access);
        }
        self.come_to(access);
        let flash_offset = access.address.wrapping_sub(map::FLASH);
        if (flash_offset as usize) < flash::SIZE {
            self.nmi |= self.flash.check_read(flash_offset);
            return memory.read(access.address, access.width).ok_or(BusError);
        }
        if access.address >> 16 == 0x1FFF {
            return self.read_system_memory(access);
        }
        let Some(block) = self.block(access)? else {
            return Ok(0);
        };
        let offset = access.address & 0x3FF;
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
        let (name, written) = if (flash_offset as usize) < flash::SIZE {
            let stored = self.flash.store(flash_offset, access.width, value, self.now);
            self.settle(Slot::Flash);
            ("FLASH", stored)
        } else {
            let Some(block) = self.block(access)? else {
                return Ok(());
            };
            (block.name(), self.write_block(block, access.address & 0x3FF, value))
        };
        if let Err(refused) = written {
            self.recorder.register(name, refused, access.address, access.pc, true);
        }
        Ok(())
    }

    fn needs_attention(&self) -> bool {
        self.lines.changed()
            || self.events.next() < self.deadline
            || self.clock_changed
            || self.nmi
            || self.in_boot_loader
            || self.flash.is_busy()
    }
}

impl Chip for Stm32g431 {
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
            Slot::Tim2 => self.tim2.advance(self.now),
            Slot::Usart2 => self.usart2.advance(self.now),
            Slot::Dma => self.step_dma(memory),
            Slot::Usb => self.usb.advance(self.now),
            Slot::Fdcan => self.fdcan.advance(self.now),
        }
        self.settle(SLOTS[slot]);
    }

    fn look(&mut self, now: Nanos, memory: &mut Memory) {
        self.now = self.now.max(now);
        self.usart2.look(self.now);
        self.usb.settle(self.now);
        self.fdcan.settle(self.now);
        self.rcc.look(self.now);
        for slot in [Slot::Usart2, Slot::Usb, Slot::Fdcan, Slot::Rcc] {
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
        std::mem::take(&mut self.nmi)
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
        let can = self.fdcan.take_progress();
        News {
            any: self.usb.take_progress() || can,
            heard: can && self.fdcan.has_unread(),
            cut: std::mem::take(&mut self.was_cut),
        }
    }

    fn restart(&mut self, cause: Cause, now: Nanos, memory: &mut Memory) {
        self.now = self.now.max(now);
        self.restart_peripherals(memory);
        self.powered = true;
        self.rcc.reset(cause);
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

impl Stm32g431 {
    /// Everything that a system reset resets but the clocks.
    fn restart_peripherals(&mut self, memory: &mut Memory) {
        self.flash.restart(memory);
        self.pwr = Pwr::default();
        self.iwdg = Iwdg::new(true);
        self.tim2.reset(self.now);
        self.gpio.iter_mut().for_each(Gpio::reset);
        self.syscfg.reset();
        self.crs = Crs::default();
        self.usart2.reset(self.now);
        self.follow_pin("GPIOA", "MODER");
        self.dma.reset(0);
        self.dma.reset(1);
        self.dma.reset_multiplexer();
        self.usb.reset(self.now);
        self.fdcan.reset(self.now);
        self.in_boot_loader = false;
        self.reset = None;
        self.nmi = false;
        self.events = Events::default();
        self.lines = Lines::default();
    }

    fn power_off(&mut self, memory: &mut Memory) {
        self.powered = false;
        self.restart_peripherals(memory);
        self.settle_all();
    }
}

#[cfg(test)]
mod tests;
