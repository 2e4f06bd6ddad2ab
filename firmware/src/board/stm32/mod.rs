//! The chips of the STM32 family. Besides the items of a [board](super), each provides those for the drivers here:
//!
//! | Item | Meaning |
//! |---|---|
//! | `RX_REQUEST` | the number of the UART's receive request at its DMA |
//! | `TIMER`, `TIMER_HZ`, `TimerPeripheral`, `TimerInterrupt` | a timer of 32 bits with its input clock, for the clock |
//! | `capture` | a timer that captures the crystal's divided clock, for [`crystal`] |
//! | `enable_port()` | starts the clock of a port of pins |
//! | `UART`, `TX_PIN` | the UART's registers, and its TX pin with the alternate function |
//! | `uart` | the chip-specific part of these registers, behind [`usart`] |
//! | `Controller`, `Waiting` | the registers of the CAN controller, behind [`Can`], and a received frame in its queue |

mod can;
mod can_controller;
mod crystal;
#[cfg(feature = "board-stm32f405")]
mod f405;
#[cfg(feature = "board-stm32g431")]
mod g431;
mod hsi;
mod led;
mod mask;
mod memcpy;
mod oscillator;
mod peripherals;
mod pin;
mod pre_init;
mod rcc;
mod reset;
mod sleep;
mod status;
pub(super) mod time;
pub(crate) mod usart;
mod watchdog;

pub(crate) use armwire_bridge::POLL_LEAD_TIME;
pub(crate) use can::Can;
pub(crate) use can_controller::CAPACITY as CAN_CAPACITY;
pub(crate) use embassy_stm32 as hal;
#[cfg(feature = "board-stm32f405")]
pub(crate) use f405::*;
#[cfg(feature = "board-stm32g431")]
pub(crate) use g431::*;
pub(crate) use led::Led;
pub(crate) use mask::mask;
pub(crate) use peripherals::Board;
pub(crate) use reset::{chip_id, reset, serial_number};
pub(crate) use time::{take_byte_alarm, transmit_at, wake_byte_interrupt_in};
pub(crate) use watchdog::Watchdog;
