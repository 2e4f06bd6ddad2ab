//! A 32-bit general-purpose timer of an STM32 that counts up (RM0440, chapter 30; RM0090, chapter 18).
//!
//! Modelled are the counter with its prescaler and auto-reload, updates, and the four channels as output compare
//! without a pin. Other modes are refused with their name: counting down, one pulse, slave mode, input capture, DMA
//! requests.

use crate::soc::clock::Clock;
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::time::Nanos;

const CR1: u32 = 0x00;
const CR2: u32 = 0x04;
const SMCR: u32 = 0x08;
const DIER: u32 = 0x0C;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCMR2: u32 = 0x1C;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2C;
const CCR1: u32 = 0x34;
const CCR2: u32 = 0x38;
const CCR3: u32 = 0x3C;
const CCR4: u32 = 0x40;

/// Bits of CR1 (30.5.1).
mod cr1 {
    pub(super) const CEN: u32 = 1;
    pub(super) const UDIS: u32 = 1 << 1;
    pub(super) const URS: u32 = 1 << 2;
    pub(super) const ARPE: u32 = 1 << 7;
    /// The modelled bits.
    pub(super) const MODELLED: u32 = CEN | UDIS | URS | ARPE;
}

/// UIE and CC1IE to CC4IE of DIER, UIF and CC1IF to CC4IF of SR, UG and CC1G to CC4G of EGR (30.5.4 to 30.5.6).
const UPDATE: u32 = 1;
const CHANNELS: usize = 4;
const INTERRUPTS: u32 = 0b1_1111;

const fn compare_flag(channel: usize) -> u32 {
    1 << (channel + 1)
}

const PRESCALER: u32 = 0xFFFF;

/// The timer.
#[derive(Clone, Debug)]
pub(crate) struct Tim {
    /// The input clock of the prescaler.
    clock: Clock,
    cr1: u32,
    dier: u32,
    sr: u32,
    /// PSC, and the active prescaler, which is loaded from PSC at an update.
    psc: u32,
    prescaler: u32,
    arr: u32,
    /// The active auto-reload value.
    reload: u32,
    ccr: [u32; CHANNELS],
    /// The count at the input clock's tick `since`. It is constant while the timer is off.
    count: u64,
    since: u64,
    /// The count that was last checked for events. It is not reduced by the reload value.
    seen: u64,
}

impl Tim {
    /// A timer without a clock.
    pub(crate) fn new() -> Self {
        Self {
            clock: Clock::new(0, Nanos(0), 0),
            cr1: 0,
            dier: 0,
            sr: 0,
            psc: 0,
            prescaler: 0,
            arr: u32::MAX,
            reload: u32::MAX,
            ccr: [0; CHANNELS],
            count: 0,
            since: 0,
            seen: 0,
        }
    }

    /// The rate of the input clock is `hz` from now on.
    pub(crate) fn set_clock(&mut self, hz: u64, now: Nanos) {
        if hz != self.clock.hz() {
            self.count_up_to(now);
            self.clock.set_hz(hz, now);
        }
    }

    /// The level of the interrupt line.
    pub(crate) fn interrupts(&self) -> bool {
        self.sr & self.dier & INTERRUPTS != 0
    }

    fn runs(&self) -> bool {
        self.cr1 & cr1::CEN != 0
    }

    /// Input ticks per count, and counts per turn.
    fn step(&self) -> u64 {
        u64::from(self.prescaler) + 1
    }

    fn turn(&self) -> u64 {
        u64::from(self.reload) + 1
    }

    /// The count, not reduced by the reload value.
    fn total(&self, now: Nanos) -> u64 {
        if !self.runs() {
            return self.count;
        }
        self.count + (self.clock.tick(now) - self.since) / self.step()
    }

    /// The first total after `total` at which the counter is `value`.
    fn next_at(&self, total: u64, value: u64) -> u64 {
        let turn = self.turn();
        let count = total % turn;
        if value > count {
            total + value - count
        } else {
            total + turn - count + value
        }
    }

    /// Sets the flags of events up to now.
    fn count_up_to(&mut self, now: Nanos) {
        let total = self.total(now);
        if total == self.seen {
            return;
        }
        for channel in 0..CHANNELS {
            if self.ccr[channel] <= self.reload && self.next_at(self.seen, self.ccr[channel].into()) <= total {
                self.sr |= compare_flag(channel);
            }
        }
        if self.next_at(self.seen, 0) <= total && self.cr1 & cr1::UDIS == 0 {
            self.sr |= UPDATE;
            self.prescaler = self.psc;
            self.reload = self.arr;
        }
        self.seen = total;
    }

    /// Restarts the computation at the present count, with the same phase of the prescaler.
    fn rebase(&mut self, now: Nanos) {
        self.count_up_to(now);
        let tick = self.clock.tick(now);
        let phase = if self.runs() {
            (tick - self.since) % self.step()
        } else {
            0
        };
        self.count = self.seen % self.turn();
        self.seen = self.count;
        self.since = tick - phase;
        self.clock.come_near(now);
    }

    /// Sets the counter to `count` and restarts the prescaler.
    fn set_count(&mut self, count: u64, now: Nanos) {
        self.count = count;
        self.seen = count;
        self.since = self.clock.tick(now);
    }

    /// An update by software (30.5.6).
    fn generate_update(&mut self, now: Nanos) {
        self.prescaler = self.psc;
        self.reload = self.arr;
        self.set_count(0, now);
        if self.cr1 & (cr1::URS | cr1::UDIS) == 0 {
            self.sr |= UPDATE;
        }
    }
}

/// The channel of CCR1 to CCR4.
fn channel(offset: u32) -> usize {
    ((offset - CCR1) / 4) as usize
}

/// A register with no model of modes other than 0.
fn only_zero(register: &'static str, value: u32) -> Result<(), Refused> {
    if value == 0 {
        Ok(())
    } else {
        Err(Refused::Unimplemented(register))
    }
}

impl Peripheral for Tim {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        match offset {
            CR1 => Ok(self.cr1),
            CR2 | SMCR | EGR | CCMR1 | CCMR2 | CCER => Ok(0),
            DIER => Ok(self.dier),
            SR => {
                self.count_up_to(now);
                Ok(self.sr)
            }
            CNT => Ok((self.total(now) % self.turn()) as u32),
            PSC => Ok(self.psc),
            ARR => Ok(self.arr),
            CCR1 | CCR2 | CCR3 | CCR4 => Ok(self.ccr[channel(offset)]),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        self.rebase(now);
        match offset {
            CR1 => {
                only_zero("CR1", value & !cr1::MODELLED)?;
                self.cr1 = value;
            }
            CR2 => only_zero("CR2", value)?,
            SMCR => only_zero("SMCR", value)?,
            DIER => {
                only_zero("DIER", value & !INTERRUPTS)?;
                self.dier = value;
            }
            // A 0 clears, a 1 has no effect.
            SR => self.sr &= value,
            EGR => {
                self.sr |= value & INTERRUPTS & !UPDATE;
                if value & UPDATE != 0 {
                    self.generate_update(now);
                }
            }
            CCMR1 => only_zero("CCMR1", value)?,
            CCMR2 => only_zero("CCMR2", value)?,
            CCER => only_zero("CCER", value)?,
            CNT if u64::from(value) >= self.turn() => {
                return Err(forbidden("CNT", "30.4.3: above the auto-reload value"));
            }
            CNT => self.set_count(value.into(), now),
            PSC => self.psc = value & PRESCALER,
            ARR => {
                self.arr = value;
                if self.cr1 & cr1::ARPE == 0 {
                    self.reload = value;
                }
            }
            CCR1 | CCR2 | CCR3 | CCR4 => self.ccr[channel(offset)] = value,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn advance(&mut self, now: Nanos) {
        self.count_up_to(now);
    }

    /// The time of the next enabled interrupt that is not pending.
    fn due(&self) -> Option<Nanos> {
        let wanted = self.dier & !self.sr & INTERRUPTS;
        if wanted == 0 || !self.runs() {
            return None;
        }
        let update = (wanted & UPDATE != 0).then_some(0);
        let compares = (0..CHANNELS)
            .filter(|&channel| wanted & compare_flag(channel) != 0 && self.ccr[channel] <= self.reload)
            .map(|channel| self.ccr[channel].into());
        let total = update
            .into_iter()
            .chain(compares)
            .map(|value| self.next_at(self.seen, value))
            .min()?;
        self.clock.instant(self.since + (total - self.count) * self.step())
    }

    /// Resets the timer, but not its clock.
    fn reset(&mut self, now: Nanos) {
        let hz = self.clock.hz();
        *self = Self::new();
        self.clock.set_hz(hz, now);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MICROSECOND: u64 = 1_000;

    /// A timer that counts microseconds from 160 MHz, like a firmware clock.
    fn microseconds() -> Tim {
        let mut tim = Tim::new();
        tim.set_clock(160_000_000, Nanos(0));
        tim.write(PSC, 159, Nanos(0)).unwrap();
        tim.write(CR1, cr1::URS, Nanos(0)).unwrap();
        tim.write(EGR, UPDATE, Nanos(0)).unwrap();
        tim.write(CR1, cr1::URS | cr1::CEN, Nanos(0)).unwrap();
        tim
    }

    fn at(micros: u64) -> Nanos {
        Nanos(micros * MICROSECOND)
    }

    #[test]
    fn counter_counts_prescaled_ticks() {
        let mut tim = microseconds();
        assert_eq!(tim.read(CNT, Nanos(999)), Ok(0));
        assert_eq!(tim.read(CNT, at(1)), Ok(1));
        assert_eq!(
            tim.read(CNT, at(86_400_000_000)),
            Ok((86_400_000_000 % (1_u64 << 32)) as u32)
        );
    }

    #[test]
    fn compare_match_sets_its_flag_and_interrupts() {
        let mut tim = microseconds();
        tim.write(CCR2, 50, at(10)).unwrap();
        tim.write(DIER, compare_flag(1), at(10)).unwrap();
        assert_eq!(tim.due(), Some(at(50)));
        tim.advance(at(49));
        assert!(!tim.interrupts());
        tim.advance(at(50));
        assert!(tim.interrupts());
        assert_eq!(tim.read(SR, at(50)), Ok(compare_flag(1)));
        tim.write(SR, !compare_flag(1), at(51)).unwrap();
        assert!(!tim.interrupts());
    }

    #[test]
    fn turn_of_the_counter_is_an_update() {
        let mut tim = microseconds();
        tim.write(CNT, u32::MAX - 9, at(0)).unwrap();
        tim.write(SR, 0, at(0)).unwrap();
        tim.write(DIER, UPDATE, at(0)).unwrap();
        assert_eq!(tim.due(), Some(at(10)));
        tim.advance(at(10));
        assert_eq!(
            (tim.read(SR, at(10)), tim.read(CNT, at(12))),
            (Ok(UPDATE | compare_flag(0) | 0b11100), Ok(2))
        );
    }

    #[test]
    fn update_by_software_is_silent_with_urs() {
        let mut tim = microseconds();
        assert_eq!(tim.read(SR, at(0)), Ok(0));
        tim.write(CR1, cr1::CEN, at(5)).unwrap();
        tim.write(EGR, UPDATE, at(5)).unwrap();
        assert_eq!((tim.read(SR, at(5)), tim.read(CNT, at(7))), (Ok(UPDATE), Ok(2)));
    }

    #[test]
    fn writes_keep_the_phase_of_the_prescaler() {
        let mut tim = microseconds();
        for step in 0..100 {
            tim.write(CCR1, step, Nanos(u64::from(step) * 637)).unwrap();
        }
        assert_eq!(tim.read(CNT, Nanos(99_999)), Ok(99));
        assert_eq!(tim.read(CNT, at(100)), Ok(100));
    }

    #[test]
    fn modes_without_a_model_are_refused_by_name() {
        let mut tim = microseconds();
        assert_eq!(tim.write(CCMR1, 1, at(0)), Err(Refused::Unimplemented("CCMR1")));
        assert_eq!(tim.write(CR1, 1 << 4, at(0)), Err(Refused::Unimplemented("CR1")));
    }
}
