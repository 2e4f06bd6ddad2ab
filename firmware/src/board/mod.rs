//! The board: the one place that knows which chip, which pins and which clocks.
//!
//! A cargo feature chooses it, `board-stm32f405` or `board-stm32g431`. `docs/porting.md` says how to add one. Each brings
//! the same items:
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
//! | `usart` | what differs in the UART's registers from chip to chip |
//! | `Controller` | the registers of the CAN controller, behind [`Can`] |
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

#[cfg(feature = "board-stm32f405")]
pub(crate) use stm32f405::*;

pub(crate) use can::Can;

#[cfg(not(feature = "board-stm32f405"))]
compile_error!("no board: enable `board-stm32f405`");

/// What the UART had to say since it was last asked.
pub(crate) struct UartStatus {
    /// A byte without its stop bit came.
    pub(crate) framing: bool,
    /// A byte with the wrong parity came.
    pub(crate) parity: bool,
    /// A byte with noise on it came.
    pub(crate) noise: bool,
    /// A byte was lost: nobody had fetched the one before.
    pub(crate) overrun: bool,
    /// The line went idle after a byte.
    pub(crate) idle: bool,
}

impl UartStatus {
    /// Whether something was wrong.
    pub(crate) fn is_error(&self) -> bool {
        self.framing || self.parity || self.noise || self.overrun
    }
}
