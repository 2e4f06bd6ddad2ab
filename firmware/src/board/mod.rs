//! The board: the one place that knows which chip, which pins and which clocks.
//!
//! A cargo feature chooses it, `board-stm32f405` or `board-stm32g431`. `docs/porting.md` says how to add one. Each
//! brings the same items:
//!
//! | Item | What it is |
//! |---|---|
//! | `NAME`, `CAN_FD` | what the board is called, and whether its CAN is CAN FD |
//! | `init() -> Board` | starts the clocks and takes the pins; the fields of `Board` are below |
//! | `serial_number()` | the chip's unique id |
//! | `UsbDriver` | the driver of the USB peripheral |
//! | `cancel_unfetched_packets()` | takes back what waits in an endpoint for a host that will not fetch it |
//! | `Watchdog` | the independent watchdog |
//! | `UartInterrupt`, `RxInterrupt` | the interrupts of the arm's UART and of the DMA that serves it, receiving |
//! | `RX_REQUEST`, `TX_REQUEST` | what that DMA calls the UART's requests |
//! | `TIMER`, `TimerPeripheral`, `TimerInterrupt` | a timer of 32 bits, for the clock |
//! | `UART`, `TX_PIN` | the UART's registers, and the pin that it sends on |
//! | `uart` | what is the chip's own in them, behind [`usart`] |
//! | `Controller`, `Waiting` | the registers of the CAN controller, behind [`Can`], and a frame from it that waits there |
//! | `ConfigFlash`, `CONFIG_FLASH` | where the configuration is kept: a `NorFlash`, and which part of it |
//! | `enter_boot_loader()` | starts the boot loader in the chip's ROM |
//!
//! | Field of `Board` | What it is |
//! |---|---|
//! | `led` | the status LED |
//! | `uart`, `rx_dma`, `tx_dma` | the arm's UART with its pins, and the DMA for each way |
//! | `usb` | USB full speed |
//! | `can` | the CAN bus, not yet started |
//! | `flash` | the flash that has the configuration in it |
//! | `reset_by_watchdog` | whether the watchdog reset the chip |
//! | `watchdog` | the independent watchdog, not yet started |

mod can;
#[cfg(feature = "board-stm32f405")]
mod stm32f405;
#[cfg(feature = "board-stm32g431")]
mod stm32g431;
mod time;
pub(crate) mod usart;

pub(crate) use can::Can;
#[cfg(feature = "board-stm32f405")]
pub(crate) use stm32f405::*;
#[cfg(feature = "board-stm32g431")]
pub(crate) use stm32g431::*;

#[cfg(not(any(feature = "board-stm32f405", feature = "board-stm32g431")))]
compile_error!("no board: enable `board-stm32f405` or `board-stm32g431`");
#[cfg(all(feature = "board-stm32f405", feature = "board-stm32g431"))]
compile_error!("two boards: `board-stm32g431` needs `--no-default-features`");
