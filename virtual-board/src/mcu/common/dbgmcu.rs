//! The MCU debug component: identification, and the stop bits for debugging, which have no effect here.

use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

const IDCODE: u32 = 0x00;
const CR: u32 = 0x04;
const FREEZE: u32 = 0x08;

/// DBG_SLEEP, DBG_STOP and DBG_STANDBY of CR.
const CR_MODELLED: u32 = 0b111;

/// The registers that stop timers with the core. They have no model.
#[derive(Debug)]
pub(crate) struct Layout {
    /// The offset of the last register.
    pub(crate) last: u32,
    pub(crate) names: &'static str,
}

/// The component. A system reset does not change it.
#[derive(Debug)]
pub(crate) struct Dbgmcu {
    layout: &'static Layout,
    idcode: u32,
    cr: u32,
}

impl Dbgmcu {
    /// The component of a chip of this revision (DBGMCU_IDCODE).
    pub(crate) fn new(layout: &'static Layout, idcode: u32) -> Self {
        Self { layout, idcode, cr: 0 }
    }

    /// The component after power-on.
    pub(crate) fn reset(&mut self) {
        self.cr = 0;
    }

    /// The violation for a register without a model.
    fn refuse(&self, offset: u32) -> Refused {
        match offset {
            FREEZE.. if offset <= self.layout.last => Refused::Unimplemented(self.layout.names),
            _ => Refused::NoRegister,
        }
    }
}

impl Peripheral for Dbgmcu {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            IDCODE => Ok(self.idcode),
            CR => Ok(self.cr),
            _ => Err(self.refuse(offset)),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            IDCODE => {}
            CR if value & !CR_MODELLED != 0 => return Err(Refused::Unimplemented("CR")),
            CR => self.cr = value,
            _ => return Err(self.refuse(offset)),
        }
        Ok(())
    }
}
