//! The system configuration controller (RM0090, chapter 9): what is at address 0. The other registers have no model.

use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

const MEMRMP: u32 = 0x00;

/// MEM_MODE of MEMRMP (9.2.1).
const MEM_MODE: u32 = 0b11;

/// The controller. What is at address 0 matters to the boot loader alone, in whose place there is one that does nothing: the
/// core gets nothing from there.
#[derive(Debug, Default)]
pub(super) struct Syscfg {
    memrmp: u32,
}

impl Peripheral for Syscfg {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            MEMRMP => Ok(self.memrmp),
            0x04..=0x20 => Err(Refused::Unimplemented("PMC to CMPCR")),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            MEMRMP if value & !MEM_MODE != 0 => Err(Refused::Unimplemented("MEMRMP")),
            MEMRMP => {
                self.memrmp = value;
                Ok(())
            }
            0x04..=0x20 => Err(Refused::Unimplemented("PMC to CMPCR")),
            _ => Err(Refused::NoRegister),
        }
    }
}
