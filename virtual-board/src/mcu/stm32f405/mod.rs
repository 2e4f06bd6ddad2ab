//! The STM32F405RG (RM0090). Sections are those of RM0090, revision 19; DS8626 is the data sheet.
//!
//! [`map`] has the addresses. This file names the peripherals, their interrupts and their clocks. The flow of accesses, events and
//! resets is that of both chips, in [`mcu`](super::common::mcu).

mod arm_uart;
mod bxcan;
mod dma;
mod flash;
mod map;
mod otg;
mod pwr;
mod rcc;
#[cfg(test)]
mod tests;
mod usart;

pub use self::arm_uart::ArmUart;
use self::bxcan::Can;
use self::dma::Dma;
pub use self::dma::Reenabled;
use self::flash::Interface;
pub(crate) use self::map::IDENTITY;
use self::map::{Kind, interrupt};
use self::otg::Otg;
pub use self::otg::OtgVariant;
use self::pwr::Pwr;
use self::rcc::{BDCR, Clocks, Rcc};
use self::usart::Usart;
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
use crate::soc::peripheral::{NoModel, Peripheral, Refused, forbidden};
use crate::time::Nanos;

/// Ports: GPIOA to GPIOI.
const PORTS: usize = 9;

/// Reset values of GPIO registers (8.4.1, 8.4.3, 8.4.4). PA13 to PA15, PB3 and PB4 belong to the debugger.
const fn gpio_at_reset(port: usize) -> AtReset {
    match port {
        0 => AtReset::new(0xA800_0000, 0, 0x6400_0000),
        1 => AtReset::new(0x0000_0280, 0x0000_00C0, 0x0000_0100),
        _ => AtReset::new(0, 0, 0),
    }
}

/// The input of TIM11: TI1_RMP of OR, the crystal's clock divided by RTCPRE (19.5.11).
const TIM11_INPUT: &[Selector] = &[Selector {
    offset: 0x50,
    field: 0b11,
    value: 0b10,
}];

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
    arm_uart: ArmUart,
    uart: Usart,
    dma: Dma,
    exti: NoModel,
    otg: Otg,
    can: Can,
}

impl Stm32f405 {
    /// The peripherals before the first reset, of a chip of this revision (DBGMCU_IDCODE), with the arm at this UART.
    pub(crate) fn new(
        idcode: u32,
        arm_uart: ArmUart,
        reenabled: Reenabled,
        otg: OtgVariant,
        seed: u64,
        edges: &Edges,
    ) -> Self {
        lock(&edges.line).set_pin(Pin::Free);
        let lsi_hz = lock(&edges.oscillator).lsi_hz;
        let (otg_clock, millivolts) = {
            let flash = lock(&edges.flash);
            (flash.clock, flash.millivolts)
        };
        Self {
            clocks: Clocks::default(),
            rcc: Rcc::new(edges.oscillator.clone(), seed),
            pwr: Pwr::new(millivolts, seed),
            flash: Interface::new(edges.flash.clone()),
            iwdg: Iwdg::new(false, lsi_hz),
            tim5: Tim::new(),
            tim11: Capture::new(edges.oscillator.clone(), TIM11_INPUT),
            gpio: std::array::from_fn(|port| Gpio::new(gpio_at_reset(port), false)),
            syscfg: Syscfg::new(&map::SYSCFG),
            dbgmcu: Dbgmcu::new(&map::DBGMCU, idcode),
            arm_uart,
            uart: Usart::new(edges.line.clone()),
            dma: Dma::new(reenabled, seed, arm_uart.requests()),
            exti: NoModel,
            otg: Otg::new(edges.host.clone(), otg_clock, otg),
            can: Can::new(edges.can.clone()),
        }
    }
}

impl Peripherals for Stm32f405 {
    type Kind = Kind;
    type Flash = Interface;

    const MAP: Map = map::MAP;

    const EVENTS: [Kind; 8] = [
        Kind::Rcc,
        Kind::Flash,
        Kind::Iwdg,
        Kind::Tim5,
        Kind::Uart,
        Kind::Dma,
        Kind::OtgFs,
        Kind::Can1,
    ];

    const POWER: Kind = Kind::Pwr;

    #[inline]
    fn blocks(&self) -> &'static [Block<Kind>] {
        self.arm_uart.blocks()
    }

    #[inline]
    fn peripheral(&mut self, kind: Kind) -> &mut dyn Peripheral {
        match kind {
            Kind::Uart => &mut self.uart,
            Kind::OtgFs => &mut self.otg,
            Kind::Tim5 => &mut self.tim5,
            Kind::Can1 => &mut self.can,
            Kind::Dma => &mut self.dma,
            Kind::Tim11 => &mut self.tim11,
            Kind::Gpio(port) => &mut self.gpio[usize::from(port)],
            Kind::Rcc => &mut self.rcc,
            Kind::Pwr => &mut self.pwr,
            Kind::Flash => &mut self.flash,
            Kind::Iwdg => &mut self.iwdg,
            Kind::Syscfg => &mut self.syscfg,
            Kind::Dbgmcu => &mut self.dbgmcu,
            Kind::Exti => &mut self.exti,
        }
    }

    #[inline]
    fn takes(block: &Block<Kind>, width: Width) -> bool {
        match block.kind {
            // 18.4, 19.5: half-words or words.
            Kind::Tim5 | Kind::Tim11 => width != Width::Byte,
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
        &self.uart
    }

    fn uart_address(&self) -> u32 {
        self.arm_uart.address()
    }

    fn uart_pin(&self) -> Pin {
        let (port, pin) = self.arm_uart.tx_pin();
        self.gpio[port].driver(pin)
    }

    fn dma_and_uart(&mut self) -> (&mut dyn common::dma::Dma, &mut dyn Uart) {
        (&mut self.dma, &mut self.uart)
    }

    fn iwdg(&mut self) -> &mut Iwdg {
        &mut self.iwdg
    }

    fn keep_lsi_on(&mut self, now: Nanos) {
        self.rcc.keep_lsi_on(now);
    }

    fn check_write(&self, kind: Kind, offset: u32, value: u32) -> Result<(), Refused> {
        match kind {
            Kind::Rcc if offset == BDCR && !self.pwr.opens_backup_domain() => {
                Err(forbidden("BDCR", "5.4.1: written while DBP is clear"))
            }
            Kind::Pwr if self.rcc.pll_is_on() && self.pwr.changes_scale(offset, value) => {
                Err(forbidden("CR", "5.1.3: VOS written while the PLL is on"))
            }
            _ => Ok(()),
        }
    }

    fn follow_clocks(&mut self, common: &mut Common) -> bool {
        let clocks = self.rcc.clocks(common.now);
        common.set_core_clock(clocks.ahb);
        common.check("RCC", self.rcc.fault(common.now));
        common.check("PWR", self.pwr.fault(clocks.ahb));
        common.check("FLASH", self.flash.fault(clocks.ahb));
        if clocks == self.clocks {
            return false;
        }
        self.clocks = clocks;
        self.tim5.set_clock(clocks.apb1_timers, common.now);
        self.tim11.set_clock(clocks.apb2_timers);
        self.uart.set_clock(clocks.apb1, common.now);
        self.can.set_clock(clocks.apb1, common.now);
        self.otg.set_clock(clocks.usb, common.now);
        true
    }

    #[inline]
    fn set_lines(&mut self, slot: Slot, lines: &mut Lines) {
        match slot {
            Slot::Rcc | Slot::Iwdg => {}
            Slot::Flash => lines.set(interrupt::FLASH, self.flash.interrupts()),
            Slot::Tim => lines.set(interrupt::TIM5, self.tim5.interrupts()),
            Slot::Usart => lines.set(self.arm_uart.interrupt(), self.uart.interrupts()),
            Slot::Dma => {
                for (stream, line) in interrupt::DMA.into_iter().enumerate() {
                    lines.set(line, self.dma.interrupts(stream));
                }
            }
            Slot::Usb => lines.set(interrupt::OTG_FS, self.otg.interrupts()),
            Slot::Can => {
                for (line, high) in interrupt::CAN1.into_iter().zip(self.can.interrupts()) {
                    lines.set(line, high);
                }
            }
        }
    }

    fn sync(&mut self, now: Nanos) {
        self.uart.sync(now);
        self.otg.settle(now);
        self.can.settle(now);
        self.rcc.sync(now);
        self.pwr.set_supply(self.flash.millivolts());
    }

    fn take_news(&mut self) -> News {
        let can = self.can.take_progress();
        News {
            any: self.otg.take_progress() || can,
            can_received: can && self.can.has_unread(),
            cut: false,
        }
    }

    fn reset_block(&mut self, block: &Block<Kind>, now: Nanos) {
        match block.kind {
            Kind::Dma => self.dma.reset_controller(usize::from(block.offset != 0)),
            kind => self.peripheral(kind).reset(now),
        }
    }

    fn reset_clocks(&mut self, cause: Cause) {
        self.rcc.reset(cause);
        if cause == Cause::Power {
            self.dbgmcu.reset();
        }
    }
}
