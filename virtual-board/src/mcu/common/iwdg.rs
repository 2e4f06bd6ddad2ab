//! The independent watchdog of an STM32 (RM0440, chapter 42; RM0090, chapter 21).
//!
//! The window of the G4 is not modelled: a WINR that enables it is refused.

use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::time::Nanos;

const KR: u32 = 0x00;
const PR: u32 = 0x04;
const RLR: u32 = 0x08;
const SR: u32 = 0x0C;
const WINR: u32 = 0x10;

/// Keys (42.4.1).
const ACCESS: u32 = 0x5555;
const RELOAD: u32 = 0xAAAA;
const START: u32 = 0xCCCC;
const KEY: u32 = 0xFFFF;

/// Bits of SR (42.4.4).
const PVU: u32 = 1;
const RVU: u32 = 1 << 1;

/// The largest prescaler divides by 256, as 6 and 7 (42.4.2).
const PRESCALER: u32 = 0b111;
const WIDEST: u32 = 6;
const RELOAD_VALUE: u32 = 0xFFF;

/// Cycles of the oscillator for a new PR or RLR to cross into its clock domain: up to 5 (42.4.2, 42.4.3).
const CROSSING: u64 = 5;

/// A value that crosses from the bus's clock domain to the watchdog's.
#[derive(Clone, Copy, Debug)]
struct Crossing {
    value: u32,
    /// Time at which the watchdog has the written value.
    until: Nanos,
}

/// The watchdog.
#[derive(Clone, Debug)]
pub(crate) struct Iwdg {
    has_window: bool,
    /// The frequency of its oscillator, LSI.
    hz: u32,
    unlocked: bool,
    prescaler: Crossing,
    reload: Crossing,
    /// Time of the reset of the chip, once started.
    expires: Option<Nanos>,
    expired: bool,
}

impl Iwdg {
    /// A watchdog with or without WINR, whose oscillator has this frequency in hertz.
    pub(crate) fn new(has_window: bool, hz: u32) -> Self {
        let settled = |value| Crossing { value, until: Nanos(0) };
        Self {
            has_window,
            hz,
            unlocked: false,
            prescaler: settled(0),
            reload: settled(RELOAD_VALUE),
            expires: None,
            expired: false,
        }
    }

    /// Returns true once it has been started, which turns the low-speed oscillator on.
    pub(crate) fn runs(&self) -> bool {
        self.expires.is_some()
    }

    /// Returns true if it resets the chip now.
    pub(crate) fn take_expired(&mut self) -> bool {
        std::mem::take(&mut self.expired)
    }

    /// Time from a reload to the reset.
    fn period(&self) -> Nanos {
        let divider = 4 << self.prescaler.value.min(WIDEST);
        let cycles = (u64::from(self.reload.value) + 1) * divider;
        Nanos(cycles * 1_000_000_000 / u64::from(self.hz))
    }

    fn restart_count(&mut self, now: Nanos) {
        self.expires = Some(now + self.period());
    }

    /// A new value for a register that crosses into the other clock domain.
    fn cross(&self, register: &'static str, old: Crossing, value: u32, now: Nanos) -> Result<Crossing, Refused> {
        if !self.unlocked {
            return Err(forbidden(register, "42.3.3: written without the key 0x5555"));
        }
        if now < old.until {
            return Err(forbidden(register, "42.4.4: written before the last value has arrived"));
        }
        let until = now + Nanos(CROSSING * 1_000_000_000 / u64::from(self.hz));
        Ok(Crossing { value, until })
    }
}

impl Peripheral for Iwdg {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        let flag = |crossing: Crossing, bit| if now < crossing.until { bit } else { 0 };
        match offset {
            KR => Ok(0),
            PR => Ok(self.prescaler.value),
            RLR => Ok(self.reload.value),
            SR => Ok(flag(self.prescaler, PVU) | flag(self.reload, RVU)),
            WINR if self.has_window => Ok(RELOAD_VALUE),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        match offset {
            KR => {
                let key = value & KEY;
                self.unlocked = key == ACCESS;
                match key {
                    START => self.restart_count(now),
                    RELOAD if self.runs() => self.restart_count(now),
                    _ => {}
                }
            }
            PR => self.prescaler = self.cross("PR", self.prescaler, value & PRESCALER, now)?,
            RLR => self.reload = self.cross("RLR", self.reload, value & RELOAD_VALUE, now)?,
            SR => {}
            WINR if self.has_window && value & RELOAD_VALUE == RELOAD_VALUE => {}
            WINR if self.has_window => return Err(Refused::Unimplemented("WINR")),
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        if self.expires.is_some_and(|at| at <= now) {
            self.expires = None;
            self.expired = true;
        }
    }

    fn due(&self) -> Option<Nanos> {
        self.expires
    }

    fn reset(&mut self, _: Nanos) {
        *self = Self::new(self.has_window, self.hz);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::crystal::LSI_HZ;

    const MILLISECOND: u64 = 1_000_000;

    #[test]
    fn unfed_watchdog_expires_after_its_period() {
        let mut iwdg = Iwdg::new(true, LSI_HZ);
        iwdg.write(KR, ACCESS, Nanos(0)).unwrap();
        iwdg.write(PR, 3, Nanos(0)).unwrap();
        iwdg.write(RLR, 999, Nanos(0)).unwrap();
        assert_eq!(iwdg.due(), None);
        iwdg.write(KR, START, Nanos(MILLISECOND)).unwrap();
        // 1000 counts of 32 cycles at 32 kHz.
        assert_eq!(iwdg.due(), Some(Nanos(1_001 * MILLISECOND)));
        iwdg.write(KR, RELOAD, Nanos(500 * MILLISECOND)).unwrap();
        assert_eq!(iwdg.due(), Some(Nanos(1_500 * MILLISECOND)));
        iwdg.advance(Nanos(1_500 * MILLISECOND));
        assert!(iwdg.take_expired());
    }

    #[test]
    fn faster_oscillator_shortens_the_period() {
        for (hz, micros) in [(17_000, 481_882), (32_000, 256_000), (47_000, 174_297)] {
            let mut iwdg = Iwdg::new(false, hz);
            iwdg.write(KR, ACCESS, Nanos(0)).unwrap();
            iwdg.write(RLR, 2_047, Nanos(0)).unwrap();
            iwdg.write(KR, START, Nanos(0)).unwrap();
            assert_eq!(iwdg.due().unwrap().0 / 1_000, micros, "{hz} Hz");
        }
    }

    #[test]
    fn key_other_than_access_locks_the_registers() {
        let mut iwdg = Iwdg::new(true, LSI_HZ);
        assert!(iwdg.write(PR, 3, Nanos(0)).is_err());
        iwdg.write(KR, ACCESS, Nanos(0)).unwrap();
        iwdg.write(KR, RELOAD, Nanos(0)).unwrap();
        assert!(iwdg.write(RLR, 3, Nanos(0)).is_err());
        assert_eq!(iwdg.read(RLR, Nanos(0)), Ok(0xFFF));
    }

    #[test]
    fn new_value_takes_its_time_to_arrive() {
        let mut iwdg = Iwdg::new(true, LSI_HZ);
        iwdg.write(KR, ACCESS, Nanos(0)).unwrap();
        iwdg.write(PR, 3, Nanos(0)).unwrap();
        assert_eq!(iwdg.read(SR, Nanos(1)), Ok(PVU));
        assert!(iwdg.write(PR, 4, Nanos(1)).is_err());
        assert_eq!(iwdg.read(SR, Nanos(200_000)), Ok(0));
        assert_eq!(iwdg.write(PR, 4, Nanos(200_000)), Ok(()));
    }
}
