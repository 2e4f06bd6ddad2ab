//! USART3 as the UART to the arm, and its streams of DMA1 (RM0090 table 42).

use embassy_stm32::interrupt::typelevel;
use embassy_stm32::pac;
use embassy_stm32::peripherals;

/// The registers.
pub(crate) const UART: pac::usart::Usart = pac::USART3;

/// The peripheral, its RX pin, and the stream of its receiver.
pub(super) type Peripheral = peripherals::USART3;
/// See [`Peripheral`].
pub(super) type RxPin = peripherals::PB11;
/// See [`Peripheral`].
pub(super) type RxDma = peripherals::DMA1_CH1;

/// The interrupt of the UART.
pub(crate) type UartInterrupt = typelevel::USART3;
/// The interrupt of its receive stream.
pub(crate) type RxInterrupt = typelevel::DMA1_STREAM1;
/// The interrupt of its transmit stream.
pub(crate) type TxInterrupt = typelevel::DMA1_STREAM3;

/// The number of the receive stream.
pub(super) const RX_STREAM: usize = 1;
/// The number of the transmit stream.
pub(super) const TX_STREAM: usize = 3;
