//! Power control (RM0440, chapter 6): the voltage range and boost mode, which limit the core's clock. Low-power modes
//! and the supply detectors have no model.

use crate::soc::peripheral::{Peripheral, Refused, check_modelled, field, forbidden, merge};
use crate::time::Nanos;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const CR3: u32 = 0x08;
const CR4: u32 = 0x0C;
const SR1: u32 = 0x10;
const SR2: u32 = 0x14;
const SCR: u32 = 0x18;
const CR5: u32 = 0x80;

/// VOS of CR1 (6.4.1), and another modelled bit: DBP.
const VOS_AT: u32 = 9;
const VOS: u32 = 0b11;
const RANGE_1: u32 = 0b01;
const RANGE_2: u32 = 0b10;
const DBP: u32 = 1 << 8;
const CR1_MODELLED: u32 = VOS << VOS_AT | DBP;

/// UCPD1_DBDIS and UCPD1_STDBY of CR3 (6.4.3): they have no effect without USB Type-C.
const CR3_AT_RESET: u32 = 1 << 15;
const CR3_MODELLED: u32 = 1 << 15 | 1 << 14 | 1 << 13;

/// R1MODE of CR5 (6.4.22): 0 is boost mode.
const R1MODE: u32 = 1 << 8;

/// The supply of the core (6.1.5).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Supply {
    Range1Boost,
    Range1,
    Range2,
}

impl Supply {
    /// The maximum HCLK in hertz for each number of wait states of the flash (5.3.3, table 29).
    fn limits(self) -> &'static [u64] {
        match self {
            Self::Range1Boost => &[34_000_000, 68_000_000, 102_000_000, 136_000_000, 170_000_000],
            Self::Range1 => &[30_000_000, 60_000_000, 90_000_000, 120_000_000, 150_000_000],
            Self::Range2 => &[12_000_000, 24_000_000, 26_000_000],
        }
    }

    /// The violation of an HCLK of `hz` with this number of wait states.
    pub(super) fn fault(self, hz: u64, wait_states: u32) -> Option<(&'static str, Refused)> {
        let limits = self.limits();
        let most = limits[limits.len() - 1];
        let with_wait_states = limits.get(wait_states as usize).copied().unwrap_or(most);
        if hz > most {
            let (register, reason) = match self {
                Self::Range1 => ("CR5", "6.1.5: HCLK above 150 MHz in range 1 without boost mode"),
                Self::Range1Boost => ("CR5", "6.1.5: HCLK above 170 MHz"),
                Self::Range2 => ("CR1", "6.1.5: HCLK above 26 MHz in range 2"),
            };
            Some(("PWR", forbidden(register, reason)))
        } else if hz > with_wait_states {
            Some(("FLASH", forbidden("ACR", "5.3.3: too few wait states for HCLK")))
        } else {
            None
        }
    }
}

/// Power control.
#[derive(Debug)]
pub(super) struct Pwr {
    cr1: u32,
    cr3: u32,
    cr5: u32,
}

impl Default for Pwr {
    fn default() -> Self {
        Self {
            cr1: RANGE_1 << VOS_AT,
            cr3: CR3_AT_RESET,
            cr5: R1MODE,
        }
    }
}

impl Pwr {
    /// The supply of the core.
    pub(super) fn supply(&self) -> Supply {
        match (field(self.cr1, VOS_AT, VOS), self.cr5 & R1MODE) {
            (RANGE_2, _) => Supply::Range2,
            (_, 0) => Supply::Range1Boost,
            _ => Supply::Range1,
        }
    }
}

impl Peripheral for Pwr {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            CR1 => Ok(self.cr1),
            CR3 => Ok(self.cr3),
            CR5 => Ok(self.cr5),
            // VOSF is clear: the range does not change.
            SR2 => Ok(0),
            CR2 => Err(Refused::Unimplemented("CR2")),
            CR4 => Err(Refused::Unimplemented("CR4")),
            SR1 => Err(Refused::Unimplemented("SR1")),
            SCR => Ok(0),
            0x20..=0x54 => Err(Refused::Unimplemented("PUCRx/PDCRx")),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, _: Nanos) -> Result<(), Refused> {
        match offset {
            CR1 => {
                check_modelled("CR1", value, CR1_MODELLED)?;
                if !matches!(field(value, VOS_AT, VOS), RANGE_1 | RANGE_2) {
                    return Err(forbidden("CR1", "6.4.1: VOS is neither range 1 nor range 2"));
                }
                self.cr1 = value;
            }
            CR3 => {
                check_modelled("CR3", value, CR3_MODELLED)?;
                self.cr3 = value;
            }
            CR5 => self.cr5 = merge(self.cr5, value, R1MODE),
            CR2 => return Err(Refused::Unimplemented("CR2")),
            CR4 => return Err(Refused::Unimplemented("CR4")),
            SCR => return Err(Refused::Unimplemented("SCR")),
            0x20..=0x54 => return Err(Refused::Unimplemented("PUCRx/PDCRx")),
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
    fn boost_mode_is_only_bit_8_of_cr5() {
        let mut pwr = Pwr::default();
        assert_eq!((pwr.read(CR5, NOW), pwr.supply()), (Ok(R1MODE), Supply::Range1));
        pwr.write(CR5, 0x0000_0101, NOW).unwrap();
        assert_eq!((pwr.read(CR5, NOW), pwr.supply()), (Ok(R1MODE), Supply::Range1));
        pwr.write(CR5, 0, NOW).unwrap();
        assert_eq!(pwr.supply(), Supply::Range1Boost);
    }

    #[test]
    fn each_range_has_its_fastest_clock() {
        assert_eq!(Supply::Range1.fault(150_000_000, 4), None);
        assert!(
            Supply::Range1
                .fault(150_000_001, 4)
                .is_some_and(|(instance, _)| instance == "PWR")
        );
        assert_eq!(Supply::Range1Boost.fault(170_000_000, 4), None);
        assert!(Supply::Range1Boost.fault(170_000_001, 4).is_some());
        assert!(Supply::Range2.fault(26_000_001, 2).is_some());
    }

    #[test]
    fn each_clock_needs_its_wait_states() {
        assert!(
            Supply::Range1Boost
                .fault(160_000_000, 3)
                .is_some_and(|(instance, _)| instance == "FLASH")
        );
        assert_eq!(Supply::Range1Boost.fault(136_000_000, 3), None);
        assert!(Supply::Range1.fault(16_000_000, 0).is_none());
        assert!(Supply::Range2.fault(16_000_000, 0).is_some());
    }
}
