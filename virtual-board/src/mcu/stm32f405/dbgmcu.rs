//! The MCU debug component (RM0090, 38.16): identification, and what stops with the core, which nothing does here.

use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

const IDCODE: u32 = 0x00;
const CR: u32 = 0x04;
const APB1_FZ: u32 = 0x08;
const APB2_FZ: u32 = 0x0C;

/// DBGMCU_IDCODE of the chip: device 0x413; revision 0x1007 is "1" (38.6.1).
pub(crate) const IDENTITY: u32 = 0x1007_6413;

/// DBG_SLEEP, DBG_STOP and DBG_STANDBY of CR (38.16.3).
const CR_MODELLED: u32 = 0b111;

/// The component. A system reset leaves it as it is (38.16.3).
#[derive(Debug)]
pub(super) struct Dbgmcu {
    idcode: u32,
    cr: u32,
}

impl Dbgmcu {
    /// The component of a chip of this revision.
    pub(super) fn new(idcode: u32) -> Self {
        Self { idcode, cr: 0 }
    }

    /// The component after power-on.
    pub(super) fn reset(&mut self) {
        self.cr = 0;
    }
}

impl Peripheral for Dbgmcu {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            IDCODE => Ok(self.idcode),
            CR => Ok(self.cr),
            APB1_FZ | APB2_FZ => Err(Refused::Unimplemented("APBx_FZ")),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            IDCODE => {}
            CR if value & !CR_MODELLED != 0 => return Err(Refused::Unimplemented("CR")),
            CR => self.cr = value,
            APB1_FZ | APB2_FZ => return Err(Refused::Unimplemented("APBx_FZ")),
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }
}
