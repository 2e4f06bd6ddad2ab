//! The STM32G431xB (RM0440). Sections are those of RM0440, revision 8; DS12589 is the data sheet.
//!
//! [`map`] has the addresses. This file connects the peripherals: interrupts, DMA transfers and clocks. The flow of
//! accesses, events and resets is common to both chips, in [`mcu`](super::common::mcu).

mod crs;
mod dma;
mod fdcan;
mod flash;
mod map;
mod pwr;
mod rcc;
mod usart;
mod usb;

use std::sync::atomic::Ordering;

use self::crs::Crs;
use self::dma::{ALL_CHANNELS, CHANNELS, Dma};
use self::fdcan::Fdcan;
use self::flash::Interface;
use self::map::{Block, interrupt};
use self::pwr::Pwr;
use self::rcc::{Clocks, Rcc};
use self::usart::Usart;
use self::usb::Usb;
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
use crate::shared::lock;
use crate::soc::machine::{Cause, Edges};
use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

/// The TX pin of USART2 on port A.
const TX_PIN: u32 = 2;

/// The violation for a TX pin that is low.
const LOW: &str = "9.3.2, 37.5.5: nothing drives PA2, or it is low, and the arm may take that for a start bit";

/// Requests of the DMAMUX (13.3.2, table 91).
const USART2_RX: u32 = 26;
const USART2_TX: u32 = 27;

/// Registers accessed by the DMA.
const USART2_RDR: u32 = 0x4000_4400 + usart::RDR;
const USART2_TDR: u32 = 0x4000_4400 + usart::TDR;

/// Reset values of GPIO registers (9.4.1, 9.4.3, 9.4.4). PA13 to PA15, PB3 and PB4 belong to the debugger.
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

/// The peripherals.
#[derive(Debug)]
pub(crate) struct Stm32g431 {
    clocks: Clocks,
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
}

impl Stm32g431 {
    /// The peripherals before the first reset.
    pub(crate) fn new(seed: u64, edges: &Edges) -> Self {
        Self {
            clocks: Clocks::default(),
            rcc: Rcc::new(edges.oscillator.clone(), seed),
            pwr: Pwr::default(),
            flash: Interface::new(edges.flash.clone()),
            iwdg: Iwdg::new(true),
            tim2: Tim::new(),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), true)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::new(&map::DBGMCU, map::IDENTITY),
            crs: Crs::default(),
            usart2: Usart::new(edges.line.clone()),
            dma: Dma::new(seed),
            usb: Usb::new(edges.host.clone()),
            fdcan: Fdcan::new(edges.can.clone()),
        }
    }

    fn settle_dma_interrupts(&self, common: &mut Common) {
        for channel in 0..ALL_CHANNELS {
            let line = match channel {
                0..CHANNELS => interrupt::DMA1_CHANNEL1 + channel as u16,
                11 => interrupt::DMA2_CHANNEL6,
                _ => interrupt::DMA2_CHANNEL1 + (channel - CHANNELS) as u16,
            };
            common.lines.set(line, self.dma.interrupts(channel));
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
        self.dma
            .follow_requests(|request| is_high(requests, request), common.now);
    }

    /// Executes a step of a DMA channel.
    fn step_dma(&mut self, common: &mut Common, memory: &mut Memory) {
        let now = common.now;
        let requests = self.requests(common);
        let Some((channel, step)) = self.dma.step(|request| is_high(requests, request), now) else {
            return;
        };
        let usart = &mut self.usart2;
        let done = step.run(memory, |address, value| match (address, value) {
            (USART2_RDR, None) => Some(usart.read(usart::RDR, now).map(|value| value as u8)),
            (USART2_TDR, Some(value)) => Some(usart.write(usart::TDR, value.into(), now).map(|()| value)),
            _ => None,
        });
        match done {
            Ok(Some(value)) => self.dma.fetched(channel, value, now),
            Ok(None) => {}
            Err(failure) => {
                self.dma.fail(channel);
                common.record_dma("USART2", failure);
            }
        }
        self.settle(Slot::Usart, common);
    }

    /// Executes the reset bits of RCC, as they are written.
    fn follow_resets(&mut self, common: &mut Common) {
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
                Block::Tim2 => self.tim2.reset(common.now),
                Block::Crs => self.crs = Crs::default(),
                Block::Usart2 => self.usart2.reset(common.now),
                Block::Usb => self.usb.reset(common.now),
                Block::Fdcan1 => self.fdcan.reset(common.now),
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
        self.settle_all(common);
    }

    /// Updates the driver of PA2. A floating or low pin is a violation of the register that caused it.
    fn follow_pin(&mut self, common: &mut Common, instance: &'static str, register: &'static str) {
        let mut line = lock(&common.edges.line);
        let was_low = line.is_pin_low();
        line.set_pin(self.gpio[0].driver(TX_PIN));
        line.set_transmits(self.usart2.transmits());
        if line.is_pin_low() && !was_low {
            common.recorder.forbidden(instance, register, LOW);
        }
    }
}

/// Returns true if a request is high.
fn is_high(requests: Requests, request: u32) -> bool {
    match request {
        USART2_RX => requests.receive,
        USART2_TX => requests.transmit,
        _ => false,
    }
}

impl Peripherals for Stm32g431 {
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

    fn read(&mut self, block: Block, offset: u32, common: &mut Common) -> Result<u32, Refused> {
        let now = common.now;
        match block {
            Block::Tim2 => {
                let value = self.tim2.read(offset, now);
                self.settle(Slot::Tim, common);
                value
            }
            Block::Usart2 => {
                let value = self.usart2.read(offset, now);
                self.settle(Slot::Usart, common);
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

    fn write(&mut self, block: Block, offset: u32, value: u32, common: &mut Common) -> Result<(), Refused> {
        let now = common.now;
        match block {
            Block::Tim2 => {
                let written = self.tim2.write(offset, value, now);
                self.settle(Slot::Tim, common);
                written
            }
            Block::Usart2 => {
                let written = self.usart2.write(offset, value, now);
                self.settle(Slot::Usart, common);
                self.follow_pin(common, "USART2", "CR1");
                written
            }
            Block::Usb => {
                let written = self.usb.write(offset, value, now);
                self.settle(Slot::Usb, common);
                written
            }
            Block::PacketMemory => {
                self.usb.write_packet_memory(offset, value);
                Ok(())
            }
            Block::Dma1 | Block::Dma2 => {
                let written = self.dma.write(usize::from(block == Block::Dma2), offset, value);
                self.settle(Slot::Dma, common);
                written
            }
            Block::Dmamux1 => {
                let written = self.dma.write_multiplexer(offset, value);
                self.settle(Slot::Dma, common);
                written
            }
            Block::Gpio(port) => {
                let written = self.gpio[usize::from(port)].write(offset, value, now);
                self.follow_pin(common, "GPIOA", "MODER");
                written
            }
            Block::Rcc => {
                let written = self.rcc.write(offset, value, now);
                self.follow_resets(common);
                self.follow_clocks(common);
                written
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
            Block::Crs => self.crs.write(offset, value, now),
            Block::Syscfg => self.syscfg.write(offset, value, now),
            Block::Dbgmcu => self.dbgmcu.write(offset, value, now),
            Block::Exti => Err(Refused::Unimplemented("all registers")),
            Block::Fdcan1 => {
                let written = self.fdcan.write(offset, value, now);
                self.settle(Slot::Can, common);
                written
            }
            Block::MessageRam => self.fdcan.write_ram(offset, value),
        }
    }

    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused> {
        self.flash.store(offset, width, value, now)
    }

    fn check_flash_read(&mut self, offset: u32) -> bool {
        self.flash.check_read(offset)
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
        let fault = self.pwr.supply().fault(clocks.ahb, self.flash.wait_states());
        if let Some((instance, fault)) = fault {
            common.check(instance, Some(fault));
        }
        if clocks != self.clocks {
            self.clocks = clocks;
            self.tim2.set_clock(clocks.apb1_timers, common.now);
            self.usart2.set_clock(clocks.usart2, common.now);
            self.usb.set_clock(clocks.usb, common.now);
            self.fdcan.set_clock(clocks.fdcan, common.now);
            self.settle_all(common);
        }
    }

    fn settle(&mut self, slot: Slot, common: &mut Common) {
        let due = match slot {
            Slot::Rcc => self.rcc.due(),
            Slot::Flash => self.flash.due(),
            Slot::Iwdg => self.iwdg.due(),
            Slot::Tim => {
                common.lines.set(interrupt::TIM2, self.tim2.interrupts());
                self.tim2.due()
            }
            Slot::Usart => {
                common.lines.set(interrupt::USART2, self.usart2.interrupts());
                self.follow_requests(common);
                common.set_due(Slot::Dma, self.dma.due());
                self.usart2.due()
            }
            Slot::Dma => {
                self.settle_dma_interrupts(common);
                self.follow_requests(common);
                self.dma.due()
            }
            Slot::Usb => {
                common.lines.set(interrupt::USB_LP, self.usb.interrupts());
                if self.usb.take_start_of_frame() {
                    self.crs.start_of_frame();
                }
                self.usb.due()
            }
            Slot::Can => {
                let [line_0, line_1] = self.fdcan.interrupts();
                common.lines.set(interrupt::FDCAN1_IT0, line_0);
                common.lines.set(interrupt::FDCAN1_IT1, line_1);
                self.fdcan.due()
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
            Slot::Tim => self.tim2.advance(now),
            Slot::Usart => self.usart2.advance(now),
            Slot::Dma => self.step_dma(common, memory),
            Slot::Usb => self.usb.advance(now),
            Slot::Can => self.fdcan.advance(now),
        }
    }

    fn look(&mut self, common: &mut Common) {
        self.usart2.look(common.now);
        self.usb.settle(common.now);
        self.fdcan.settle(common.now);
        self.rcc.look(common.now);
    }

    fn take_news(&mut self) -> News {
        let can = self.fdcan.take_progress();
        News {
            any: self.usb.take_progress() || can,
            heard: can && self.fdcan.has_unread(),
            cut: false,
        }
    }

    fn reset(&mut self, common: &mut Common, memory: &mut Memory) {
        self.flash.restart(memory);
        self.pwr = Pwr::default();
        self.iwdg = Iwdg::new(true);
        self.tim2.reset(common.now);
        self.gpio.iter_mut().for_each(Gpio::reset);
        self.syscfg.reset();
        self.crs = Crs::default();
        self.usart2.reset(common.now);
        self.follow_pin(common, "GPIOA", "MODER");
        self.dma.reset(0);
        self.dma.reset(1);
        self.dma.reset_multiplexer();
        self.usb.reset(common.now);
        self.fdcan.reset(common.now);
    }

    fn reset_clocks(&mut self, cause: Cause) {
        self.rcc.reset(cause);
    }
}

#[cfg(test)]
mod tests;
