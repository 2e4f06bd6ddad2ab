//! The peripherals that the drivers use.

use armwire_boards::Port;
use embassy_stm32::dma::Request;
use embassy_stm32::pac;

use super::super::pin;
use super::super::rcc::enable_clocks;
use crate::board::this::THIS;

pub(crate) const CAN_FD: bool = false;

/// The clock: a 32-bit timer, its peripheral and its interrupt.
pub(crate) const TIMER: pac::timer::TimGp32 = pac::TIM5;
/// Its input clock: twice that of APB1.
pub(crate) const TIMER_HZ: u64 = 84_000_000;
/// See [`TIMER`].
pub(crate) type TimerPeripheral = embassy_stm32::peripherals::TIM5;
/// See [`TIMER`].
pub(crate) type TimerInterrupt = embassy_stm32::interrupt::typelevel::TIM5;

/// The TX pin, and the number of its alternate function (DS8626, table 9).
pub(crate) const TX_PIN: (pac::gpio::Gpio, usize, u8) = {
    let (port, pin) = pin::registers(THIS.uart.tx());
    (port, pin, 7)
};

/// The interrupt of a peripheral that is not used, for the [service](crate::service).
pub(crate) type ServiceInterrupt = embassy_stm32::interrupt::typelevel::SPI1;

/// The channel of the streams of USART2 and USART3, in each direction (RM0090 table 42).
pub(crate) const RX_REQUEST: Request = 4;
/// See [`RX_REQUEST`].
pub(crate) const TX_REQUEST: Request = 4;

/// Starts the clock of a port of pins (7.3.10).
pub(crate) fn enable_port(port: Port) {
    // GPIOAEN is bit 0, GPIOBEN bit 1, and so on.
    enable_clocks(pac::RCC.ahb1enr(), |w| w.0 |= 1 << port as u32);
}
