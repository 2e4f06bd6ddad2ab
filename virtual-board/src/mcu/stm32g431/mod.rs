//! The STM32G431xB (RM0440). Sections are those of RM0440, revision 8; DS12589 is the data sheet.
//!
//! [`map`] has the addresses. This file names the peripherals, their interrupts and their clocks. The flow of accesses, events and
//! resets is that of both chips, in [`mcu`](super::common::mcu).

mod crs;
mod dma;
mod fdcan;
mod flash;
mod map;
mod pwr;
mod rcc;
mod usart;
mod usb;

use self::crs::Crs;
use self::dma::{ALL_CHANNELS, CHANNELS, Dma};
use self::fdcan::Fdcan;
pub use self::flash::EccRegister;
use self::flash::Interface;
use self::map::{Kind, interrupt};
use self::pwr::Pwr;
use self::rcc::{Clocks, Rcc};
use self::usart::Usart;
use self::usb::Usb;
use super::common;
use super::common::capture::{Capture, Selector};
use super::common::dbgmcu::Dbgmcu;
use super::common::gpio::{AtReset, Gpio};
use super::common::iwdg::Iwdg;
use super::common::mcu::{Block, Common, Map, Peripherals, Slot};
use super::common::rcc::Gates;
use super::common::shifter::Uart;
use super::common::syscfg::Syscfg;
use super::common::tim::Tim;
use crate::core::Width;
use crate::engine::News;
use crate::line::Pin;
use crate::shared::lock;
use crate::soc::lines::Lines;
use crate::soc::machine::{Cause, Edges};
use crate::soc::peripheral::{NoModel, Peripheral};
use crate::time::Nanos;

/// Registers of GPIO ports after a reset (9.4.1, 9.4.3, 9.4.4). PA13 to PA15, PB3 and PB4 are the debugger's.
const fn gpio_at_reset(port: usize) -> AtReset {
    match port {
        0 => AtReset::new(0xABFF_FFFF, 0x0C00_0000, 0x6400_0000),
        1 => AtReset::new(0xFFFF_FEBF, 0x0000_00C0, 0x0000_0100),
        _ => AtReset::new(0xFFFF_FFFF, 0, 0),
    }
}

/// The input of TIM16: TI1SEL of TISEL, and HSE32EN of OR1, the crystal's clock divided by 32 (31.8).
const TIM16_INPUT: &[Selector] = &[
    Selector {
        offset: 0x5C,
        field: 0b1111,
        value: 0b0011,
    },
    Selector {
        offset: 0x68,
        field: 1,
        value: 1,
    },
];

/// The peripherals.
#[derive(Debug)]
pub(crate) struct Stm32g431 {
    clocks: Clocks,
    rcc: Rcc,
    pwr: Pwr,
    flash: Interface,
    iwdg: Iwdg,
    tim2: Tim,
    tim16: Capture,
    gpio: [Gpio; 7],
    syscfg: Syscfg,
    dbgmcu: Dbgmcu,
    crs: Crs,
    usart2: Usart,
    dma: Dma,
    exti: NoModel,
    usb: Usb,
    fdcan: Fdcan,
}

impl Stm32g431 {
    /// The peripherals before the first reset, of a chip whose ECCR is like this after an interrupted flash operation.
    pub(crate) fn new(ecc_register: EccRegister, seed: u64, edges: &Edges) -> Self {
        Self {
            clocks: Clocks::default(),
            rcc: Rcc::new(edges.oscillator.clone(), seed),
            pwr: Pwr::default(),
            flash: Interface::new(edges.flash.clone(), ecc_register, seed),
            iwdg: Iwdg::new(true, lock(&edges.oscillator).lsi_hz),
            tim2: Tim::new(),
            tim16: Capture::new(edges.oscillator.clone(), TIM16_INPUT),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), true)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::new(&map::DBGMCU, map::IDENTITY),
            crs: Crs::default(),
            usart2: Usart::new(edges.line.clone()),
            dma: Dma::new(seed),
            exti: NoModel,
            usb: Usb::new(edges.host.clone()),
            fdcan: Fdcan::new(edges.can.clone()),
        }
    }
}

fn dma_interrupt(channel: usize) -> u16 {
    match channel {
        0..CHANNELS => interrupt::DMA1_CHANNEL1 + channel as u16,
        11 => interrupt::DMA2_CHANNEL6,
        _ => interrupt::DMA2_CHANNEL1 + (channel - CHANNELS) as u16,
    }
}

impl Peripherals for Stm32g431 {
    type Kind = Kind;
    type Flash = Interface;

    const MAP: Map = map::MAP;

    const EVENTS: [Kind; 8] = [
        Kind::Rcc,
        Kind::Flash,
        Kind::Iwdg,
        Kind::Tim2,
        Kind::Usart2,
        Kind::Dma,
        Kind::Usb,
        Kind::Fdcan1,
    ];

    const POWER: Kind = Kind::Pwr;

    #[inline]
    fn blocks(&self) -> &'static [Block<Kind>] {
        map::BLOCKS
    }

    #[inline]
    fn peripheral(&mut self, kind: Kind) -> &mut dyn Peripheral {
        match kind {
            Kind::Usart2 => &mut self.usart2,
            Kind::Usb => &mut self.usb,
            Kind::Tim2 => &mut self.tim2,
            Kind::Fdcan1 => &mut self.fdcan,
            Kind::Tim16 => &mut self.tim16,
            Kind::Dma => &mut self.dma,
            Kind::Gpio(port) => &mut self.gpio[usize::from(port)],
            Kind::Rcc => &mut self.rcc,
            Kind::Pwr => &mut self.pwr,
            Kind::Flash => &mut self.flash,
            Kind::Iwdg => &mut self.iwdg,
            Kind::Crs => &mut self.crs,
            Kind::Syscfg => &mut self.syscfg,
            Kind::Dbgmcu => &mut self.dbgmcu,
            Kind::Exti => &mut self.exti,
        }
    }

    #[inline]
    fn takes(block: &Block<Kind>, width: Width) -> bool {
        match block.kind {
            // 45.5.3: 16 bits in the packet memory.
            Kind::Usb if block.offset != 0 => width == Width::Half,
            // 30.5, 31.8: half-words or words.
            Kind::Tim2 | Kind::Tim16 => width != Width::Byte,
            _ => width == Width::Word,
        }
    }

    #[inline]
    fn gates(&self) -> &Gates {
        self.rcc.gates()
    }

    fn gates_mut(&mut self) -> &mut Gates {
        self.rcc.gates_mut()
    }

    #[inline]
    fn flash(&self) -> &Interface {
        &self.flash
    }

    #[inline]
    fn flash_mut(&mut self) -> &mut Interface {
        &mut self.flash
    }

    fn uart(&self) -> &dyn Uart {
        &self.usart2
    }

    fn uart_address(&self) -> u32 {
        map::USART2
    }

    fn uart_pin(&self) -> Pin {
        // PA2.
        self.gpio[0].driver(2)
    }

    fn dma_and_uart(&mut self) -> (&mut dyn common::dma::Dma, &mut dyn Uart) {
        (&mut self.dma, &mut self.usart2)
    }

    fn iwdg(&mut self) -> &mut Iwdg {
        &mut self.iwdg
    }

    fn keep_lsi_on(&mut self, now: Nanos) {
        self.rcc.keep_lsi_on(now);
    }

    fn follow_clocks(&mut self, common: &mut Common) -> bool {
        let clocks = self.rcc.clocks(common.now);
        common.set_core_clock(clocks.ahb);
        common.check("RCC", self.rcc.fault(common.now));
        let fault = self.pwr.supply().fault(clocks.ahb, self.flash.wait_states());
        if let Some((instance, fault)) = fault {
            common.check(instance, Some(fault));
        }
        if clocks == self.clocks {
            return false;
        }
        self.clocks = clocks;
        self.tim2.set_clock(clocks.apb1_timers, common.now);
        self.tim16.set_clock(clocks.apb2_timers);
        self.usart2.set_clock(clocks.usart2, common.now);
        self.usb.set_clock(clocks.usb, common.now);
        self.fdcan.set_clock(clocks.fdcan, common.now);
        true
    }

    fn set_lines(&mut self, slot: Slot, lines: &mut Lines) {
        match slot {
            Slot::Rcc | Slot::Flash | Slot::Iwdg => {}
            Slot::Tim => lines.set(interrupt::TIM2, self.tim2.interrupts()),
            Slot::Usart => lines.set(interrupt::USART2, self.usart2.interrupts()),
            Slot::Dma => {
                for channel in 0..ALL_CHANNELS {
                    lines.set(dma_interrupt(channel), self.dma.interrupts(channel));
                }
            }
            Slot::Usb => {
                lines.set(interrupt::USB_LP, self.usb.interrupts());
                if self.usb.take_start_of_frame() {
                    self.crs.start_of_frame();
                }
            }
            Slot::Can => {
                let [line_0, line_1] = self.fdcan.interrupts();
                lines.set(interrupt::FDCAN1_IT0, line_0);
                lines.set(interrupt::FDCAN1_IT1, line_1);
            }
        }
    }

    fn sync(&mut self, now: Nanos) {
        self.usart2.sync(now);
        self.usb.settle(now);
        self.fdcan.settle(now);
        self.rcc.sync(now);
    }

    fn take_news(&mut self) -> News {
        let can = self.fdcan.take_progress();
        News {
            any: self.usb.take_progress() || can,
            can_received: can && self.fdcan.has_unread(),
            cut: false,
        }
    }

    fn reset_block(&mut self, block: &Block<Kind>, now: Nanos) {
        match block.kind {
            Kind::Dma => self.dma.reset_block(block.offset),
            kind => self.peripheral(kind).reset(now),
        }
    }

    fn reset_clocks(&mut self, cause: Cause) {
        self.rcc.reset(cause);
    }
}

#[cfg(test)]
mod tests;
