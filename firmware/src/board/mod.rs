//! The board: the one place that knows which chip, which pins and which clocks.
//!
//! A cargo feature chooses it, `board-stm32f405` or `board-stm32g431`. `docs/porting.md` says how to add one. Each
//! brings the same items:
//!
//! | Item | What it is |
//! |---|---|
//! | `NAME`, `CAN_FD` | what the board is called, and whether its CAN is CAN FD |
//! | `init()` | holds the line to the arm high, starts the clocks, takes the pins and makes a [`Board`] of them |
//! | `UsbDriver` | the driver of the USB peripheral |
//! | `usb` | the registers of endpoint 0, behind [`usb_control`] |
//! | `cancel_unfetched_packets()` | takes back what waits in an endpoint for a host that will not fetch it |
//! | `cancel_unfetched_packet()` | takes back what waits in one endpoint, while the host asks for packets |
//! | `UartInterrupt`, `RxInterrupt` | the interrupts of the arm's UART and of the DMA that serves it, receiving |
//! | `RX_REQUEST`, `TX_REQUEST` | what that DMA calls the UART's requests |
//! | `TIMER`, `TimerPeripheral`, `TimerInterrupt` | a timer of 32 bits, for the clock |
//! | `LED` | the pin of the status LED |
//! | `UART`, `TX_PIN` | the UART's registers, and the pin that it sends on with its alternate function |
//! | `uart` | what is the chip's own in them, behind [`usart`] |
//! | `Controller`, `Waiting` | the registers of the CAN controller, behind [`Can`], and a frame from it that waits there |
//! | `ConfigFlash`, `CONFIG_FLASH` | where the configuration is kept: a `NorFlash`, and which part of it |
//! | `FlashError`, `is_supply_low()` | why that was not changed, and whether because the supply is too low |
//! | `enter_boot_loader()` | starts the boot loader in the chip's ROM |

mod can;
mod oscillator;
#[cfg(feature = "board-stm32f405")]
mod stm32f405;
#[cfg(feature = "board-stm32g431")]
mod stm32g431;
mod time;
pub(crate) mod usart;
mod usb_control;

use embassy_stm32::dma::Channel;
use embassy_stm32::gpio::Output;
use embassy_stm32::mode::Blocking;
use embassy_stm32::peripherals::IWDG;
use embassy_stm32::usart::UartRx;
use embassy_stm32::wdg::IndependentWatchdog;

pub(crate) use can::{CAPACITY as CAN_CAPACITY, Can};
#[cfg(feature = "board-stm32f405")]
pub(crate) use stm32f405::*;
#[cfg(feature = "board-stm32g431")]
pub(crate) use stm32g431::*;
pub(crate) use time::transmit_at;

#[cfg(not(any(feature = "board-stm32f405", feature = "board-stm32g431")))]
compile_error!("no board: enable `board-stm32f405` or `board-stm32g431`");
#[cfg(all(feature = "board-stm32f405", feature = "board-stm32g431"))]
compile_error!("two boards: `board-stm32g431` needs `--no-default-features`");

/// What the board gives the firmware.
pub(crate) struct Board {
    /// The status LED.
    pub(crate) led: Output<'static>,
    /// The arm's UART, to set its line coding with. The pin that it sends on is not the HAL's, which would leave it to a UART
    /// that is disabled: see [`usart`].
    pub(crate) uart: UartRx<'static, Blocking>,
    /// The DMA for bytes from the arm.
    pub(crate) rx_dma: Channel<'static>,
    /// The DMA for bytes to the arm.
    pub(crate) tx_dma: Channel<'static>,
    /// USB full speed.
    pub(crate) usb: UsbDriver,
    /// The CAN bus, not yet started.
    pub(crate) can: Can,
    /// The flash that has the configuration in it.
    pub(crate) flash: ConfigFlash,
    /// Whether the watchdog reset the chip.
    pub(crate) reset_by_watchdog: bool,
}

/// The independent watchdog.
pub(crate) type Watchdog = IndependentWatchdog<'static, IWDG>;

/// The chip's 96-bit unique id in hexadecimal: the adapter's serial number.
pub(crate) fn serial_number() -> &'static str {
    embassy_stm32::uid::uid_hex()
}
