//! A timer of one channel that measures the crystal: TIM11 of the STM32F405 (RM0090, 19.5 and 7.2.11), TIM16 of the
//! STM32G431 (RM0440, 31.8). A 16-bit counter is captured at edges of the crystal's divided clock.
//!
//! | Behaviour | RM0090 |
//! |---|---|
//! | The counter counts cycles of the timer clock up to ARR, once CEN is set | 19.5.1, 19.5.9 |
//! | The [`Selector`]s make the divided clock of the crystal the input; the core must run from HSI | 19.5.11, 7.2.11 |
//! | CC1S 01 and CC1E: CCR1 captures every, every second, fourth or eighth rising edge | 19.5.5, 19.5.6 |
//! | CC1IF at a capture, CC1OF at another one before it was cleared; reading CCR1 clears CC1IF | 19.5.4 |
//!
//! Any other use is refused with its name: the firmware needs no more.

use crate::crystal::{Divided, Oscillator};
use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, forbidden};
use crate::time::Nanos;

const CR1: u32 = 0x00;
const DIER: u32 = 0x0C;
const SR: u32 = 0x10;
const EGR: u32 = 0x14;
const CCMR1: u32 = 0x18;
const CCER: u32 = 0x20;
const CNT: u32 = 0x24;
const PSC: u32 = 0x28;
const ARR: u32 = 0x2C;
const CCR1: u32 = 0x34;

/// CEN of CR1 (19.5.1).
const CEN: u32 = 1;
/// Flags of SR (19.5.4).
const CC1IF: u32 = 1 << 1;
const CC1OF: u32 = 1 << 9;
/// CC1S of CCMR1 and its value for an input on TI1, IC1PSC (19.5.5).
const CC1S: u32 = 0b11;
const TI1: u32 = 0b01;
const IC1PSC_AT: u32 = 2;
const IC1PSC: u32 = 0b11 << IC1PSC_AT;
/// CC1E of CCER (19.5.6).
const CC1E: u32 = 1;

const SECOND: u128 = 1_000_000_000;
const ALL_BITS: u32 = 0xFFFF;

/// A field of a register that must have a value for the crystal's clock to be the input.
#[derive(Debug)]
pub(crate) struct Selector {
    /// The register's offset.
    pub(crate) offset: u32,
    /// The register's bits, all of them in the field.
    pub(crate) field: u32,
    pub(crate) value: u32,
}

/// Maximum number of selectors.
const SELECTORS: usize = 2;

/// The timer.
#[derive(Debug)]
pub(crate) struct Capture {
    selectors: &'static [Selector],
    oscillator: Shared<Oscillator>,
    clock_hz: u64,
    /// The start of the count, if it counts.
    counts_since: Option<Nanos>,
    status: u32,
    mode: u32,
    enable: u32,
    /// The registers of the selectors.
    selected: [u32; SELECTORS],
    captured: u32,
    input: Option<Input>,
}

/// The crystal's clock at the input.
#[derive(Clone, Copy, Debug)]
struct Input {
    clock: Divided,
    /// Number of its edges per capture.
    prescaler: u32,
    /// The time of its connection.
    since: Nanos,
    /// Number of captures since then.
    captures: u128,
}

impl Input {
    /// Number of captures that a permanent input would have had by then.
    fn nth(&self, at: Nanos) -> u128 {
        u128::from(at.since(self.clock.since).0) * u128::from(self.clock.hertz) / self.period()
    }

    /// The time of that capture.
    fn at(&self, nth: u128) -> Nanos {
        let after = (nth * self.period()).div_ceil(self.clock.hertz.max(1).into());
        self.clock.since + Nanos(after as u64)
    }

    /// Nanoseconds between captures, times the crystal's frequency in hertz.
    fn period(&self) -> u128 {
        u128::from(self.clock.divider) * u128::from(self.prescaler) * SECOND
    }
}

impl Capture {
    /// A timer with at most two selectors of its input.
    pub(crate) fn new(oscillator: Shared<Oscillator>, selectors: &'static [Selector]) -> Self {
        debug_assert!(selectors.len() <= SELECTORS);
        Self {
            selectors,
            oscillator,
            clock_hz: 0,
            counts_since: None,
            status: 0,
            mode: 0,
            enable: 0,
            selected: [0; SELECTORS],
            captured: 0,
            input: None,
        }
    }

    /// The rate of the input clock.
    pub(crate) fn set_clock(&mut self, hz: u64) {
        self.clock_hz = hz;
    }

    /// The counter at an instant.
    fn count(&self, at: Nanos) -> u32 {
        let Some(since) = self.counts_since else {
            return 0;
        };
        let cycles = u128::from(at.since(since).0) * u128::from(self.clock_hz) / SECOND;
        cycles as u32 & ALL_BITS
    }

    /// The selector of the register at `offset`, and its place.
    fn selector(&self, offset: u32) -> Option<(usize, &'static Selector)> {
        let mut selectors = self.selectors.iter().enumerate();
        selectors.find(|(_, selector)| selector.offset == offset)
    }

    fn is_selected(&self) -> bool {
        let mut selectors = self.selectors.iter().zip(self.selected);
        selectors.all(|(selector, selected)| selected == selector.value)
    }

    /// Connects the crystal's clock if the registers select it.
    fn connect(&mut self, now: Nanos) {
        let is_on =
            self.counts_since.is_some() && self.is_selected() && self.mode & CC1S == TI1 && self.enable & CC1E != 0;
        let clock = lock(&self.oscillator).divided.filter(|_| is_on);
        let prescaler = 1 << (self.mode >> IC1PSC_AT & 0b11);
        if self.input.map(|input| (input.clock, input.prescaler)) != clock.map(|clock| (clock, prescaler)) {
            self.input = clock.map(|clock| Input {
                clock,
                prescaler,
                since: now,
                captures: 0,
            });
        }
    }

    /// Executes the captures up to now.
    fn follow(&mut self, now: Nanos) {
        self.connect(now);
        let Some(input) = &mut self.input else {
            return;
        };
        let nth = input.nth(now);
        let captures = nth - input.nth(input.since);
        let new = captures - input.captures;
        if new == 0 {
            return;
        }
        input.captures = captures;
        let at = input.at(nth);
        self.captured = self.count(at);
        if new > 1 || self.status & CC1IF != 0 {
            self.status |= CC1OF;
        }
        self.status |= CC1IF;
    }

    fn write_enable(&mut self, value: u32) -> Result<(), Refused> {
        check_modelled("CCER: falling edges", value, CC1E)?;
        self.enable = value;
        if value & CC1E != 0 && !lock(&self.oscillator).core_is_internal {
            return Err(forbidden(
                "CCER",
                "7.2.11: to measure the crystal, the core must run from HSI",
            ));
        }
        Ok(())
    }
}

impl Peripheral for Capture {
    fn read(&mut self, offset: u32, now: Nanos) -> Result<u32, Refused> {
        self.follow(now);
        match offset {
            CR1 => Ok(if self.counts_since.is_some() { CEN } else { 0 }),
            DIER | EGR | PSC => Ok(0),
            SR => Ok(self.status),
            CCMR1 => Ok(self.mode),
            CCER => Ok(self.enable),
            CNT => Ok(self.count(now)),
            ARR => Ok(ALL_BITS),
            CCR1 => {
                self.status &= !CC1IF;
                Ok(self.captured)
            }
            _ => match self.selector(offset) {
                Some((place, _)) => Ok(self.selected[place]),
                None => Err(Refused::NoRegister),
            },
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        self.follow(now);
        match offset {
            CR1 if value & !CEN != 0 => return Err(Refused::Unimplemented("CR1")),
            CR1 if value & CEN == 0 => self.counts_since = None,
            CR1 => {
                self.counts_since.get_or_insert(now);
            }
            DIER if value != 0 => return Err(Refused::Unimplemented("DIER")),
            PSC if value != 0 => return Err(Refused::Unimplemented("PSC")),
            ARR if value != ALL_BITS => return Err(Refused::Unimplemented("ARR: less than 16 bits")),
            DIER | PSC | ARR => {}
            // A 0 clears, a 1 has no effect.
            SR => self.status &= value,
            CCMR1 if value & !(CC1S | IC1PSC) != 0 => return Err(Refused::Unimplemented("CCMR1")),
            CCMR1 => self.mode = value,
            CCER => {
                let written = self.write_enable(value);
                self.connect(now);
                return written;
            }
            EGR | CNT | CCR1 => return Err(Refused::Unimplemented("EGR/CNT/CCR1")),
            _ => match self.selector(offset) {
                Some((place, selector)) => self.selected[place] = value & selector.field,
                None => return Err(Refused::NoRegister),
            },
        }
        self.connect(now);
        Ok(())
    }

    /// Resets the timer, but not its clock.
    fn reset(&mut self, _: Nanos) {
        *self = Self {
            clock_hz: self.clock_hz,
            ..Self::new(self.oscillator.clone(), self.selectors)
        };
    }
}
