//! The clock recovery system of HSI48 (RM0440, chapter 8): each start of frame on USB is a synchronization. The
//! oscillator is exact in this model, and never needs trimming.

use crate::soc::peripheral::{Peripheral, Refused, field, forbidden};
use crate::time::Nanos;

const CR: u32 = 0x00;
const CFGR: u32 = 0x04;
const ISR: u32 = 0x08;
const ICR: u32 = 0x0C;

/// Bits of CR (8.7.1).
const CEN: u32 = 1 << 5;
const AUTOTRIMEN: u32 = 1 << 6;
const CR_AT_RESET: u32 = 0x40 << 8;
const CR_MODELLED: u32 = 0x7F << 8 | CEN | AUTOTRIMEN;

/// SYNCSRC of CFGR (8.7.2).
const SYNCSRC_AT: u32 = 28;
const USB_SOF: u32 = 0b10;
const CFGR_AT_RESET: u32 = 0x2022_BB7F;

/// Flags of ISR and ICR (8.7.3, 8.7.4).
const SYNCOKF: u32 = 1;
const ESYNCF: u32 = 1 << 3;
const FLAGS: u32 = 0b1111;

/// The clock recovery system.
#[derive(Debug)]
pub(super) struct Crs {
    cr: u32,
    cfgr: u32,
    flags: u32,
}

impl Default for Crs {
    fn default() -> Self {
        Self {
            cr: CR_AT_RESET,
            cfgr: CFGR_AT_RESET,
            flags: 0,
        }
    }
}

impl Crs {
    /// Handles a start of frame on USB.
    pub(super) fn start_of_frame(&mut self) {
        if self.cr & CEN != 0 && field(self.cfgr, SYNCSRC_AT, 0b11) == USB_SOF {
            self.flags |= SYNCOKF | ESYNCF;
        }
    }
}

impl Peripheral for Crs {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            CR => Ok(self.cr),
            CFGR => Ok(self.cfgr),
            ISR => Ok(self.flags),
            ICR => Ok(0),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            // Interrupts and synchronization by software have no model.
            CR if value & !CR_MODELLED != 0 => return Err(Refused::Unimplemented("CR")),
            CR => self.cr = value,
            CFGR if self.cr & CEN != 0 => return Err(forbidden("CFGR", "8.7.2: written while CEN is set")),
            CFGR => self.cfgr = value,
            ISR => {}
            ICR => self.flags &= !(value & FLAGS),
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn reset(&mut self, _: Nanos) {
        *self = Self::default();
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Nanos = Nanos(0);

    #[test]
    fn start_of_frame_synchronizes_while_enabled() {
        let mut crs = Crs::default();
        crs.start_of_frame();
        assert_eq!(crs.read(ISR, NOW), Ok(0));
        crs.write(CR, CR_AT_RESET | CEN | AUTOTRIMEN, NOW).unwrap();
        crs.start_of_frame();
        assert_eq!(crs.read(ISR, NOW), Ok(SYNCOKF | ESYNCF));
        crs.write(ICR, SYNCOKF | ESYNCF, NOW).unwrap();
        assert_eq!(crs.read(ISR, NOW), Ok(0));
    }

    #[test]
    fn source_cannot_change_while_enabled() {
        let mut crs = Crs::default();
        crs.write(CR, CR_AT_RESET | CEN, NOW).unwrap();
        assert!(crs.write(CFGR, 0, NOW).is_err());
    }
}
