//! The memory map of the STM32F405RG (RM0090, 2.3), its interrupts (table 62) and its system memory.

use super::rcc::gates;
use super::usart;
use crate::flash::SIZE;
use crate::mcu::common::dbgmcu;
use crate::mcu::common::mcu::{Block, Map};
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
    pub(in super::super) const USART3: u16 = 39;
    pub(in super::super) const TIM5: u16 = 50;
    pub(in super::super) const OTG_FS: u16 = 67;
    /// Streams 0 to 7 of DMA1, then of DMA2.
    pub(in super::super) const DMA: [u16; 16] = [11, 12, 13, 14, 15, 16, 17, 47, 56, 57, 58, 59, 60, 68, 69, 70];
}

/// A peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Tim5,
    Iwdg,
    /// The UART to the arm.
    Uart,
    Can1,
    Pwr,
    Syscfg,
    Exti,
    Tim11,
    /// GPIOA to GPIOI, by number from 0.
    Gpio(u8),
    Rcc,
    Flash,
    Dma,
    OtgFs,
    Dbgmcu,
}

/// The memory map, with one UART.
pub(super) const fn blocks(uart: Block<Kind>) -> [Block<Kind>; 23] {
    [
        uart,
        Block {
            size: 0x4_0000,
            ..Block::new(Kind::OtgFs, 0x5000_0000, "OTG_FS", Some(gates::OTG_FS))
        },
        Block::new(Kind::Tim5, 0x4000_0C00, "TIM5", Some(gates::TIM5)),
        Block::new(Kind::Dma, 0x4002_6000, "DMA1", Some(gates::DMA1)),
        Block {
            offset: 0x400,
            ..Block::new(Kind::Dma, 0x4002_6400, "DMA2", Some(gates::DMA2))
        },
        Block::new(Kind::Can1, 0x4000_6400, "CAN1", Some(gates::CAN1)),
        Block::new(Kind::Rcc, 0x4002_3800, "RCC", None),
        Block::new(Kind::Flash, 0x4002_3C00, "FLASH", None),
        Block::new(Kind::Pwr, 0x4000_7000, "PWR", Some(gates::PWR)),
        Block::new(Kind::Iwdg, 0x4000_3000, "IWDG", None),
        Block::new(Kind::Tim11, 0x4001_4800, "TIM11", Some(gates::TIM11)),
        Block::new(Kind::Syscfg, 0x4001_3800, "SYSCFG", Some(gates::SYSCFG)),
        Block::new(Kind::Exti, 0x4001_3C00, "EXTI", None),
        Block::new(Kind::Dbgmcu, 0xE004_2000, "DBG", None),
        Block::new(Kind::Gpio(0), 0x4002_0000, "GPIOA", Some(gates::gpio(0))),
        Block::new(Kind::Gpio(1), 0x4002_0400, "GPIOB", Some(gates::gpio(1))),
        Block::new(Kind::Gpio(2), 0x4002_0800, "GPIOC", Some(gates::gpio(2))),
        Block::new(Kind::Gpio(3), 0x4002_0C00, "GPIOD", Some(gates::gpio(3))),
        Block::new(Kind::Gpio(4), 0x4002_1000, "GPIOE", Some(gates::gpio(4))),
        Block::new(Kind::Gpio(5), 0x4002_1400, "GPIOF", Some(gates::gpio(5))),
        Block::new(Kind::Gpio(6), 0x4002_1800, "GPIOG", Some(gates::gpio(6))),
        Block::new(Kind::Gpio(7), 0x4002_1C00, "GPIOH", Some(gates::gpio(7))),
        Block::new(Kind::Gpio(8), 0x4002_2000, "GPIOI", Some(gates::gpio(8))),
    ]
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
