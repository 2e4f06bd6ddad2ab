//! Faults that are in effect, or wait for an answer.

use std::collections::{BTreeMap, BTreeSet};

use armwire::time::Duration;

use super::order::Order;

/// What becomes of one answer.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Fate {
    pub(super) late: Option<Duration>,
    pub(super) brownout: Option<Duration>,
    pub(super) is_damaged: bool,
    pub(super) is_twice: bool,
}

/// The faults of a bus. Servos are counted from the arm's base, whatever their ids become.
#[derive(Debug, Default)]
pub(super) struct Faults {
    /// Orders that wait for an answer, with the number of answers before it.
    waiting: Vec<(u32, Order)>,
    silent: BTreeSet<usize>,
    unplugged: BTreeSet<usize>,
    errors: BTreeMap<usize, u8>,
    pub(super) echoes: bool,
}

impl Faults {
    /// Takes a fault of the bus. Orders to a servo are not among them.
    pub(super) fn add(&mut self, order: Order) {
        match order {
            Order::Late { answer, .. }
            | Order::Damaged { answer }
            | Order::Twice { answer }
            | Order::Brownout { answer, .. } => self.waiting.push((answer.saturating_sub(1), order)),
            Order::Echo => self.echoes = true,
            Order::Clear => *self = Self::default(),
            _ => {}
        }
    }

    pub(super) fn silence(&mut self, servo: usize) {
        self.silent.insert(servo);
    }

    pub(super) fn unplug(&mut self, servo: usize) {
        self.unplugged.insert(servo);
    }

    pub(super) fn set_errors(&mut self, servo: usize, bits: u8) {
        self.errors.insert(servo, bits);
    }

    pub(super) fn is_silent(&self, servo: usize) -> bool {
        self.silent.contains(&servo)
    }

    /// Returns true if the servo has a supply: its cable leads past those before it.
    pub(super) fn is_supplied(&self, servo: usize) -> bool {
        self.unplugged.first().is_none_or(|first| servo < *first)
    }

    pub(super) fn errors(&self, servo: usize) -> u8 {
        self.errors.get(&servo).copied().unwrap_or(0)
    }

    /// The fate of the next answer.
    pub(super) fn next(&mut self) -> Fate {
        let mut fate = Fate::default();
        self.waiting.retain_mut(|(before, order)| {
            if *before > 0 {
                *before -= 1;
                return true;
            }
            match *order {
                Order::Late { by, .. } => fate.late = fate.late.max(Some(by)),
                Order::Brownout { time, .. } => fate.brownout = fate.brownout.max(Some(time)),
                Order::Damaged { .. } => fate.is_damaged = true,
                _ => fate.is_twice = true,
            }
            false
        });
        fate
    }
}
