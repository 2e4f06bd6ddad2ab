//! The memory map of the STM32F405RG (RM0090, 2.3), its interrupts (table 62) and its system memory.

use super::rcc::gates;
use super::usart;
use crate::core::Width;
use crate::flash::SIZE;
use crate::mcu::common::dbgmcu;
use crate::mcu::common::mcu::{self, Map, Slot};
use crate::mcu::common::rcc::Gate;
use crate::mcu::common::syscfg::Layout;
use crate::mcu::common::system_memory::SystemMemory;

/// The memories, the interrupts (12.1), and the system memory (2.4, 39.1 and 39.2). The core-coupled memory, which the
/// firmware does not use, and the backup SRAM have no model.
pub(super) const MAP: Map = Map {
    flash: 0x0800_0000,
    flash_size: SIZE,
    ram: 0x2000_0000,
    ram_size: 128 << 10,
    interrupts: 82,
    uart_receive: usart::DR,
    uart_transmit: usart::DR,
    system_memory: SystemMemory {
        unique_id: 0x1FFF_7A10,
        flash_size: 0x1FFF_7A22,
        flash_kib: 1024,
    },
};

/// Interrupt numbers (table 62).
pub(super) mod interrupt {
    pub(in super::super) const FLASH: u16 = 4;
    /// TX, RX0, RX1 and SCE.
    pub(in super::super) const CAN1: [u16; 4] = [19, 20, 21, 22];
    pub(in super::super) const USART2: u16 = 38;
    pub(in super::super) const TIM5: u16 = 50;
    pub(in super::super) const OTG_FS: u16 = 67;
    /// Streams 0 to 7 of DMA1, then of DMA2.
    pub(in super::super) const DMA: [u16; 16] = [11, 12, 13, 14, 15, 16, 17, 47, 56, 57, 58, 59, 60, 68, 69, 70];
}

/// A block of registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Block {
    Tim5,
    Iwdg,
    Usart2,
    Can1,
    Pwr,
    Syscfg,
    Exti,
    Tim11,
    /// GPIOA to GPIOI, by number from 0.
    Gpio(u8),
    Rcc,
    Flash,
    Dma1,
    Dma2,
    OtgFs,
    Dbgmcu,
}

/// The start and size of OTG_FS.
const OTG_FS: u32 = 0x5000_0000;
const OTG_FS_SIZE: u32 = 0x4_0000;

impl mcu::Block for Block {
    #[inline]
    fn at(address: u32) -> Option<(Self, u32)> {
        let offset = address.wrapping_sub(OTG_FS);
        if offset < OTG_FS_SIZE {
            return Some((Self::OtgFs, offset));
        }
        let block = match address & !0x3FF {
            0x4000_0C00 => Self::Tim5,
            0x4000_3000 => Self::Iwdg,
            0x4000_4400 => Self::Usart2,
            0x4000_6400 => Self::Can1,
            0x4000_7000 => Self::Pwr,
            0x4001_3800 => Self::Syscfg,
            0x4001_3C00 => Self::Exti,
            0x4001_4800 => Self::Tim11,
            0x4002_0000..=0x4002_2000 => Self::Gpio((address >> 10) as u8 & 0xF),
            0x4002_3800 => Self::Rcc,
            0x4002_3C00 => Self::Flash,
            0x4002_6000 => Self::Dma1,
            0x4002_6400 => Self::Dma2,
            0xE004_2000 => Self::Dbgmcu,
            _ => return None,
        };
        let offset = match block {
            Self::Dma1 | Self::Dma2 => address & 0x7FF,
            _ => address & 0x3FF,
        };
        Some((block, offset))
    }

    fn name(self) -> &'static str {
        match self {
            Self::Tim5 => "TIM5",
            Self::Iwdg => "IWDG",
            Self::Usart2 => "USART2",
            Self::Can1 => "CAN1",
            Self::Pwr => "PWR",
            Self::Syscfg => "SYSCFG",
            Self::Exti => "EXTI",
            Self::Tim11 => "TIM11",
            Self::Gpio(0) => "GPIOA",
            Self::Gpio(1) => "GPIOB",
            Self::Gpio(2) => "GPIOC",
            Self::Gpio(3) => "GPIOD",
            Self::Gpio(4) => "GPIOE",
            Self::Gpio(5) => "GPIOF",
            Self::Gpio(6) => "GPIOG",
            Self::Gpio(7) => "GPIOH",
            Self::Gpio(_) => "GPIOI",
            Self::Rcc => "RCC",
            Self::Flash => "FLASH",
            Self::Dma1 => "DMA1",
            Self::Dma2 => "DMA2",
            Self::OtgFs => "OTG_FS",
            Self::Dbgmcu => "DBG",
        }
    }

    #[inline]
    fn gate(self) -> Option<Gate> {
        Some(match self {
            Self::Tim5 => gates::TIM5,
            Self::Usart2 => gates::USART2,
            Self::Can1 => gates::CAN1,
            Self::Pwr => gates::PWR,
            Self::Syscfg => gates::SYSCFG,
            Self::Tim11 => gates::TIM11,
            Self::Gpio(port) => gates::gpio(port as u32),
            Self::Dma1 => gates::DMA1,
            Self::Dma2 => gates::DMA2,
            Self::OtgFs => gates::OTG_FS,
            Self::Iwdg | Self::Exti | Self::Rcc | Self::Flash | Self::Dbgmcu => return None,
        })
    }

    #[inline]
    fn takes(self, width: Width) -> bool {
        match self {
            // 18.4, 19.5: half-words or words.
            Self::Tim5 | Self::Tim11 => width != Width::Byte,
            _ => width == Width::Word,
        }
    }

    #[inline]
    fn slot(self) -> Option<Slot> {
        Some(match self {
            Self::Rcc => Slot::Rcc,
            Self::Flash => Slot::Flash,
            Self::Iwdg => Slot::Iwdg,
            Self::Tim5 => Slot::Tim,
            Self::Usart2 => Slot::Usart,
            Self::Dma1 | Self::Dma2 => Slot::Dma,
            Self::OtgFs => Slot::Usb,
            Self::Can1 => Slot::Can,
            _ => return None,
        })
    }
}

/// The system configuration controller (9.2.1).
pub(super) const SYSCFG: Layout = Layout {
    mem_mode: 0b11,
    last: 0x20,
    others: "PMC to CMPCR",
};

/// DBGMCU_IDCODE of the chip: device 0x413; revision 0x1007 is "1" (38.6.1).
pub(crate) const IDENTITY: u32 = 0x1007_6413;

/// The MCU debug component (38.16).
pub(super) const DBGMCU: dbgmcu::Layout = dbgmcu::Layout {
    last: 0x0C,
    names: "APBx_FZ",
};
