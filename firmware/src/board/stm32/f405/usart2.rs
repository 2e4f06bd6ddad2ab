//! USART2 as the UART to the arm, and its streams of DMA1 (RM0090 table 42).

use embassy_stm32::interrupt::typelevel;
use embassy_stm32::pac;
use embassy_stm32::peripherals;

/// The registers.
pub(crate) const UART: pac::usart::Usart = pac::USART2;

/// The peripheral, its RX pin, and the stream of its receiver.
pub(super) type Peripheral = peripherals::USART2;
/// See [`Peripheral`].
pub(super) type RxPin = peripherals::PA3;
/// See [`Peripheral`].
pub(super) type RxDma = peripherals::DMA1_CH5;

/// The interrupt of the UART.
pub(crate) type UartInterrupt = typelevel::USART2;
/// The interrupt of its receive stream.
pub(crate) type RxInterrupt = typelevel::DMA1_STREAM5;
/// The interrupt of its transmit stream.
pub(crate) type TxInterrupt = typelevel::DMA1_STREAM6;

/// The number of the receive stream.
pub(super) const RX_STREAM: usize = 5;
/// The number of the transmit stream.
pub(super) const TX_STREAM: usize = 6;
