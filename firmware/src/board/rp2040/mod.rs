//! A Raspberry Pi Pico: an RP2040 with a crystal of 12 MHz, 2 MB of flash, USB, and the arm on GP4/GP5. It has no CAN.
//! It has not been tried on hardware.
//!
//! Section numbers are those of the RP2040 datasheet.

mod boot;
mod connect;
mod flash;
mod frame;
mod init;
mod led;
mod mask;
mod peripherals;
mod reset;
pub(super) mod time;
pub(crate) mod uart;
pub(super) mod usb;
mod watchdog;

pub(crate) use boot::enter_boot_loader;
pub(crate) use embassy_rp as hal;
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low, serial_number};
pub(crate) use init::init;
pub(crate) use led::Led;
pub(crate) use mask::mask;
pub(crate) use peripherals::*;
pub(crate) use reset::{INTERRUPTS, chip_id, reset, reset_clocks, take_reset};
pub(crate) use time::{Stamp, clear_burst_alarm, clear_idle_alarm, set_end_alarm, set_idle_alarm, transmit_at};
pub(crate) use uart as usart;
pub(crate) use usb::{cancel_unfetched_packet, cancel_unfetched_packets};
pub(crate) use watchdog::Watchdog;
