//! The UARTs to which the arm may be connected.

use super::dma::Request;
use super::map::{self, Kind, interrupt};
use super::rcc::gates;
use crate::mcu::common::mcu::Block;

/// The UART of an STM32F405 that has the arm. The other has no model.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ArmUart {
    /// USART2, on PA2 and PA3.
    #[default]
    Usart2,
    /// USART3, on PB10 and PB11.
    Usart3,
}

/// The memory map with each of them.
static WITH_USART2: [Block<Kind>; 23] = map::blocks(Block::new(Kind::Uart, USART2, "USART2", Some(gates::USART2)));
static WITH_USART3: [Block<Kind>; 23] = map::blocks(Block::new(Kind::Uart, USART3, "USART3", Some(gates::USART3)));

/// Addresses (2.3).
const USART2: u32 = 0x4000_4400;
const USART3: u32 = 0x4000_4800;

impl ArmUart {
    pub(super) fn blocks(self) -> &'static [Block<Kind>] {
        match self {
            Self::Usart2 => &WITH_USART2,
            Self::Usart3 => &WITH_USART3,
        }
    }

    pub(super) fn address(self) -> u32 {
        match self {
            Self::Usart2 => USART2,
            Self::Usart3 => USART3,
        }
    }

    /// The interrupt (table 62).
    pub(super) fn interrupt(self) -> u16 {
        match self {
            Self::Usart2 => interrupt::USART2,
            Self::Usart3 => interrupt::USART3,
        }
    }

    /// The port, by number from 0, and the number of the TX pin.
    pub(super) fn tx_pin(self) -> (usize, u32) {
        match self {
            Self::Usart2 => (0, 2),
            Self::Usart3 => (1, 10),
        }
    }

    /// The DMA requests of the receiver and the transmitter (10.3.3, table 42).
    pub(super) const fn requests(self) -> [Request; 2] {
        let (receive, transmit) = match self {
            Self::Usart2 => (5, 6),
            Self::Usart3 => (1, 3),
        };
        [Request::of_dma1(receive, 4), Request::of_dma1(transmit, 4)]
    }
}
