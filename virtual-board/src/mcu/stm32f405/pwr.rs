//! Power control (RM0090, chapter 5): the voltage scale, which limits the core's clock, the voltage detector, and the
//! protection of the backup domain. Low-power modes and the backup regulator have no model.

use std::ops::RangeInclusive;

use crate::soc::chance::Chance;
use crate::soc::peripheral::{Peripheral, Refused, field, forbidden};
use crate::time::Nanos;

const CR: u32 = 0x00;
const CSR: u32 = 0x04;

/// Bits of CR (5.4.1).
mod cr {
    pub(super) const PVDE: u32 = 1 << 4;
    pub(super) const PLS_AT: u32 = 5;
    pub(super) const PLS: u32 = 0b111;
    pub(super) const DBP: u32 = 1 << 8;
    pub(super) const VOS: u32 = 1 << 14;
    pub(super) const MODELLED: u32 = PVDE | PLS << PLS_AT | DBP | VOS;
    /// Reserved: the other bit of VOS in the STM32F42x.
    pub(super) const RESERVED: u32 = 1 << 15;
}

/// Bits of CSR (5.4.2).
mod csr {
    pub(super) const PVDO: u32 = 1 << 2;
    pub(super) const VOSRDY: u32 = 1 << 14;
}

/// The detector's typical thresholds for each PLS in millivolts, for a rising and a falling supply (DS8626, table
/// "Embedded reset and power control block characteristics").
const THRESHOLDS: [(u32, u32); 8] = [
    (2_140, 2_040),
    (2_300, 2_190),
    (2_450, 2_350),
    (2_600, 2_510),
    (2_760, 2_660),
    (2_930, 2_840),
    (3_030, 2_930),
    (3_140, 3_030),
];

/// The maximum HCLK in hertz with scale 1 and with scale 2 (5.1.3).
const SCALE_1: u64 = 168_000_000;
const SCALE_2: u64 = 144_000_000;

/// Duration of a change of the voltage scale, in nanoseconds. The manual specifies only the flag VOSRDY.
const SETTLING: RangeInclusive<u64> = 10_000..=40_000;

/// Power control.
#[derive(Debug)]
pub(super) struct Pwr {
    cr: u32,
    millivolts: u32,
    /// PVDO.
    is_low: bool,
    /// The time at which the regulator reaches its scale.
    ready_at: Nanos,
    chance: Chance,
}

impl Pwr {
    /// The reset state, with this supply voltage.
    pub(super) fn new(millivolts: u32, seed: u64) -> Self {
        Self {
            cr: cr::VOS,
            millivolts,
            is_low: false,
            ready_at: Nanos(0),
            chance: Chance::new(seed, "PWR"),
        }
    }

    /// The supply is this from now on.
    pub(super) fn set_supply(&mut self, millivolts: u32) {
        self.millivolts = millivolts;
        self.detect();
    }

    /// The output keeps its level between the two thresholds.
    fn detect(&mut self) {
        let (rising, falling) = THRESHOLDS[field(self.cr, cr::PLS_AT, cr::PLS) as usize];
        let threshold = if self.is_low { rising } else { falling };
        self.is_low = self.cr & cr::PVDE != 0 && self.millivolts < threshold;
    }

    /// Returns true if the registers of the backup domain may be written.
    pub(super) fn opens_backup_domain(&self) -> bool {
        self.cr & cr::DBP != 0
    }

    /// Returns true if a write of CR changes the voltage scale, which is forbidden while the PLL is on (5.1.3).
    pub(super) fn changes_scale(&self, offset: u32, value: u32) -> bool {
        offset == CR && (value ^ self.cr) & cr::VOS != 0
    }

    /// The violation of an HCLK of `hz`, if any.
    pub(super) fn fault(&self, hz: u64) -> Option<Refused> {
        let most = if self.cr & cr::VOS != 0 { SCALE_1 } else { SCALE_2 };
        (hz > most).then(|| forbidden("CR", "5.1.3: HCLK above 168 MHz, or above 144 MHz with scale 2"))
    }
}

impl Peripheral for Pwr {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        let flag = |set, bit| if set { bit } else { 0 };
        match offset {
            CR => Ok(self.cr),
            CSR => Ok(flag(self.is_low, csr::PVDO) | flag(self.ready_at <= now, csr::VOSRDY)),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        match offset {
            CR if value & !(cr::MODELLED | cr::RESERVED) != 0 => return Err(Refused::Unimplemented("CR")),
            CR => {
                if self.changes_scale(offset, value) {
                    self.ready_at = now + self.chance.span(SETTLING);
                }
                self.cr = value & !cr::RESERVED;
                self.detect();
                if value & cr::RESERVED != 0 {
                    return Err(Refused::Unimplemented("CR bit 15"));
                }
            }
            CSR if value & !(csr::PVDO | csr::VOSRDY) != 0 => return Err(Refused::Unimplemented("CSR")),
            CSR => {}
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    /// Resets the controller, but not the supply.
    fn reset(&mut self, _: Nanos) {
        *self = Self {
            chance: self.chance.clone(),
            ..Self::new(self.millivolts, 0)
        };
    }
}
