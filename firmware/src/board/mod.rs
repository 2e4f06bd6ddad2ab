//! The board: chip, pins and clocks are known only here.
//!
//! A cargo feature selects the chip: `board-stm32f405`, `board-stm32g431` or `board-rp2040`. At build time the
//! environment variable ARMWIRE_BOARD selects one of the boards with that chip, whose differences are data: `this.rs`.
//! `docs/porting.md` describes how to add a chip, and `docs/boards.md` lists the boards. Each chip provides the same
//! items:
//!
//! | Item | Meaning |
//! |---|---|
//! | `CAN_FD` | true for CAN FD |
//! | `INTERRUPTS` | the number of interrupts of the chip |
//! | `reset_clocks()` | puts clocks and peripherals into their reset state, whatever another program has left |
//! | `take_reset()` | reads the cause of the last reset, once |
//! | `init()` | holds the line to the arm high, starts the clocks, takes the pins and makes a `Board` of them |
//! | `Board`, `Watchdog`, `Led` | the peripherals of the firmware |
//! | `Can`, `CAN_CAPACITY` | the CAN bus, if the chip has one, and the number of received frames that it holds |
//! | `usb` | the registers of the USB peripheral, behind [`usb_control`] and [`usb_driver`] |
//! | `cancel_unfetched_packets()` | withdraws the packets in endpoints that the host will not fetch |
//! | `cancel_unfetched_packet()` | withdraws the packet in one endpoint, while the host polls it |
//! | `usart`, `Usart` | the registers of the arm's UART, and what these do not show |
//! | `UartInterrupt`, `RxInterrupt`, `TxInterrupt` | the interrupts of the arm's UART and of its DMA in each direction |
//! | `time`, `TimerInterrupt` | the counter of the clock and its alarm, for the [`timers`] |
//! | `transmit_at()` | starts the DMA to the arm at a time |
//! | `ServiceInterrupt` | the interrupt of a peripheral that is not used, for the [service](crate::service) |
//! | `POLL_LEAD_TIME` | the time before its slot at which a poll is handed to the UART |
//! | `hal` | the chip's HAL |
//! | `mask()` | masks interrupt handlers up to a priority |
//! | `reset()`, `serial_number()`, `chip_id()` | restarts the chip; the chip's unique id; its kind and revision |
//! | `ConfigFlash`, `CONFIG_FLASH` | the flash of the configuration: a `NorFlash`, and a range of it |
//! | `FlashError`, `is_supply_low()` | the error of a failed write, and true if the supply voltage was too low |
//! | `enter_boot_loader()` | starts the boot loader in the chip's ROM |

mod chip_reset;
mod reset_state;
#[cfg(feature = "board-rp2040")]
mod rp2040;
#[cfg(feature = "stm32")]
mod stm32;
mod this;
mod timers;
mod urgency;
mod usb_control;
mod usb_driver;
mod usb_stage;

pub(crate) use chip_reset::ChipReset;
#[cfg(feature = "board-rp2040")]
pub(crate) use rp2040::*;
#[cfg(feature = "stm32")]
pub(crate) use stm32::*;
pub(crate) use this::{HAS_CAN, NAME};
pub(crate) use timers::TimerHandler;
pub(crate) use urgency::{DRIVERS, SERVICE};
pub(crate) use usb_driver::UsbDriver;

#[cfg(not(any(feature = "board-rp2040", feature = "board-stm32f405", feature = "board-stm32g431")))]
compile_error!("no board: enable `board-rp2040`, `board-stm32f405` or `board-stm32g431`");
#[cfg(any(
    all(feature = "board-stm32f405", feature = "board-stm32g431"),
    all(feature = "board-rp2040", feature = "stm32")
))]
compile_error!("two boards: all but `board-stm32f405` need `--no-default-features`");

/// Puts the chip into its reset state, whatever another program has left. Call this before anything else: on an STM32
/// interrupts are masked until then.
pub(crate) fn restore_reset_state() {
    reset_clocks();
    reset_state::reset_core();
}
