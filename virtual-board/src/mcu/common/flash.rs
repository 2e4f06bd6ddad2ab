//! The memory behind a flash interface: operations take time, end at a loss of power or a reset, or fail.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::core::{FlashTiming, Memory, Width};
use crate::flash::{ERASED, Flash, erased_in_part, programmed_in_part};
use crate::shared::{Shared, lock};
use crate::soc::peripheral::{Peripheral, Refused, forbidden};
use crate::time::Nanos;

/// Bytes of a word in [`Flash`].
pub(crate) const WORD: usize = 8;

/// Bits of ACR at the same place in both chips.
pub(crate) mod acr {
    pub(crate) const PRFTEN: u32 = 1 << 8;
    pub(crate) const ICEN: u32 = 1 << 9;
    pub(crate) const DCEN: u32 = 1 << 10;
    pub(crate) const ICRST: u32 = 1 << 11;
    pub(crate) const DCRST: u32 = 1 << 12;
}

/// Bytes of a line, and lines of the instruction and of the data cache.
pub(crate) struct Caches {
    pub(crate) line: u32,
    pub(crate) code: usize,
    pub(crate) data: usize,
}

impl Caches {
    /// The timing by this value of ACR, with its number of wait states.
    pub(crate) fn timing(&self, acr: u32, wait_states: u32) -> FlashTiming {
        let lines = |enable, count, otherwise| if acr & enable != 0 { count } else { otherwise };
        FlashTiming {
            wait_states,
            line_bytes: self.line,
            code_lines: lines(acr::ICEN, self.code, 1),
            data_lines: lines(acr::DCEN, self.data, 0),
            prefetch: acr & acr::PRFTEN != 0,
        }
    }
}

/// The content of the data cache where it differs from the flash.
///
/// An erase does not change the cache (RM0090 3.6.4, RM0440 5.3.7), a write changes both. This cache is the worst one: while
/// it is enabled it takes each word, and it replaces none. A reset of the chip empties it.
#[derive(Clone, Debug, Default)]
struct DataCache {
    enabled: bool,
    /// True if it may hold words: it has been enabled since it was emptied.
    filled: bool,
    /// The words that an erase has changed in the flash, as the cache has them.
    stale: BTreeMap<usize, u64>,
}

impl DataCache {
    fn enable(&mut self, enabled: bool) {
        self.enabled = enabled;
        self.filled |= enabled;
    }

    /// Follows the change of a word in the flash by a function of its old content.
    fn follow(&mut self, operation: &Operation, word: usize, old: u64, new: impl Fn(u64) -> u64) {
        match operation {
            Operation::Erase(_) if self.filled => {
                self.stale.entry(word).or_insert(old);
            }
            Operation::Program { .. } => {
                if let Some(cached) = self.stale.get_mut(&word) {
                    *cached = new(*cached);
                }
            }
            Operation::Erase(_) | Operation::Options => {}
        }
    }
}

/// The keys of KEYR.
pub(crate) const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// The progress of an unlock sequence.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Keys {
    None,
    First,
    Unlocked,
    /// A wrong key was written: the register stays locked until the next reset.
    Wrong,
}

impl Keys {
    pub(crate) fn take(self, key: u32, keys: [u32; 2]) -> Self {
        match self {
            Self::Unlocked => Self::Unlocked,
            Self::None if key == keys[0] => Self::First,
            Self::First if key == keys[1] => Self::Unlocked,
            _ => Self::Wrong,
        }
    }
}

/// An operation on words of the flash.
#[derive(Clone, Debug)]
pub(crate) enum Operation {
    Erase(Range<usize>),
    /// Bits that are clear in the new value become clear.
    Program {
        word: usize,
        bits: u64,
    },
    /// The option bytes, stored by the interface.
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

/// The flash interface of a chip.
pub(crate) trait FlashInterface: Peripheral {
    fn array(&self) -> &Array;

    fn array_mut(&mut self) -> &mut Array;

    /// Handles a reset or a loss of power: an operation in progress is left half done.
    fn restart(&mut self, memory: &mut Memory);

    /// The timing of the flash for the core.
    fn timing(&self) -> FlashTiming;

    /// Handles a store of the core to the flash, at this offset.
    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused>;

    /// Completes the due operation.
    fn finish(&mut self, now: Nanos, memory: &mut Memory);

    /// Checks a read of the flash through the bus. Returns true if it makes the NMI pending.
    fn check_read(&mut self, _offset: u32) -> bool {
        false
    }

    /// Returns true during an operation: the core waits.
    #[inline]
    fn is_busy(&self) -> bool {
        self.array().is_busy()
    }

    /// Returns true if the power fails now.
    fn take_cut(&mut self, now: Nanos) -> bool {
        self.array_mut().take_cut(now)
    }
}

/// An operation in progress.
#[derive(Clone, Debug)]
struct Started {
    operation: Operation,
    since: Nanos,
    ends: Nanos,
}

/// The memory, and the operation in progress.
#[derive(Clone, Debug)]
pub(crate) struct Array {
    flash: Shared<Flash>,
    started: Option<Started>,
    /// Time of the loss of power.
    cut: Option<Nanos>,
    cache: DataCache,
}

impl Array {
    pub(crate) fn new(flash: Shared<Flash>) -> Self {
        Self {
            flash,
            started: None,
            cut: None,
            cache: DataCache::default(),
        }
    }

    /// Empties the data cache, as at a reset, with this value of ACR.
    pub(crate) fn restart_cache(&mut self, acr: u32) {
        self.cache = DataCache::default();
        self.cache.enable(acr & acr::DCEN != 0);
    }

    /// Follows a write of ACR. A cache can be reset only while it is disabled (RM0090 3.9.1, RM0440 5.7.1).
    pub(crate) fn follow_acr(&mut self, old: u32, new: u32) -> Result<(), Refused> {
        let resets_in_use = |reset, enable| new & reset != 0 && old & enable != 0;
        if resets_in_use(acr::ICRST, acr::ICEN) || resets_in_use(acr::DCRST, acr::DCEN) {
            return Err(forbidden("ACR", "a cache reset while it is enabled"));
        }
        if new & acr::DCRST != 0 {
            self.cache = DataCache::default();
        }
        self.cache.enable(new & acr::DCEN != 0);
        Ok(())
    }

    /// Returns true if a load may get another content than that of the flash.
    pub(crate) fn is_stale(&self) -> bool {
        !self.cache.stale.is_empty()
    }

    /// The answer of the data cache to a load at this offset, if it differs from the flash.
    pub(crate) fn cached(&self, offset: u32, width: Width) -> Option<u32> {
        let word = self.cache.stale.get(&(offset as usize / WORD));
        let shift = 8 * (offset as usize % WORD);
        word.filter(|_| self.cache.enabled)
            .map(|word| (word >> shift) as u32 & width.mask())
    }

    /// The supply voltage, in millivolts.
    pub(crate) fn millivolts(&self) -> u32 {
        lock(&self.flash).millivolts
    }

    /// The content of a word.
    pub(crate) fn word(&self, word: usize) -> u64 {
        u64::from_le_bytes(lock(&self.flash).get(word))
    }

    /// Starts an operation with a typical and a maximum duration. `what` identifies its random draws.
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

    /// Returns true during an operation.
    #[inline]
    pub(crate) fn is_busy(&self) -> bool {
        self.started.is_some()
    }

    /// Returns true if the power fails now.
    pub(crate) fn take_cut(&mut self, now: Nanos) -> bool {
        self.cut.take_if(|at| *at <= now).is_some()
    }

    /// Takes the operation that ends now. The caller changes its words.
    pub(crate) fn take_ended(&mut self, now: Nanos) -> Option<Operation> {
        let Started { operation, since, .. } = self.started.take_if(|started| started.ends <= now)?;
        if matches!(operation, Operation::Erase(_)) {
            lock(&self.flash).erases.push((since, now));
        }
        Some(operation)
    }

    /// Aborts the operation in progress half done, and returns it.
    pub(crate) fn interrupt(&mut self, memory: &mut Memory) -> Option<Operation> {
        self.cut = None;
        let Started { operation, .. } = self.started.take()?;
        self.half_do(&operation, memory);
        Some(operation)
    }

    /// Changes the words of an operation.
    pub(crate) fn complete(&mut self, operation: &Operation, memory: &mut Memory) {
        self.change(operation, memory, |old, _| match operation {
            Operation::Program { bits, .. } => old & bits,
            _ => u64::from_le_bytes([ERASED; WORD]),
        });
    }

    /// Changes some bits of the words of an operation.
    pub(crate) fn half_do(&mut self, operation: &Operation, memory: &mut Memory) {
        self.change(operation, memory, |old, chance| match operation {
            Operation::Program { bits, .. } => programmed_in_part(old, *bits, chance),
            _ => erased_in_part(old, chance),
        });
    }

    /// Changes the words of an operation by a function of their old content and random bits.
    fn change(&mut self, operation: &Operation, memory: &mut Memory, new: impl Fn(u64, u64) -> u64) {
        let mut flash = lock(&self.flash);
        for word in operation.words() {
            let old = u64::from_le_bytes(flash.get(word));
            let chance = flash.chance(word);
            let changed = new(old, chance);
            if changed != old {
                flash.set(word, changed.to_le_bytes());
                memory.program(word * WORD, &changed.to_le_bytes());
            }
            self.cache.follow(operation, word, old, |old| new(old, chance));
        }
    }

    /// The end of the operation, or the loss of power.
    pub(crate) fn due(&self) -> Option<Nanos> {
        let ends = self.started.as_ref().map(|started| started.ends);
        [ends, self.cut].into_iter().flatten().min()
    }
}
