//! The peripherals that the drivers use.

use armwire_boards::Port;
use embassy_stm32::dma::Request;
use embassy_stm32::pac;

use super::super::rcc::enable_clocks;

pub(crate) const CAN_FD: bool = true;

/// The clock: a 32-bit timer, its peripheral and its interrupt.
pub(crate) const TIMER: pac::timer::TimGp32 = pac::TIM2;
/// Its input clock: that of APB1.
pub(crate) const TIMER_HZ: u64 = 160_000_000;
/// See [`TIMER`].
pub(crate) type TimerPeripheral = embassy_stm32::peripherals::TIM2;
/// See [`TIMER`].
pub(crate) type TimerInterrupt = embassy_stm32::interrupt::typelevel::TIM2;

/// The registers of the arm's UART.
pub(crate) const UART: pac::usart::Usart = pac::USART2;

/// The TX pin, PA2, and the number of its alternate function (DS12589, table 13).
pub(crate) const TX_PIN: (pac::gpio::Gpio, usize, u8) = (pac::GPIOA, 2, 7);

/// The interrupt of the arm's UART.
pub(crate) type UartInterrupt = embassy_stm32::interrupt::typelevel::USART2;

/// The interrupt of its receive DMA channel.
pub(crate) type RxInterrupt = embassy_stm32::interrupt::typelevel::DMA1_CHANNEL1;

/// The interrupt of its transmit DMA channel.
pub(crate) type TxInterrupt = embassy_stm32::interrupt::typelevel::DMA1_CHANNEL2;

/// The interrupt of a peripheral that is not used, for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_stm32::interrupt::typelevel::SPI1;

/// The numbers of the receive and the transmit channel on DMA1, from 0.
pub(crate) const RX_CHANNEL: usize = 0;
/// See [`RX_CHANNEL`].
pub(crate) const TX_CHANNEL: usize = 1;

/// The DMAMUX inputs of USART2_RX and, below, USART2_TX (RM0440 13.3.2, assignment of inputs to resources).
pub(crate) const RX_REQUEST: Request = 26;
/// See [`RX_REQUEST`].
pub(crate) const TX_REQUEST: Request = 27;

/// Starts the clock of a port of pins (7.4.14).
pub(crate) fn enable_port(port: Port) {
    // GPIOAEN is bit 0, GPIOBEN bit 1, and so on.
    enable_clocks(pac::RCC.ahb2enr(), |w| w.0 |= 1 << port as u32);
}
