//! The flash interface (RM0090, chapter 3): the library's registers, with the memory behind them.
//!
//! The library has the unlock sequences, the wait states, the protection and the times of erasing. This adds what it
//! lacks:
//!
//! | Behaviour | Section |
//! |---|---|
//! | An erase sets every bit of the sector, or of all, as it ends | 3.6.3 |
//! | A store programs while PG is set: it clears bits and sets none, and BSY lasts as long | 3.6.4 |
//! | A store without PG: PGSERR; of another width than PSIZE: PGPERR; across a row of 128 bits: PGAERR | 3.9.5 |
//! | A store to a protected sector: WRPERR; OPERR with each of them if ERRIE | 3.6.5, 3.9.5 |
//! | EOP as an operation ends, if EOPIE | 3.6.6 |
//! | There are 12 sectors | 3.4 |
//!
//! An operation takes from the typical to the longest time of the data sheet (DS8626, 5.3.12), as
//! [`Timing`](crate::Timing) says. One that starts below 2.7 V is told, and goes wrong (DS8626, 5.3.1; RM0090, 3.6.2).
//!
//! While an operation lasts, the core stands still, as one does that runs from the flash (3.6). Timers and DMA go on. So
//! nobody can write to the interface meanwhile, but a debugger. Power that goes, and a reset, leave an operation half
//! done.

use std::num::NonZeroU32;
use std::ops::Range;
use std::sync::{Arc, Mutex};

use rigless::device::{Device, DeviceContext, RegisterFile};
use rigless::soc::stm32f427::generated::flash::{Register, cr, optcr, sr};
use rigless::soc::stm32f427::peripherals::flash::{Flash as Library, LOCK, STRT};
use rigless::soc::{Layout, Width};
use rigless::time::{EventId, VirtualNanos};

use crate::flash::{BASE, ERASED, Flash, SIZE, SUPPLY_MV, erased_in_part, programmed_in_part};
use crate::shared::lock;
use crate::time::Nanos;

/// What HCLK is until the firmware sets the clock tree up: the internal oscillator (7.2.2).
const RESET_HZ: u64 = 16_000_000;

/// How long a word takes, whatever its width: typical, and at worst (DS8626, 5.3.12).
const PROGRAM: (Nanos, Nanos) = (Nanos(16_000), Nanos(100_000));

/// At worst an erase takes twice the typical time (DS8626, 5.3.12).
const WORST_ERASE: u64 = 2;

/// The least supply for words of 32 bits, in millivolts (RM0090, 3.6.2, table 13).
const LEAST_MV: u32 = 2_700;

/// What every erase lasts at least: the shortest one (DS8626, 5.3.12: 16 kB at x32, typical).
const SHORTEST_ERASE: Nanos = Nanos::from_millis(250);

/// Bytes that are programmed together at most, and whose bounds no store may cross (3.9.5 PGAERR).
const ROW: u64 = 16;

/// Bytes of a word in [`Flash`].
const WORD: usize = 8;

/// Where each sector starts, and where the last one ends (3.4, table 5).
const SECTORS: [usize; 13] = {
    let mut starts = [0; 13];
    let mut nth = 0;
    while nth < 12 {
        let kib = match nth {
            0..=3 => 16,
            4 => 64,
            _ => 128,
        };
        starts[nth + 1] = starts[nth] + (kib << 10);
        nth += 1;
    }
    starts
};

/// What the flash is busy with.
#[derive(Clone, Debug)]
enum Operation {
    /// Erasing these bytes, since an instant. The library ends it after the typical time, and `end` is what it is to be told
    /// later then.
    Erase {
        bytes: Range<usize>,
        since: Nanos,
        end: Option<(EventId, EventId)>,
    },
    /// Programming a word with bits clear where they are to be clear, until an instant.
    Program { word: usize, bits: u64, done: EventId },
}

/// The interface.
#[derive(Debug)]
pub(super) struct Interface {
    library: Library,
    flash: Arc<Mutex<Flash>>,
    operation: Option<Operation>,
    /// Whether the operation goes wrong: the supply was too low for it.
    fails: bool,
    /// When the power goes.
    cut: Option<EventId>,
}

impl Interface {
    pub(super) fn new(flash: Arc<Mutex<Flash>>) -> Self {
        let mut library = Library::with_clock(RESET_HZ);
        // What an operation needs of the supply is seen to here, when it starts.
        if let Some(supply) = NonZeroU32::new(SUPPLY_MV) {
            library.set_supply(supply);
        }
        Self {
            library,
            flash,
            operation: None,
            fails: false,
            cut: None,
        }
    }

    /// Whether an operation is under way.
    pub(super) fn is_busy(&self) -> bool {
        self.operation.is_some()
    }

    /// The supply, in millivolts.
    pub(super) fn millivolts(&self) -> u32 {
        lock(&self.flash).millivolts
    }

    /// The same after a reset of the part at the instant of `context`. What was under way is left half done.
    pub(super) fn restarted(&mut self, context: &mut DeviceContext<'_>) {
        if let Some(operation) = self.operation.take() {
            self.half_do(operation, context);
        }
        *self = Self::new(self.flash.clone());
    }

    /// Leaves an operation half done.
    fn half_do(&self, operation: Operation, context: &mut DeviceContext<'_>) {
        match operation {
            Operation::Erase { bytes, .. } => {
                self.change(bytes.start / WORD..bytes.end / WORD, context, erased_in_part);
            }
            Operation::Program { word, bits, .. } => {
                self.change(word..word + 1, context, |old, chance| {
                    programmed_in_part(old, bits, chance)
                });
            }
        }
    }

    /// Changes words, given what each held and a chance.
    fn change(&self, words: Range<usize>, context: &mut DeviceContext<'_>, new: impl Fn(u64, u64) -> u64) {
        let mut flash = lock(&self.flash);
        for word in words {
            let old = u64::from_le_bytes(flash.get(word));
            let new = new(old, flash.chance(word));
            if new != old {
                flash.set(word, new.to_le_bytes());
                context.program(BASE + (word * WORD) as u64, Width::W64, new, 0);
            }
        }
    }

    fn start(&mut self, operation: Operation, shortest: Nanos, context: &mut DeviceContext<'_>) {
        self.operation = Some(operation);
        self.fails = self.millivolts() < LEAST_MV;
        if self.fails {
            context.tell(Register::Cr.spec().name, "3.6.2: a flash operation below 2.7 V");
        }
        let cut = lock(&self.flash).start(shortest);
        self.cut = cut.map(|after| context.schedule(VirtualNanos::from(Nanos::from(context.now()) + after)));
    }

    /// The operation is over.
    fn finish(&mut self, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        let Some(operation) = self.operation.take() else {
            return;
        };
        if let Operation::Erase { since, .. } = &operation {
            lock(&self.flash).erases.push((*since, context.now().into()));
        }
        let is_word = matches!(operation, Operation::Program { .. });
        match operation {
            operation if self.fails => self.half_do(operation, context),
            Operation::Erase { bytes, .. } => {
                let erased = u64::from_le_bytes([ERASED; WORD]);
                self.change(bytes.start / WORD..bytes.end / WORD, context, |_, _| erased);
            }
            Operation::Program { word, bits, .. } => {
                self.change(word..word + 1, context, |old, _| old & bits);
            }
        }
        if is_word {
            let mut status = sr::BSY.set(registers.get(Register::Sr), 0);
            if cr::EOPIE.is_set(registers.get(Register::Cr)) {
                status = sr::EOP.set(status, 1);
            }
            self.set_status(status, registers, context);
        }
    }

    /// What an erase takes beyond the typical time that it has taken by now.
    fn erase_longer(&self, typical: Nanos) -> Nanos {
        let worst = Nanos(typical.0 * WORST_ERASE);
        lock(&self.flash).clock.span("erase", typical, worst).since(typical)
    }

    /// Changes SR, and lets the library see to its interrupt.
    fn set_status(&mut self, status: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        registers.set(Register::Sr, status);
        self.library.write(Register::Sr, 0, registers, context);
    }

    /// The event that the library is to have now. That of an erase which takes longer it has later.
    fn put_off(&mut self, event: EventId, context: &mut DeviceContext<'_>) -> Option<EventId> {
        let now = Nanos::from(context.now());
        match &self.operation {
            Some(Operation::Erase {
                end: Some((late, library)),
                ..
            }) => (*late == event).then_some(*library),
            Some(Operation::Erase { since, .. }) => {
                let longer = self.erase_longer(now.since(*since));
                if longer == Nanos(0) {
                    return Some(event);
                }
                let late = context.schedule(VirtualNanos::from(now + longer));
                if let Some(Operation::Erase { end, .. }) = &mut self.operation {
                    *end = Some((late, event));
                }
                None
            }
            _ => Some(event),
        }
    }

    /// What is wrong with a store of `width` at `address`, if anything: its flag.
    fn refusal(address: u64, width: Width, registers: &RegisterFile) -> Option<u64> {
        let control = registers.get(Register::Cr);
        let bytes = u64::from(width.bytes());
        let sector = sector_of((address - BASE) as usize);
        let protected = optcr::NWRP.get(registers.get(Register::Optcr)) >> sector & 1 == 0;
        if LOCK.is_set(control) || !cr::PG.is_set(control) {
            Some(sr::PGSERR.mask())
        } else if bytes != 1 << cr::PSIZE.get(control) {
            Some(sr::PGPERR.mask())
        } else if address % ROW + bytes > ROW {
            Some(sr::PGAERR.mask())
        } else if protected {
            Some(sr::WRPERR.mask())
        } else {
            None
        }
    }
}

/// The sector that holds a byte.
fn sector_of(offset: usize) -> usize {
    SECTORS.iter().rposition(|&start| start <= offset).unwrap_or(0)
}

impl Device for Interface {
    type Register = Register;

    fn write(&mut self, register: Register, value: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if register == Register::Cr && cr::SNB.get(registers.get(Register::Cr)) >= SECTORS.len() as u64 - 1 {
            // The library's part has more sectors. This number is none of them either.
            let nowhere = cr::SNB.set(registers.get(Register::Cr), 12);
            registers.set(Register::Cr, nowhere);
        }
        self.library.write(register, value, registers, context);
        let control = registers.get(Register::Cr);
        let erases = sr::BSY.is_set(registers.get(Register::Sr)) && STRT.is_set(control);
        if register == Register::Cr && erases && self.operation.is_none() {
            let bytes = if cr::MER.is_set(control) {
                0..SIZE
            } else {
                let sector = cr::SNB.get(control) as usize;
                SECTORS[sector]..SECTORS[sector + 1]
            };
            let since = context.now().into();
            let operation = Operation::Erase {
                bytes,
                since,
                end: None,
            };
            self.start(operation, SHORTEST_ERASE, context);
        }
    }

    fn write_region(
        &mut self,
        address: u64,
        width: Width,
        value: u64,
        registers: &mut RegisterFile,
        context: &mut DeviceContext<'_>,
    ) -> bool {
        let status = registers.get(Register::Sr);
        if let Some(flag) = Self::refusal(address, width, registers) {
            let operation_error = match cr::ERRIE.is_set(registers.get(Register::Cr)) {
                true => sr::OPERR.mask(),
                false => 0,
            };
            self.set_status(status | flag | operation_error, registers, context);
            // A store that strays is a bug that nobody would see.
            if flag == sr::PGSERR.mask() {
                context.tell(
                    Register::Sr.spec().name,
                    "3.6.4: a store to the flash while PG is clear",
                );
            }
        } else {
            registers.set(Register::Sr, sr::BSY.set(status, 1));
            let offset = (address - BASE) as usize;
            let shift = 8 * (offset % WORD);
            let bits = value << shift | !(width.mask() << shift);
            let (typical, worst) = PROGRAM;
            let span = lock(&self.flash).clock.span("program", typical, worst);
            let done = context.schedule(VirtualNanos::from(Nanos::from(context.now()) + span));
            let word = offset / WORD;
            self.start(Operation::Program { word, bits, done }, typical, context);
        }
        true
    }

    fn on_event(&mut self, event: EventId, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if self.cut == Some(event) {
            lock(&self.flash).cut = Some(context.now().into());
            context.request_power(false);
            return;
        }
        let programmed = matches!(self.operation, Some(Operation::Program { done, .. }) if done == event);
        let Some(event) = self.put_off(event, context) else {
            return;
        };
        self.library.on_event(event, registers, context);
        let erased =
            matches!(self.operation, Some(Operation::Erase { .. })) && !sr::BSY.is_set(registers.get(Register::Sr));
        if programmed || erased {
            self.finish(registers, context);
        }
    }

    fn on_clock(&mut self, hz: u64, registers: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        self.library.on_clock(hz, registers, context);
    }

    fn poll(&mut self, _: &mut RegisterFile, context: &mut DeviceContext<'_>) {
        if let Some(on) = lock(&self.flash).supply.take() {
            context.request_power(on);
        }
    }
}
