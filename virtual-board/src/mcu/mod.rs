//! The microcontrollers, peripheral by peripheral.

pub(crate) mod common;
pub(crate) mod stm32f405;
pub(crate) mod stm32g431;
