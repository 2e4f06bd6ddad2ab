//! The microcontrollers, peripheral by peripheral.

use std::collections::BTreeMap;

use self::stm32f405::{ArmUart, OtgVariant, Reenabled};
use self::stm32g431::EccRegister;
use crate::report::Crash;
use crate::revision::Rp2040Revision;
use crate::soc::gdb::Debugger;
use crate::soc::machine::Edges;

pub(crate) mod common;
mod start;
pub(crate) mod stm32f405;
pub(crate) mod stm32g431;

/// The properties of a microcontroller, and its connections.
#[derive(Debug)]
pub(crate) struct Setup {
    pub(crate) unique_id: [u8; 12],
    /// DBGMCU_IDCODE of the STM32F405.
    pub(crate) idcode: u32,
    pub(crate) rp2040_revision: Rp2040Revision,
    /// The UART of the STM32F405 with the arm.
    pub(crate) arm_uart: ArmUart,
    pub(crate) reenabled: Reenabled,
    pub(crate) otg: OtgVariant,
    pub(crate) ecc_register: EccRegister,
    pub(crate) seed: u64,
    /// The virtual duration of a cycle, in percent.
    pub(crate) cycle_cost: u32,
    /// True for the cycles of a Cortex-M4 with this flash.
    pub(crate) exact: bool,
    /// Functions that run only in a crash of the firmware.
    pub(crate) crashes: BTreeMap<u32, Crash>,
    /// The address of the firmware's log, if it has one.
    pub(crate) log: Option<u32>,
    pub(crate) debugger: Option<Debugger>,
    pub(crate) edges: Edges,
}
