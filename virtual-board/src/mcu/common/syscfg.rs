//! The system configuration controller: the memory at address 0. The other registers have no model.

use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

const MEMRMP: u32 = 0x00;
const SECOND: u32 = 0x04;

/// The chip-specific parts.
#[derive(Debug)]
pub(crate) struct Layout {
    /// MEM_MODE of MEMRMP.
    pub(crate) mem_mode: u32,
    /// The offset of the last register.
    pub(crate) last: u32,
    /// The names of all registers but MEMRMP.
    pub(crate) others: &'static str,
}

/// The controller. The memory at address 0 matters only to the boot loader, which is a stub: the core gets no data from
/// there.
#[derive(Debug)]
pub(crate) struct Syscfg {
    layout: &'static Layout,
    memrmp: u32,
}

impl Syscfg {
    pub(crate) fn new(layout: &'static Layout) -> Self {
        Self { layout, memrmp: 0 }
    }

    /// The reason why a register that is not MEMRMP is refused.
    fn refuse(&self, offset: u32) -> Refused {
        match offset {
            SECOND.. if offset <= self.layout.last => Refused::Unimplemented(self.layout.others),
            _ => Refused::NoRegister,
        }
    }
}

impl Peripheral for Syscfg {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            MEMRMP => Ok(self.memrmp),
            _ => Err(self.refuse(offset)),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            MEMRMP if value & !self.layout.mem_mode != 0 => Err(Refused::Unimplemented("MEMRMP")),
            MEMRMP => {
                self.memrmp = value;
                Ok(())
            }
            _ => Err(self.refuse(offset)),
        }
    }

    fn reset(&mut self, _: Nanos) {
        self.memrmp = 0;
    }
}
