//! The flash, a W25Q16JV, behind the functions of the boot ROM: sectors are erased and pages are programmed one by one.
//! A reset of the chip does not reach it; a loss of power leaves an operation half done.

use std::collections::VecDeque;

use super::messages::Commands;
use crate::flash::{ERASED, Flash, erased_in_part, programmed_in_part};
use crate::shared::{Shared, lock};
use crate::time::Nanos;

/// Bytes of a sector and of a page (W25Q16JV, 6).
const SECTOR: usize = 4096;
const PAGE: usize = 256;

/// Duration of an erase and of a programming, typical and maximum (W25Q16JV, 9.6).
const ERASE: [Nanos; 2] = [Nanos::from_millis(45), Nanos::from_millis(400)];
const PROGRAM: [Nanos; 2] = [Nanos(400_000), Nanos::from_millis(3)];

/// Bytes of a word in [`Flash`].
const WORD: usize = 8;

/// An operation on bytes of the flash.
#[derive(Debug)]
enum Operation {
    Erase {
        from: usize,
    },
    /// Bits that are clear in the new bytes become clear.
    Program {
        to: usize,
        bytes: Vec<u8>,
    },
}

/// An operation in progress.
#[derive(Debug)]
struct Started {
    operation: Operation,
    since: Nanos,
    ends: Nanos,
}

#[derive(Debug)]
pub(super) struct Array {
    flash: Shared<Flash>,
    waiting: VecDeque<Operation>,
    started: Option<Started>,
    /// Time of the loss of power.
    cut: Option<Nanos>,
}

impl Array {
    pub(super) fn new(flash: Shared<Flash>) -> Self {
        Self {
            flash,
            waiting: VecDeque::new(),
            started: None,
            cut: None,
        }
    }

    /// Takes a request of the program, for the supply or none.
    pub(super) fn take_supply(&self) -> Option<bool> {
        lock(&self.flash).supply.take()
    }

    /// Erases sectors.
    pub(super) fn erase(&mut self, from: usize, length: usize, now: Nanos, commands: &mut Commands) {
        let sectors = (from..from + length).step_by(SECTOR);
        self.waiting.extend(sectors.map(|from| Operation::Erase { from }));
        self.start_next(now, commands);
    }

    /// Programs pages.
    pub(super) fn program(&mut self, to: usize, bytes: &[u8], now: Nanos, commands: &mut Commands) {
        let pages = bytes.chunks(PAGE).zip(0..).map(|(page, nth)| Operation::Program {
            to: to + nth * PAGE,
            bytes: page.to_vec(),
        });
        self.waiting.extend(pages);
        self.start_next(now, commands);
    }

    fn start_next(&mut self, now: Nanos, commands: &mut Commands) {
        let Some(operation) = self.waiting.pop_front() else {
            return commands.flash_done();
        };
        let (what, [typical, worst]) = match operation {
            Operation::Erase { .. } => ("erase", ERASE),
            Operation::Program { .. } => ("program", PROGRAM),
        };
        let mut flash = lock(&self.flash);
        let ends = now + flash.clock.span(what, typical, worst);
        self.cut = flash.start(typical).map(|after| now + after);
        self.started = Some(Started {
            operation,
            since: now,
            ends,
        });
    }

    /// Completes the due operation, or leaves it half done at a loss of power. Returns true for the latter.
    pub(super) fn advance(&mut self, now: Nanos, commands: &mut Commands) -> bool {
        if self.cut.is_some_and(|at| at <= now) {
            self.power_off(commands);
            lock(&self.flash).cut = Some(now);
            return true;
        }
        if let Some(started) = self.started.take_if(|started| started.ends <= now) {
            if let Operation::Erase { .. } = started.operation {
                lock(&self.flash).erases.push((started.since, now));
            }
            self.complete(&started.operation, commands);
            self.start_next(now, commands);
        }
        false
    }

    /// The end of the operation, or the loss of power.
    pub(super) fn due(&self) -> Option<Nanos> {
        let ends = self.started.as_ref().map(|started| started.ends);
        [ends, self.cut].into_iter().flatten().min()
    }

    /// Leaves the operation in progress half done.
    pub(super) fn power_off(&mut self, commands: &mut Commands) {
        self.cut = None;
        self.waiting.clear();
        if let Some(Started { operation, .. }) = self.started.take() {
            self.change(&operation, commands, |old, new, chance| match operation {
                Operation::Erase { .. } => erased_in_part(old, chance),
                Operation::Program { .. } => programmed_in_part(old, new, chance),
            });
        }
    }

    /// The chip is reset: the operation in progress goes on without it, and the others are not started.
    pub(super) fn restart(&mut self, commands: &mut Commands) {
        self.cut = None;
        self.waiting.clear();
        if let Some(Started { operation, .. }) = self.started.take() {
            self.complete(&operation, commands);
        }
    }

    fn complete(&self, operation: &Operation, commands: &mut Commands) {
        self.change(operation, commands, |_, new, _| new);
    }

    /// Changes the words of an operation by a function of their old content, the content after the operation, and random
    /// bits.
    fn change(&self, operation: &Operation, commands: &mut Commands, result: impl Fn(u64, u64, u64) -> u64) {
        let mut flash = lock(&self.flash);
        let (at, bytes) = match operation {
            Operation::Erase { from } => (*from, &[ERASED; SECTOR][..]),
            Operation::Program { to, bytes } => (*to, &bytes[..]),
        };
        for (word, bytes) in (at / WORD..).zip(bytes.as_chunks::<WORD>().0) {
            let old = u64::from_le_bytes(flash.get(word));
            let new = match operation {
                Operation::Erase { .. } => u64::MAX,
                Operation::Program { .. } => old & u64::from_le_bytes(*bytes),
            };
            let changed = result(old, new, flash.chance(word));
            flash.set(word, changed.to_le_bytes());
        }
        if let Some(changed) = flash.bytes().get(at..at + bytes.len()) {
            commands.flash(at, changed);
        }
    }
}
