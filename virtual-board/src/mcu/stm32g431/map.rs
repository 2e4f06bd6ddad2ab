//! The memory map of the STM32G431xB (RM0440, 2.2.2), its interrupts (table 97) and its system memory.

use super::flash::SIZE;
use super::rcc::gates;
use super::{fdcan, usart, usb};
use crate::mcu::common::dbgmcu;
use crate::mcu::common::mcu::{Block, Map};
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

/// A peripheral.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Kind {
    Tim2,
    Crs,
    Iwdg,
    Usart2,
    Usb,
    Fdcan1,
    Pwr,
    Syscfg,
    Exti,
    Dma,
    Rcc,
    Flash,
    /// GPIOA to GPIOG, by number from 0.
    Gpio(u8),
    Dbgmcu,
    Tim16,
}

/// The address of USART2.
pub(super) const USART2: u32 = 0x4000_4400;

/// The memory map.
pub(super) const BLOCKS: &[Block<Kind>] = &[
    Block::new(Kind::Usart2, USART2, "USART2", Some(gates::USART2)),
    Block::new(Kind::Usb, 0x4000_5C00, "USB", Some(gates::USB)),
    Block {
        offset: usb::PACKET_MEMORY_AT,
        ..Block::new(Kind::Usb, 0x4000_6000, "USB packet memory", Some(gates::USB))
    },
    Block::new(Kind::Tim2, 0x4000_0000, "TIM2", Some(gates::TIM2)),
    Block::new(Kind::Dma, 0x4002_0000, "DMA1", Some(gates::DMA1)),
    Block {
        offset: 0x400,
        ..Block::new(Kind::Dma, 0x4002_0400, "DMA2", Some(gates::DMA2))
    },
    Block {
        offset: 0x800,
        ..Block::new(Kind::Dma, 0x4002_0800, "DMAMUX1", Some(gates::DMAMUX1))
    },
    Block::new(Kind::Fdcan1, 0x4000_6400, "FDCAN1", Some(gates::FDCAN)),
    Block {
        offset: fdcan::RAM,
        ..Block::new(Kind::Fdcan1, 0x4000_A400, "FDCAN1 message RAM", Some(gates::FDCAN))
    },
    Block::new(Kind::Rcc, 0x4002_1000, "RCC", None),
    Block::new(Kind::Flash, 0x4002_2000, "FLASH", Some(gates::FLASH)),
    Block::new(Kind::Pwr, 0x4000_7000, "PWR", Some(gates::PWR)),
    Block::new(Kind::Iwdg, 0x4000_3000, "IWDG", None),
    Block::new(Kind::Crs, 0x4000_2000, "CRS", Some(gates::CRS)),
    Block::new(Kind::Tim16, 0x4001_4400, "TIM16", Some(gates::TIM16)),
    Block::new(Kind::Syscfg, 0x4001_0000, "SYSCFG", Some(gates::SYSCFG)),
    Block::new(Kind::Exti, 0x4001_0400, "EXTI", Some(gates::SYSCFG)),
    Block::new(Kind::Dbgmcu, 0xE004_2000, "DBGMCU", None),
    Block::new(Kind::Gpio(0), 0x4800_0000, "GPIOA", Some(gates::gpio(0))),
    Block::new(Kind::Gpio(1), 0x4800_0400, "GPIOB", Some(gates::gpio(1))),
    Block::new(Kind::Gpio(2), 0x4800_0800, "GPIOC", Some(gates::gpio(2))),
    Block::new(Kind::Gpio(3), 0x4800_0C00, "GPIOD", Some(gates::gpio(3))),
    Block::new(Kind::Gpio(4), 0x4800_1000, "GPIOE", Some(gates::gpio(4))),
    Block::new(Kind::Gpio(5), 0x4800_1400, "GPIOF", Some(gates::gpio(5))),
    Block::new(Kind::Gpio(6), 0x4800_1800, "GPIOG", Some(gates::gpio(6))),
];

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
