//! The memory map of the STM32G431xB (RM0440, 2.2.2), its interrupts (table 97) and its system memory.

use super::flash::SIZE;
use super::rcc::gates;
use super::{fdcan, usart};
use crate::core::Width;
use crate::mcu::common::dbgmcu;
use crate::mcu::common::mcu::{self, Map, Slot};
use crate::mcu::common::rcc::Gate;
use crate::mcu::common::syscfg::Layout;
use crate::mcu::common::system_memory::SystemMemory;

/// The memories, the interrupts (14.1), and the system memory (2.6, 48.1 and 48.2).
pub(super) const MAP: Map = Map {
    flash: 0x0800_0000,
    flash_size: SIZE,
    ram: 0x2000_0000,
    // SRAM1 and SRAM2, followed by the alias of the CCM SRAM (2.4), as one range.
    ram_size: 32 << 10,
    interrupts: 102,
    uart_receive: usart::RDR,
    uart_transmit: usart::TDR,
    system_memory: SystemMemory {
        unique_id: 0x1FFF_7590,
        flash_size: 0x1FFF_75E0,
        flash_kib: 128,
    },
};

/// Interrupt numbers (table 97).
pub(super) mod interrupt {
    pub(in super::super) const DMA1_CHANNEL1: u16 = 11;
    pub(in super::super) const USB_LP: u16 = 20;
    pub(in super::super) const FDCAN1_IT0: u16 = 21;
    pub(in super::super) const FDCAN1_IT1: u16 = 22;
    pub(in super::super) const TIM2: u16 = 28;
    pub(in super::super) const USART2: u16 = 38;
    pub(in super::super) const DMA2_CHANNEL1: u16 = 56;
    pub(in super::super) const DMA2_CHANNEL6: u16 = 97;
}

/// A block of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Block {
    Tim2,
    Crs,
    Iwdg,
    Usart2,
    Usb,
    PacketMemory,
    Fdcan1,
    MessageRam,
    Pwr,
    Syscfg,
    Exti,
    Dma1,
    Dma2,
    Dmamux1,
    Rcc,
    Flash,
    /// GPIOA to GPIOG, by number from 0.
    Gpio(u8),
    Dbgmcu,
}

impl mcu::Block for Block {
    #[inline]
    fn at(address: u32) -> Option<(Self, u32)> {
        let block = match address & !0x3FF {
            0x4000_0000 => Self::Tim2,
            0x4000_2000 => Self::Crs,
            0x4000_3000 => Self::Iwdg,
            0x4000_4400 => Self::Usart2,
            0x4000_5C00 => Self::Usb,
            0x4000_6000 => Self::PacketMemory,
            0x4000_6400 => Self::Fdcan1,
            0x4000_7000 => Self::Pwr,
            0x4000_A400 => Self::MessageRam,
            0x4001_0000 => Self::Syscfg,
            0x4001_0400 => Self::Exti,
            0x4002_0000 => Self::Dma1,
            0x4002_0400 => Self::Dma2,
            0x4002_0800 => Self::Dmamux1,
            0x4002_1000 => Self::Rcc,
            0x4002_2000 => Self::Flash,
            0x4800_0000..=0x4800_1800 => Self::Gpio((address >> 10) as u8 & 0b111),
            0xE004_2000 => Self::Dbgmcu,
            _ => return None,
        };
        let offset = match block {
            Self::PacketMemory => address - 0x4000_5C00,
            Self::MessageRam => fdcan::RAM + (address & 0x3FF),
            Self::Dma1 | Self::Dma2 | Self::Dmamux1 => address & 0xFFF,
            _ => address & 0x3FF,
        };
        Some((block, offset))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Tim2 => "TIM2",
            Self::Crs => "CRS",
            Self::Iwdg => "IWDG",
            Self::Usart2 => "USART2",
            Self::Usb => "USB",
            Self::PacketMemory => "USB packet memory",
            Self::Fdcan1 => "FDCAN1",
            Self::MessageRam => "FDCAN1 message RAM",
            Self::Pwr => "PWR",
            Self::Syscfg => "SYSCFG",
            Self::Exti => "EXTI",
            Self::Dma1 => "DMA1",
            Self::Dma2 => "DMA2",
            Self::Dmamux1 => "DMAMUX1",
            Self::Rcc => "RCC",
            Self::Flash => "FLASH",
            Self::Gpio(0) => "GPIOA",
            Self::Gpio(1) => "GPIOB",
            Self::Gpio(2) => "GPIOC",
            Self::Gpio(3) => "GPIOD",
            Self::Gpio(4) => "GPIOE",
            Self::Gpio(5) => "GPIOF",
            Self::Gpio(_) => "GPIOG",
            Self::Dbgmcu => "DBGMCU",
        }
    }

    #[inline]
    fn gate(self) -> Option<Gate> {
        Some(match self {
            Self::Tim2 => gates::TIM2,
            Self::Crs => gates::CRS,
            Self::Usart2 => gates::USART2,
            Self::Usb | Self::PacketMemory => gates::USB,
            Self::Fdcan1 | Self::MessageRam => gates::FDCAN,
            Self::Pwr => gates::PWR,
            Self::Syscfg | Self::Exti => gates::SYSCFG,
            Self::Dma1 => gates::DMA1,
            Self::Dma2 => gates::DMA2,
            Self::Dmamux1 => gates::DMAMUX1,
            Self::Flash => gates::FLASH,
            Self::Gpio(port) => gates::gpio(port as u32),
            Self::Iwdg | Self::Rcc | Self::Dbgmcu => return None,
        })
    }

    #[inline]
    fn takes(self, width: Width) -> bool {
        match self {
            // 45.5.3: 16 bits.
            Self::PacketMemory => width == Width::Half,
            // 30.5: half-words or words.
            Self::Tim2 => width != Width::Byte,
            _ => width == Width::Word,
        }
    }

    #[inline]
    fn slot(self) -> Option<Slot> {
        Some(match self {
            Self::Rcc => Slot::Rcc,
            Self::Flash => Slot::Flash,
            Self::Iwdg => Slot::Iwdg,
            Self::Tim2 => Slot::Tim,
            Self::Usart2 => Slot::Usart,
            Self::Dma1 | Self::Dma2 | Self::Dmamux1 => Slot::Dma,
            Self::Usb => Slot::Usb,
            Self::Fdcan1 => Slot::Can,
            _ => return None,
        })
    }
}

/// The system configuration controller (10.2.1).
pub(super) const SYSCFG: Layout = Layout {
    mem_mode: 0b111,
    last: 0x24,
    others: "CFGR1 to SKR",
};

/// DBGMCU_IDCODE of the chip: category 2, revision Z (47.6.1).
pub(super) const IDENTITY: u32 = 0x2001_6468;

/// The MCU debug component (47.6).
pub(super) const DBGMCU: dbgmcu::Layout = dbgmcu::Layout {
    last: 0x10,
    names: "APBxFZR",
};
