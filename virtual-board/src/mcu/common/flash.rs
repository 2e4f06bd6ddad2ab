//! The memory behind a flash interface: operations that take time, end with the power or with a reset, or go wrong.

use std::ops::Range;

use crate::core::Memory;
use crate::flash::{ERASED, Flash, erased_in_part, programmed_in_part};
use crate::shared::{Shared, lock};
use crate::time::Nanos;

/// Bytes of a word in [`Flash`].
pub(crate) const WORD: usize = 8;

/// An operation on words of the flash.
#[derive(Clone, Debug)]
pub(crate) enum Operation {
    Erase(Range<usize>),
    /// Bits that are clear here become clear.
    Program {
        word: usize,
        bits: u64,
    },
    /// The option bytes, which the interface keeps.
    Options,
}

impl Operation {
    /// The words that it changes.
    pub(crate) fn words(&self) -> Range<usize> {
        match self {
            Self::Erase(words) => words.clone(),
            Self::Program { word, .. } => *word..word + 1,
            Self::Options => 0..0,
        }
    }
}

/// An operation that is under way.
#[derive(Clone, Debug)]
struct Started {
    operation: Operation,
    since: Nanos,
    ends: Nanos,
}

/// The memory, and the operation that is under way.
#[derive(Clone, Debug)]
pub(crate) struct Array {
    flash: Shared<Flash>,
    started: Option<Started>,
    /// When the power goes.
    cut: Option<Nanos>,
}

impl Array {
    pub(crate) fn new(flash: Shared<Flash>) -> Self {
        Self {
            flash,
            started: None,
            cut: None,
        }
    }

    /// The supply, in millivolts.
    pub(crate) fn millivolts(&self) -> u32 {
        lock(&self.flash).millivolts
    }

    /// The content of a word.
    pub(crate) fn word(&self, word: usize) -> u64 {
        u64::from_le_bytes(lock(&self.flash).get(word))
    }

    /// Starts an operation that takes from the typical to the longest time. `what` names its draws.
    pub(crate) fn start(
        &mut self,
        operation: Operation,
        what: &'static str,
        (typical, worst): (Nanos, Nanos),
        now: Nanos,
    ) {
        let mut flash = lock(&self.flash);
        let ends = now + flash.clock.span(what, typical, worst);
        self.cut = flash.start(typical).map(|after| now + after);
        self.started = Some(Started {
            operation,
            since: now,
            ends,
        });
    }

    /// Whether an operation is under way.
    #[inline]
    pub(crate) fn is_busy(&self) -> bool {
        self.started.is_some()
    }

    /// Whether the power is to go now.
    pub(crate) fn take_cut(&mut self, now: Nanos) -> bool {
        self.cut.take_if(|at| *at <= now).is_some()
    }

    /// Takes the operation that ends now. Its words are still to be changed.
    pub(crate) fn take_ended(&mut self, now: Nanos) -> Option<Operation> {
        let Started { operation, since, .. } = self.started.take_if(|started| started.ends <= now)?;
        if matches!(operation, Operation::Erase(_)) {
            lock(&self.flash).erases.push((since, now));
        }
        Some(operation)
    }

    /// Leaves the operation that is under way half done, and returns it.
    pub(crate) fn interrupt(&mut self, memory: &mut Memory) -> Option<Operation> {
        self.cut = None;
        let Started { operation, .. } = self.started.take()?;
        self.half_do(&operation, memory);
        Some(operation)
    }

    /// Changes the words of an operation.
    pub(crate) fn complete(&self, operation: &Operation, memory: &mut Memory) {
        self.change(operation.words(), memory, |old, _| match operation {
            Operation::Program { bits, .. } => old & bits,
            _ => u64::from_le_bytes([ERASED; WORD]),
        });
    }

    /// Changes the words of an operation in part.
    pub(crate) fn half_do(&self, operation: &Operation, memory: &mut Memory) {
        self.change(operation.words(), memory, |old, chance| match operation {
            Operation::Program { bits, .. } => programmed_in_part(old, *bits, chance),
            _ => erased_in_part(old, chance),
        });
    }

    /// Changes words, given what each held and a chance.
    fn change(&self, words: Range<usize>, memory: &mut Memory, new: impl Fn(u64, u64) -> u64) {
        let mut flash = lock(&self.flash);
        for word in words {
            let old = u64::from_le_bytes(flash.get(word));
            let new = new(old, flash.chance(word));
            if new != old {
                flash.set(word, new.to_le_bytes());
                memory.program(word * WORD, &new.to_le_bytes());
            }
        }
    }

    /// When the operation ends, or the power goes.
    pub(crate) fn due(&self) -> Option<Nanos> {
        let ends = self.started.as_ref().map(|started| started.ends);
        [ends, self.cut].into_iter().flatten().min()
    }
}
