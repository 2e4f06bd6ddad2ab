//! The STM32F405RG (RM0090). Sections are those of RM0090, revision 19; DS8626 is the data sheet.
//!
//! [`map`] has the addresses. This file connects the peripherals: interrupts, DMA transfers and clocks. The flow of
//! accesses, events and resets is common to both chips, in [`mcu`](super::common::mcu).

mod bxcan;
mod capture;
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
pub use self::dma::Reenabled;
use self::dma::{ALL_STREAMS, Dma, Request};
use self::flash::Interface;
pub(crate) use self::map::IDENTITY;
use self::map::{Block, interrupt};
use self::otg::Otg;
use self::pwr::Pwr;
use self::rcc::{BDCR, Clocks, Rcc};
use self::usart::Usart;
use super::common::dbgmcu::Dbgmcu;
use super::common::dma::Requests;
use super::common::gpio::{AtReset, Gpio};
use super::common::iwdg::Iwdg;
use super::common::mcu::{Block as _, Common, Map, Peripherals, Slot};
use super::common::rcc::Gate;
use super::common::syscfg::Syscfg;
use super::common::tim::Tim;
use crate::core::{FlashTiming, Memory, Width};
use crate::engine::News;
use crate::line::{LOW, Pin};
use crate::shared::lock;
use crate::soc::machine::{Cause, Edges};
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::time::Nanos;

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

/// The register accessed by the DMA.
const USART2_DR: u32 = 0x4000_4400 + usart::DR;

/// GPIOA's number, and the TX pin of USART2: PA2.
const PORT_A: u8 = 0;
const TX_PIN: u32 = 2;

/// Number of ports: GPIOA to GPIOI.
const PORTS: usize = 9;

/// Reset values of GPIO registers (8.4.1, 8.4.3, 8.4.4). PA13 to PA15, PB3 and PB4 belong to the debugger.
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

/// The peripherals.
#[derive(Debug)]
pub(crate) struct Stm32f405 {
    clocks: Clocks,
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
}

impl Stm32f405 {
    /// The peripherals before the first reset, of a chip of this revision (DBGMCU_IDCODE).
    pub(crate) fn new(idcode: u32, reenabled: Reenabled, seed: u64, edges: &Edges) -> Self {
        lock(&edges.line).set_pin(Pin::Free);
        let (otg_clock, millivolts) = {
            let flash = lock(&edges.flash);
            (flash.clock, flash.millivolts)
        };
        Self {
            clocks: Clocks::default(),
            rcc: Rcc::new(edges.oscillator.clone(), seed),
            pwr: Pwr::new(millivolts, seed),
            flash: Interface::new(edges.flash.clone()),
            iwdg: Iwdg::new(false),
            tim5: Tim::new(),
            tim11: Capture::new(edges.oscillator.clone()),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), false)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::new(&map::DBGMCU, idcode),
            usart2: Usart::new(edges.line.clone()),
            dma: Dma::new(reenabled, seed),
            otg: Otg::new(edges.host.clone(), otg_clock),
            can: Can::new(edges.can.clone()),
        }
    }

    /// The levels of the DMA requests.
    fn requests(&self, common: &Common) -> Requests {
        Requests {
            receive: self.usart2.requests_receive() && !common.edges.starve.load(Ordering::Relaxed),
            transmit: self.usart2.requests_transmit(),
        }
    }

    fn follow_requests(&mut self, common: &Common) {
        let requests = self.requests(common);
        for request in [USART2_RX, USART2_TX] {
            if is_high(requests, request) {
                self.dma.request(request, common.now);
            }
        }
    }

    /// Executes a step of a DMA stream.
    fn step_dma(&mut self, common: &mut Common, memory: &mut Memory) {
        let now = common.now;
        let requests = self.requests(common);
        let Some((stream, step)) = self.dma.step(|request| is_high(requests, request), now) else {
            return;
        };
        let usart = &mut self.usart2;
        let done = step.run(memory, |address, value| match (address, value) {
            (USART2_DR, None) => Some(usart.read(usart::DR, now).map(|value| value as u8)),
            (USART2_DR, Some(value)) => Some(usart.write(usart::DR, value.into(), now).map(|()| value)),
            _ => None,
        });
        match done {
            Ok(Some(value)) => self.dma.fetched(stream, value, now),
            Ok(None) => {}
            Err(failure) => {
                self.dma.fail(stream);
                common.record_dma("USART2", failure);
            }
        }
        self.settle(Slot::Usart, common);
    }

    /// Executes the reset bits of RCC, as they are written.
    fn follow_resets(&mut self, common: &mut Common) {
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
                self.reset_block(block, common);
            }
        }
        self.settle_all(common);
    }

    fn reset_block(&mut self, block: Block, common: &Common) {
        match block {
            Block::Tim5 => self.tim5.reset(common.now),
            Block::Tim11 => self.tim11.reset(),
            Block::Usart2 => self.usart2.reset(common.now),
            Block::Can1 => self.can.reset(common.now),
            Block::Pwr => self.pwr.reset(),
            Block::Syscfg => self.syscfg.reset(),
            Block::Dma1 => self.dma.reset(0),
            Block::Dma2 => self.dma.reset(1),
            Block::OtgFs => self.otg.reset(common.now),
            Block::Gpio(port) => {
                self.gpio[usize::from(port)].reset();
                self.follow_pin(common);
            }
            Block::Iwdg | Block::Exti | Block::Rcc | Block::Flash | Block::Dbgmcu => {}
        }
    }

    /// Updates the driver of the UART's TX pin. Returns true if the pin has become low.
    fn follow_pin(&mut self, common: &Common) -> bool {
        let port = &self.gpio[usize::from(PORT_A)];
        let pin = port.driver(TX_PIN);
        let mut line = lock(&common.edges.line);
        let was_low = line.is_pin_low();
        line.set_pin(pin);
        line.is_pin_low() && !was_low
    }
}

/// Returns true if a request is high.
fn is_high(requests: Requests, request: Request) -> bool {
    match request {
        USART2_RX => requests.receive,
        USART2_TX => requests.transmit,
        _ => false,
    }
}

impl Peripherals for Stm32f405 {
    type Block = Block;

    const MAP: Map = map::MAP;

    #[inline]
    fn is_enabled(&self, gate: Gate) -> bool {
        self.rcc.gates().is_enabled(gate)
    }

    #[inline]
    fn is_held(&self, gate: Gate) -> bool {
        self.rcc.gates().is_held(gate)
    }

    #[inline]
    fn read(&mut self, block: Block, offset: u32, common: &mut Common) -> Result<u32, Refused> {
        let now = common.now;
        match block {
            Block::Usart2 => {
                if offset == usart::DR && self.usart2.requests_receive() {
                    lock(&common.edges.line).take_byte();
                }
                let value = self.usart2.read(offset, now);
                self.settle(Slot::Usart, common);
                value
            }
            Block::OtgFs => {
                let value = self.otg.read(offset, now);
                self.settle(Slot::Usb, common);
                value
            }
            Block::Tim5 => {
                let value = self.tim5.read(offset, now);
                self.settle(Slot::Tim, common);
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

    fn peek(&mut self, block: Block, offset: u32, common: &mut Common) -> Result<u32, Refused> {
        match block {
            Block::Usart2 => self.usart2.peek(offset),
            Block::OtgFs => self.otg.peek(offset),
            _ => self.read(block, offset, common),
        }
    }

    fn write(&mut self, block: Block, offset: u32, value: u32, common: &mut Common) -> Result<(), Refused> {
        let now = common.now;
        match block {
            Block::Usart2 => {
                let written = self.usart2.write(offset, value, now);
                self.settle(Slot::Usart, common);
                written
            }
            Block::OtgFs => {
                let written = self.otg.write(offset, value, now);
                self.settle(Slot::Usb, common);
                written
            }
            Block::Tim5 => {
                let written = self.tim5.write(offset, value, now);
                self.settle(Slot::Tim, common);
                written
            }
            Block::Can1 => {
                let written = self.can.write(offset, value, now);
                self.settle(Slot::Can, common);
                written
            }
            Block::Dma1 | Block::Dma2 => {
                let written = self.dma.write(usize::from(block == Block::Dma2), offset, value);
                self.settle(Slot::Dma, common);
                written
            }
            Block::Tim11 => self.tim11.write(offset, value, now),
            Block::Gpio(port) => {
                let written = self.gpio[usize::from(port)].write(offset, value, now);
                if port == PORT_A && self.follow_pin(common) {
                    return Err(forbidden("MODER/ODR/BSRR", LOW));
                }
                written
            }
            Block::Rcc if offset == BDCR && !self.pwr.opens_backup_domain() => {
                Err(forbidden("BDCR", "5.4.1: written while DBP is clear"))
            }
            Block::Rcc => {
                let written = self.rcc.write(offset, value, now);
                self.follow_resets(common);
                self.follow_clocks(common);
                self.settle(Slot::Rcc, common);
                written
            }
            Block::Pwr if self.rcc.pll_is_on() && self.pwr.changes_scale(offset, value) => {
                Err(forbidden("CR", "5.1.3: VOS written while the PLL is on"))
            }
            Block::Pwr => {
                let written = self.pwr.write(offset, value, now);
                self.follow_clocks(common);
                written
            }
            Block::Flash => {
                let written = self.flash.write(offset, value, now);
                self.settle(Slot::Flash, common);
                self.follow_clocks(common);
                written
            }
            Block::Iwdg => {
                let written = self.iwdg.write(offset, value, now);
                if self.iwdg.runs() {
                    self.rcc.keep_lsi_on(now);
                    self.settle(Slot::Rcc, common);
                }
                self.settle(Slot::Iwdg, common);
                written
            }
            Block::Syscfg => self.syscfg.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
        }
    }

    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused> {
        self.flash.store(offset, width, value, now)
    }

    fn flash_timing(&self) -> FlashTiming {
        self.flash.timing()
    }

    #[inline]
    fn is_flash_busy(&self) -> bool {
        self.flash.is_busy()
    }

    fn take_cut(&mut self, now: Nanos) -> bool {
        self.flash.take_cut(now)
    }

    fn follow_clocks(&mut self, common: &mut Common) {
        let clocks = self.rcc.clocks(common.now);
        common.set_core_clock(clocks.ahb);
        common.check("RCC", self.rcc.fault(common.now));
        common.check("PWR", self.pwr.fault(clocks.ahb));
        common.check("FLASH", self.flash.fault(clocks.ahb));
        if clocks != self.clocks {
            self.clocks = clocks;
            self.tim5.set_clock(clocks.apb1_timers, common.now);
            self.tim11.set_clock(clocks.apb2_timers);
            self.usart2.set_clock(clocks.apb1, common.now);
            self.can.set_clock(clocks.apb1, common.now);
            self.otg.set_clock(clocks.usb, common.now);
            self.settle_all(common);
        }
    }

    #[inline]
    fn settle(&mut self, slot: Slot, common: &mut Common) {
        let due = match slot {
            Slot::Rcc => self.rcc.due(),
            Slot::Flash => {
                common.lines.set(interrupt::FLASH, self.flash.interrupts());
                self.flash.due()
            }
            Slot::Iwdg => self.iwdg.due(),
            Slot::Tim => {
                common.lines.set(interrupt::TIM5, self.tim5.interrupts());
                self.tim5.due()
            }
            Slot::Usart => {
                common.lines.set(interrupt::USART2, self.usart2.interrupts());
                self.follow_requests(common);
                common.set_due(Slot::Dma, self.dma.due());
                self.usart2.due()
            }
            Slot::Dma => {
                for stream in 0..ALL_STREAMS {
                    common.lines.set(interrupt::DMA[stream], self.dma.interrupts(stream));
                }
                self.follow_requests(common);
                self.dma.due()
            }
            Slot::Usb => {
                common.lines.set(interrupt::OTG_FS, self.otg.interrupts());
                self.otg.due()
            }
            Slot::Can => {
                for (line, high) in interrupt::CAN1.into_iter().zip(self.can.interrupts()) {
                    common.lines.set(line, high);
                }
                self.can.due()
            }
        };
        common.set_due(slot, due);
    }

    fn advance(&mut self, slot: Slot, common: &mut Common, memory: &mut Memory) {
        let now = common.now;
        match slot {
            Slot::Rcc => {
                self.rcc.advance(now);
                self.follow_clocks(common);
            }
            Slot::Flash => self.flash.finish(now, memory),
            Slot::Iwdg => {
                self.iwdg.advance(now);
                if self.iwdg.take_expired() {
                    common.reset = Some(Cause::Watchdog);
                }
            }
            Slot::Tim => self.tim5.advance(now),
            Slot::Usart => self.usart2.advance(now),
            Slot::Dma => self.step_dma(common, memory),
            Slot::Usb => self.otg.advance(now),
            Slot::Can => self.can.advance(now),
        }
    }

    fn look(&mut self, common: &mut Common) {
        self.usart2.look(common.now);
        self.otg.settle(common.now);
        self.can.settle(common.now);
        self.rcc.look(common.now);
        self.pwr.set_supply(self.flash.millivolts());
    }

    fn take_news(&mut self) -> News {
        let can = self.can.take_progress();
        News {
            any: self.otg.take_progress() || can,
            heard: can && self.can.has_unread(),
            cut: false,
        }
    }

    fn reset(&mut self, common: &mut Common, memory: &mut Memory) {
        self.flash.restart(memory);
        self.pwr.reset();
        self.iwdg = Iwdg::new(false);
        self.tim5.reset(common.now);
        self.tim11.reset();
        self.gpio.iter_mut().for_each(Gpio::reset);
        self.follow_pin(common);
        self.syscfg.reset();
        self.usart2.reset(common.now);
        self.dma.reset(0);
        self.dma.reset(1);
        self.otg.reset(common.now);
        self.can.reset(common.now);
    }

    fn reset_clocks(&mut self, cause: Cause) {
        self.rcc.reset(cause);
        if cause == Cause::Power {
            self.dbgmcu.reset();
        }
    }
}
