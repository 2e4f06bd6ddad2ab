//! The MCU debug component (RM0440, 47.6): identification, and what stops with the core, which nothing does here.

use crate::soc::peripheral::{Peripheral, Refused};
use crate::time::Nanos;

const IDCODE: u32 = 0x00;
const CR: u32 = 0x04;
const APB1FZR1: u32 = 0x08;
const APB1FZR2: u32 = 0x0C;
const APB2FZR: u32 = 0x10;

/// Category 2, revision Z (47.6.1).
const IDENTITY: u32 = 0x2001_6468;

/// DBG_SLEEP, DBG_STOP and DBG_STANDBY of CR (47.6.2).
const CR_MODELLED: u32 = 0b111;

/// The component. A system reset leaves it as it is (47.6.2).
#[derive(Debug, Default)]
pub(super) struct Dbgmcu {
    cr: u32,
}

impl Peripheral for Dbgmcu {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            IDCODE => Ok(IDENTITY),
            CR => Ok(self.cr),
            APB1FZR1 | APB1FZR2 | APB2FZR => Err(Refused::Unimplemented("APBxFZR")),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            IDCODE => {}
            CR if value & !CR_MODELLED != 0 => return Err(Refused::Unimplemented("CR")),
            CR => self.cr = value,
            APB1FZR1 | APB1FZR2 | APB2FZR => return Err(Refused::Unimplemented("APBxFZR")),
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }
}
