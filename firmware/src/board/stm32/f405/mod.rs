//! An STM32F405RG, or an STM32F407, with a crystal and USB on PA11/PA12.
//!
//! Section numbers are those of RM0090.

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
#[cfg(not(arm_at_usart3))]
mod usart2;
#[cfg(arm_at_usart3)]
mod usart3;
pub(in crate::board) mod usb;
mod waiting;

pub(crate) use boot::enter_boot_loader;
pub(crate) use can::Controller;
pub(crate) use flash::{CONFIG_FLASH, ConfigFlash, FlashError, is_supply_low};
pub(crate) use init::init;
pub(crate) use peripherals::*;
pub(crate) use reset::take_reset;
pub(crate) use reset_state::{INTERRUPTS, reset_clocks};
#[cfg(not(arm_at_usart3))]
pub(crate) use usart2::*;
#[cfg(arm_at_usart3)]
pub(crate) use usart3::*;
pub(crate) use usb::{cancel_unfetched_packet, cancel_unfetched_packets};
pub(crate) use waiting::Waiting;
