//! An STM32G431CB with a crystal, USB on PA11/PA12 and the arm on PA2/PA3. It has not been tried on hardware:
//! `docs/porting.md` lists the points to check.
//!
//! Section numbers are those of RM0440.

mod boot;
mod can;
pub(super) mod capture;
mod clock;
mod flash;
mod init;
mod peripherals;
mod reset;
mod reset_state;
pub(super) mod uart;
pub(in crate::board) mod usb;
mod waiting;

pub(crate) use boot::enter_boot_loader;
pub(crate) use can::Controller;
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
pub(crate) use init::init;
pub(crate) use peripherals::*;
pub(crate) use reset::take_reset;
pub(crate) use reset_state::{INTERRUPTS, reset_clocks};
pub(crate) use usb::{cancel_unfetched_packet, cancel_unfetched_packets};
pub(crate) use waiting::Waiting;
