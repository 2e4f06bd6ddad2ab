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
//! | `Controller`, `Waiting` | the registers of the CAN controller, behind [`Can`], and a received frame in the queue there |

mod can;
mod crystal;
#[cfg(feature = "board-stm32f405")]
mod f405;
#[cfg(feature = "board-stm32g431")]
mod g431;
mod led;
mod memcpy;
mod oscillator;
mod pin;
pub(super) mod time;
pub(crate) mod usart;

use core::marker::PhantomData;

use cortex_m::peripheral::SCB;
use cortex_m::register::{basepri, basepri_max};
use embassy_stm32::interrupt::Priority;
use embassy_stm32::pac::common::{RW, Reg};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::wdg::IndependentWatchdog;

use super::{ChipReset, THIS, UsbDriver};
use crate::uart::{Dma, Uart};

pub(crate) use armwire_bridge::POLL_LEAD_TIME;
pub(crate) use can::{CAPACITY as CAN_CAPACITY, Can};
pub(crate) use embassy_stm32 as hal;
#[cfg(feature = "board-stm32f405")]
pub(crate) use f405::*;
#[cfg(feature = "board-stm32g431")]
pub(crate) use g431::*;
pub(crate) use led::Led;
pub(crate) use time::{take_byte_alarm, transmit_at, wake_byte_interrupt_in};

/// The peripherals that the board provides.
pub(crate) struct Board {
    /// The status LED.
    pub(crate) led: Led,
    /// The arm's UART, for its line coding. The TX pin is not given to the HAL, which would leave it floating while the
    /// UART is disabled: see [`usart`].
    pub(crate) uart: Uart,
    /// The receive DMA.
    pub(crate) rx_dma: Dma,
    /// USB full speed.
    pub(crate) usb: UsbDriver,
    /// The CAN bus, not yet started.
    pub(crate) can: Can,
    /// The flash with the configuration.
    pub(crate) flash: ConfigFlash,
}

/// The watchdog. It runs on an oscillator of its own: a wait for a clock that never starts ends in a reset.
pub(crate) struct Watchdog(IndependentWatchdog<'static, IWDG>);

impl Watchdog {
    /// Starts the watchdog. Only a reset stops it. Call this once.
    pub(crate) fn start(timeout_us: u32) -> Self {
        // SAFETY: no other code takes it.
        let mut watchdog = IndependentWatchdog::new(unsafe { IWDG::steal() }, timeout_us);
        watchdog.unleash();
        Self(watchdog)
    }

    /// Starts the timeout again.
    pub(crate) fn pet(&mut self) {
        self.0.pet();
    }
}

/// Handlers wait until this is dropped. It must not be held across an `await`.
#[must_use]
pub(crate) struct Masked {
    before: u8,
    /// The mask is that of the current context.
    not_send: PhantomData<*const ()>,
}

/// Makes the handlers of this priority and below wait.
pub(crate) fn mask(priority: Priority) -> Masked {
    let before = basepri::read();
    // It does not lower the mask of a caller.
    basepri_max::write(priority.into());
    Masked {
        before,
        not_send: PhantomData,
    }
}

impl Drop for Masked {
    fn drop(&mut self) {
        // SAFETY: masks are dropped in the reverse order, and this one protects nothing any more.
        unsafe { basepri::write(self.before) };
    }
}

/// Enables clocks of peripherals in a register of RCC. Returns when they run.
///
/// An access within two cycles of the bus after the write may be lost (ES0182, "Delay after an RCC peripheral clock
/// enabling"; RM0440, "Peripheral clock enable register"): the pin to the arm would be driven low. The read takes longer.
fn enable_clocks<T: Copy>(register: Reg<T, RW>, enable: impl FnOnce(&mut T)) {
    register.modify(enable);
    register.read();
}

/// Restarts the chip.
pub(crate) fn reset() -> ! {
    SCB::sys_reset()
}

/// The chip's 96-bit unique id in hexadecimal: the adapter's serial number.
pub(crate) fn serial_number() -> &'static str {
    embassy_stm32::uid::uid_hex()
}
