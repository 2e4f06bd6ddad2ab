//! TIM11 (RM0090, 19.5) as far as it measures the crystal (7.2.11): a counter of 16 bits that is captured at edges of the
//! crystal's clock, divided.
//!
//! | Behaviour | Section |
//! |---|---|
//! | The counter counts cycles of the timer clock up to ARR, once CEN is set | 19.5.1, 19.5.9 |
//! | TI1_RMP 10 makes the divided clock of the crystal the input; the core must run from HSI | 19.5.11, 7.2.11 |
//! | CC1S 01 and CC1E: CCR1 captures each first, second, fourth or eighth rising edge | 19.5.5, 19.5.6 |
//! | CC1IF at a capture, CC1OF at another one before it was cleared; reading CCR1 clears CC1IF | 19.5.4 |
//!
//! Anything else that is switched on is told: the firmware uses no more.

use std::sync::{Arc, Mutex};

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::Layout;
use rigless::soc::stm32f427::generated::tim11::{Register, cr1, sr};

use crate::crystal::{Divided, Oscillator};
use crate::shared::lock;
use crate::time::Nanos;

/// What the timer's clock is until the firmware sets the clock tree up: the internal oscillator (7.2.2).
const RESET_HZ: u64 = 16_000_000;

const SECOND: u128 = 1_000_000_000;

/// TI1_RMP of OR, and its value for the crystal's clock (19.5.11).
const INPUT: u64 = 0b11;
const HSE_RTC: u64 = 0b10;
/// CC1S of CCMR1 and its value for an input on TI1, IC1PSC, IC1F (19.5.5).
const CC1S: u64 = 0b11;
const TI1: u64 = 0b01;
const IC1PSC_AT: u32 = 2;
const IC1F: u64 = 0xF << 4;
/// CC1E of CCER, CC1P and CC1NP (19.5.6).
const CC1E: u64 = 1;
const FALLING: u64 = 0b1010;

/// The timer.
#[derive(Debug)]
pub(super) struct Capture {
    oscillator: Arc<Mutex<Oscillator>>,
    clock_hz: u64,
    /// When it began to count, if it does.
    counts_since: Option<Nanos>,
    /// CCMR1, whose two layouts have rows of their own.
    mode: u64,
    input: Option<Input>,
}

/// The crystal's clock at the input.
#[derive(Clone, Copy, Debug)]
struct Input {
    clock: Divided,
    /// How many of its edges come to a capture.
    prescaler: u32,
    /// When it was connected.
    since: Nanos,
    /// How many captures were since then.
    captures: u128,
}

impl Input {
    /// How many captures an input that was always there would have had by then.
    fn nth(&self, at: Nanos) -> u128 {
        u128::from(at.since(self.clock.since).0) * u128::from(self.clock.hertz) / self.period()
    }

    /// When that was.
    fn at(&self, nth: u128) -> Nanos {
        let after = (nth * self.period()).div_ceil(self.clock.hertz.max(1).into());
        self.clock.since + Nanos(after as u64)
    }

    /// Nanoseconds from one capture to the next, times the crystal's hertz.
    fn period(&self) -> u128 {
        u128::from(self.clock.divider) * u128::from(self.prescaler) * SECOND
    }
}

impl Capture {
    pub(super) fn new(oscillator: Arc<Mutex<Oscillator>>) -> Self {
        Self {
            oscillator,
            clock_hz: RESET_HZ,
            counts_since: None,
            mode: 0,
            input: None,
        }
    }

    /// The counter at an instant.
    fn count(&self, at: Nanos) -> u64 {
        let Some(since) = self.counts_since else {
            return 0;
        };
        (u128::from(at.since(since).0) * u128::from(self.clock_hz) / SECOND) as u16 as u64
    }

    /// Connects the crystal's clock if the registers say so.
    fn connect(&mut self, registers: &RegisterFile, now: Nanos) {
        let is_on = self.counts_since.is_some()
            && registers.get(Register::Or) & INPUT == HSE_RTC
            && self.mode & CC1S == TI1
            && registers.get(Register::Ccer) & CC1E != 0;
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

    /// Captures what there was to capture by now.
    fn follow(&mut self, registers: &mut RegisterFile, now: Nanos) {
        self.connect(registers, now);
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
        registers.set(Register::Ccr1, self.count(at));
        let mut status = registers.get(Register::Sr);
        if new > 1 || sr::CC1IF.is_set(status) {
            status = sr::CC1OF.set(status, 1);
        }
        registers.set(Register::Sr, sr::CC1IF.set(status, 1));
    }

    /// What is switched on that this does not do, or that the manual forbids.
    fn misuse(&self, register: Register, value: u64) -> Option<&'static str> {
        match register {
            Register::Cr1 if value & !cr1::CEN.mask() != 0 => Some("TIM11 is modelled counting up, without end"),
            Register::Dier if value != 0 => Some("TIM11 is modelled without interrupts"),
            Register::Psc if value != 0 => Some("TIM11 is modelled without its prescaler"),
            Register::Arr if value != u16::MAX.into() => Some("TIM11 is modelled with all of its 16 bits"),
            Register::Ccmr1Input | Register::Ccmr1Output if value & IC1F != 0 => {
                Some("TIM11 is modelled without its input filter")
            }
            Register::Ccer if value & FALLING != 0 => Some("TIM11 is modelled with rising edges"),
            Register::Ccer if value & CC1E != 0 && !lock(&self.oscillator).core_is_internal => {
                Some("7.2.11: to measure the crystal, the core must run from HSI")
            }
            _ => None,
        }
    }
}

impl Device for Capture {
    type Register = Register;

    fn read(
        &mut self,
        register: Register,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> Option<u64> {
        self.follow(registers, context.now().into());
        match register {
            Register::Cnt => Some(self.count(context.now().into())),
            Register::Ccr1 => {
                let status = registers.get(Register::Sr);
                registers.set(Register::Sr, sr::CC1IF.set(status, 0));
                Some(registers.get(Register::Ccr1))
            }
            _ => None,
        }
    }

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if let Some(reason) = self.misuse(register, value) {
            context.tell(register.spec().name, reason);
        }
        let now = Nanos::from(context.now());
        match register {
            Register::Cr1 if cr1::CEN.is_set(value) => {
                self.counts_since.get_or_insert(now);
            }
            Register::Cr1 => self.counts_since = None,
            Register::Ccmr1Input | Register::Ccmr1Output => self.mode = value,
            _ => {}
        }
        self.connect(registers, now);
    }

    fn on_clock(&mut self, hz: u64, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {
        self.clock_hz = hz;
    }

    fn reset(&mut self) {
        *self = Self::new(self.oscillator.clone());
    }

    fn reset_line(&mut self, _: &mut RegisterFile, _: &mut DeviceContext<'_>) {
        let clock_hz = self.clock_hz;
        self.reset();
        self.clock_hz = clock_hz;
    }
}
