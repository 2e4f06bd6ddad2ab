//! The board: chip, pins and clocks are known only here.
//!
//! A cargo feature selects the chip, `board-stm32f405` or `board-stm32g431`. At build time the environment variable
//! ARMWIRE_BOARD selects one of the boards with that chip, whose differences are data: [`THIS`]. `docs/porting.md`
//! describes how to add a chip, and `docs/boards.md` lists the boards. Each chip provides the same items:
//!
//! | Item | Meaning |
//! |---|---|
//! | `CHIP`, `CAN_FD` | the chip, and true for CAN FD |
//! | `take_reset()` | reads the cause of the last reset, once |
//! | `init()` | holds the line to the arm high, starts the clocks, takes the pins and makes a [`Board`] of them |
//! | `UsbDriver` | the driver of the USB peripheral |
//! | `usb` | the registers of endpoint 0, behind [`usb_control`] |
//! | `cancel_unfetched_packets()` | withdraws the packets in endpoints that the host will not fetch |
//! | `cancel_unfetched_packet()` | withdraws the packet in one endpoint, while the host polls it |
//! | `UartInterrupt`, `RxInterrupt`, `TxInterrupt` | the interrupts of the arm's UART and of its DMA in each direction |
//! | `ServiceInterrupt` | the interrupt of a peripheral that is not used, for the [service](crate::service) |
//! | `RX_REQUEST` | the number of the UART's receive request at that DMA |
//! | `TIMER`, `TIMER_HZ`, `TimerPeripheral`, `TimerInterrupt` | a timer of 32 bits with its input clock, for the clock |
//! | `capture` | a timer that captures the crystal's divided clock, for [`crystal`] |
//! | `enable_port()` | starts the clock of a port of pins |
//! | `UART`, `TX_PIN` | the UART's registers, and its TX pin with the alternate function |
//! | `uart` | the chip-specific part of these registers, behind [`usart`] |
//! | `Controller`, `Waiting` | the registers of the CAN controller, behind [`Can`], and a received frame in the queue there |
//! | `ConfigFlash`, `CONFIG_FLASH` | the flash of the configuration: a `NorFlash`, and a range of it |
//! | `FlashError`, `is_supply_low()` | the error of a failed write, and true if the supply voltage was too low |
//! | `enter_boot_loader()` | starts the boot loader in the chip's ROM |

mod can;
mod crystal;
mod led;
mod memcpy;
mod oscillator;
mod pin;
#[cfg(feature = "board-stm32f405")]
mod stm32f405;
#[cfg(feature = "board-stm32g431")]
mod stm32g431;
mod time;
pub(crate) mod usart;
mod usb_control;

use armwire_boards::Board as Data;
use embassy_stm32::dma::Channel;
use embassy_stm32::mode::Blocking;
use embassy_stm32::pac::common::{RW, Reg};
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::usart::UartRx;
use embassy_stm32::wdg::IndependentWatchdog;

pub(crate) use can::{CAPACITY as CAN_CAPACITY, Can};
pub(crate) use led::Led;
#[cfg(feature = "board-stm32f405")]
pub(crate) use stm32f405::*;
#[cfg(feature = "board-stm32g431")]
pub(crate) use stm32g431::*;
pub(crate) use time::{take_byte_alarm, transmit_at, wake_byte_interrupt_in};

#[cfg(not(any(feature = "board-stm32f405", feature = "board-stm32g431")))]
compile_error!("no board: enable `board-stm32f405` or `board-stm32g431`");
#[cfg(all(feature = "board-stm32f405", feature = "board-stm32g431"))]
compile_error!("two boards: `board-stm32g431` needs `--no-default-features`");

/// This board's data.
const THIS: &Data = match Data::find(match option_env!("ARMWIRE_BOARD") {
    Some(name) => name,
    None => CHIP.name(),
}) {
    Some(board) => board,
    None => panic!("ARMWIRE_BOARD is no board of armwire-boards"),
};

const _: () = assert!(THIS.chip as u8 == CHIP as u8, "ARMWIRE_BOARD has another chip");

/// The board's name.
pub(crate) const NAME: &str = THIS.name;

/// The peripherals that the board provides.
pub(crate) struct Board {
    /// The status LED.
    pub(crate) led: Led,
    /// The arm's UART, for its line coding. The TX pin is not given to the HAL, which would leave it floating while the
    /// UART is disabled: see [`usart`].
    pub(crate) uart: UartRx<'static, Blocking>,
    /// The receive DMA.
    pub(crate) rx_dma: Channel<'static>,
    /// USB full speed.
    pub(crate) usb: UsbDriver,
    /// The CAN bus, not yet started.
    pub(crate) can: Can,
    /// The flash with the configuration.
    pub(crate) flash: ConfigFlash,
}

/// The cause of a reset, by the chip's flags.
#[derive(Clone, Copy)]
pub(crate) enum ChipReset {
    /// The supply was switched on, or was too low.
    PowerOn,
    /// The watchdog.
    Watchdog,
    /// The firmware, the reset pin or a debugger.
    Other,
}

pub(crate) type Watchdog = IndependentWatchdog<'static, IWDG>;

/// Enables clocks of peripherals in a register of RCC. Returns when they run.
///
/// An access within two cycles of the bus after the write may be lost (ES0182, "Delay after an RCC peripheral clock
/// enabling"; RM0440, "Peripheral clock enable register"): the pin to the arm would be driven low. The read takes longer.
fn enable_clocks<T: Copy>(register: Reg<T, RW>, enable: impl FnOnce(&mut T)) {
    register.modify(enable);
    register.read();
}

/// The chip's 96-bit unique id in hexadecimal: the adapter's serial number.
pub(crate) fn serial_number() -> &'static str {
    embassy_stm32::uid::uid_hex()
}
