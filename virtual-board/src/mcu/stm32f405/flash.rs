//! The flash interface (RM0090, chapter 3), with the memory behind it: 12 sectors of 16, 64 and 128 kB.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Wait states, prefetch, caches | 3.5.1, 3.5.2 |
//! | The data cache keeps what an erase changes, until it is reset | 3.6.4, 3.9.1 |
//! | Keys and the lock of CR and of OPTCR; a wrong key locks until the next reset | 3.6.1, 3.7.2 |
//! | An erase sets every bit of the sector, or of all, at its end | 3.6.3 |
//! | A store programs while PG is set: it only clears bits, and BSY is set meanwhile | 3.6.4 |
//! | A store without PG: PGSERR; of another width than PSIZE: PGPERR | 3.9.5 |
//! | A store to a protected sector, or an erase of one or of none: WRPERR; OPERR with each if ERRIE | 3.6.5, 3.9.5 |
//! | EOP at the end of an operation, if EOPIE | 3.6.6 |
//! | The minimum supply of each parallelism | 3.6.2 |
//!
//! An operation takes a time between the typical and the maximum of the data sheet (DS8626, 5.3.12), by
//! [`Timing`](crate::Timing). One that starts below its minimum supply is reported, and fails.
//!
//! During an operation the core stalls, as it executes from the flash (3.6). Timers and DMA continue. A loss of power,
//! and a reset, leave an operation half done. PGAERR has no model: no bus transfer crosses a row of 128 bits.
//!
//! Refused with its name: 64-bit parallelism.

use crate::core::{FlashTiming, Memory, Width};
use crate::flash::{Flash, SIZE};
use crate::mcu::common::flash::{Array, Caches, FlashInterface, KEYS, Keys, Operation, WORD};
use crate::shared::Shared;
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, field, forbidden};
use crate::time::Nanos;

const ACR: u32 = 0x00;
const KEYR: u32 = 0x04;
const OPTKEYR: u32 = 0x08;
const SR: u32 = 0x0C;
const CR: u32 = 0x10;
const OPTCR: u32 = 0x14;

/// Bits of ACR (3.9.1).
mod acr {
    pub(super) use crate::mcu::common::flash::acr::*;
    pub(super) const LATENCY: u32 = 0b111;
    pub(super) const MODELLED: u32 = LATENCY | PRFTEN | ICEN | DCEN | ICRST | DCRST;
}

/// Flags of SR (3.9.4).
mod sr {
    pub(super) const EOP: u32 = 1;
    pub(super) const OPERR: u32 = 1 << 1;
    pub(super) const WRPERR: u32 = 1 << 4;
    pub(super) const PGPERR: u32 = 1 << 6;
    pub(super) const PGSERR: u32 = 1 << 7;
    pub(super) const BSY: u32 = 1 << 16;
}

/// Bits of CR (3.9.6).
mod cr {
    pub(super) const PG: u32 = 1;
    pub(super) const SER: u32 = 1 << 1;
    pub(super) const MER: u32 = 1 << 2;
    pub(super) const SNB_AT: u32 = 3;
    pub(super) const SNB: u32 = 0xF;
    pub(super) const PSIZE_AT: u32 = 8;
    pub(super) const PSIZE: u32 = 0b11;
    pub(super) const STRT: u32 = 1 << 16;
    pub(super) const EOPIE: u32 = 1 << 24;
    pub(super) const ERRIE: u32 = 1 << 25;
    pub(super) const LOCK: u32 = 1 << 31;
    pub(super) const WRITABLE: u32 = PG | SER | MER | SNB << SNB_AT | PSIZE << PSIZE_AT | STRT | EOPIE | ERRIE | LOCK;
}

/// Bits of OPTCR (3.9.9), and its value at delivery.
mod optcr {
    pub(super) const OPTLOCK: u32 = 1;
    pub(super) const OPTSTRT: u32 = 1 << 1;
    pub(super) const NWRP_AT: u32 = 16;
    pub(super) const DELIVERED: u32 = 0x0FFF_AAED;
}

/// Keys of OPTKEYR (3.7.2).
const OPTION_KEYS: [u32; 2] = [0x0819_2A3B, 0x4C5D_6E7F];

/// Duration of the programming of a word of any width: typical and maximum (DS8626, 5.3.12).
const PROGRAM: (Nanos, Nanos) = (Nanos(16_000), Nanos(100_000));

/// The typical duration of an erase in milliseconds with a parallelism of 8, 16 and 32 bits (DS8626, 5.3.12).
const ERASE_16K: [u64; 3] = [400, 300, 250];
const ERASE_64K: [u64; 3] = [1_200, 700, 550];
const ERASE_128K: [u64; 3] = [2_000, 1_300, 1_000];
const ERASE_ALL: [u64; 3] = [16_000, 11_000, 8_000];
/// The maximum duration of an erase is twice the typical one.
const WORST_ERASE: u64 = 2;

/// The minimum supply in millivolts with a parallelism of 8, 16 and 32 bits (3.6.2, table 13).
const LEAST_MV: [u32; 3] = [1_800, 2_100, 2_700];

/// The start of each sector, and the end of the last one (3.4, table 5).
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
const SECTOR_COUNT: usize = SECTORS.len() - 1;

/// The maximum HCLK in hertz per wait state, with a supply of 2.7 V or more (3.5.1, table 10).
const PER_WAIT_STATE: u64 = 30_000_000;

/// The caches (3.5.2).
const CACHES: Caches = Caches {
    line: 16,
    code: 64,
    data: 8,
};

#[derive(Debug)]
pub(crate) struct Interface {
    array: Array,
    acr: u32,
    sr: u32,
    cr: u32,
    keys: Keys,
    option_keys: Keys,
    optcr: u32,
    /// OPTCR as last programmed.
    options: u32,
    /// True if the operation fails because of a low supply.
    fails: bool,
}

impl Interface {
    pub(super) fn new(flash: Shared<Flash>) -> Self {
        Self::with(Array::new(flash), optcr::DELIVERED & !optcr::OPTLOCK)
    }

    /// The reset state of the interface, with these option bytes.
    fn with(mut array: Array, options: u32) -> Self {
        array.restart_cache(0);
        Self {
            array,
            acr: 0,
            sr: 0,
            cr: 0,
            keys: Keys::None,
            option_keys: Keys::None,
            optcr: options,
            options,
            fails: false,
        }
    }

    /// The supply, in millivolts.
    pub(super) fn millivolts(&self) -> u32 {
        self.array.millivolts()
    }

    /// The level of the interrupt line (3.6.6): EOP and OPERR are set only if they interrupt.
    pub(super) fn interrupts(&self) -> bool {
        self.sr & self.cr >> 24 & (sr::EOP | sr::OPERR) != 0
    }

    /// The violation of an HCLK of `hz`, if any.
    pub(super) fn fault(&self, hz: u64) -> Option<Refused> {
        let most = PER_WAIT_STATE * u64::from((self.acr & acr::LATENCY) + 1);
        (hz > most).then(|| forbidden("ACR", "3.5.1: too few wait states for HCLK"))
    }

    fn parallelism(&self) -> u32 {
        field(self.cr, cr::PSIZE_AT, cr::PSIZE)
    }

    /// Starts an operation. Returns an error if it will fail.
    fn start(&mut self, operation: Operation, times: (Nanos, Nanos), now: Nanos) -> Result<(), Refused> {
        let what = match operation {
            Operation::Erase(_) => "erase",
            Operation::Program { .. } | Operation::Options => "program",
        };
        let least = LEAST_MV.get(self.parallelism() as usize);
        self.fails = least.is_none_or(|&least| self.array.millivolts() < least);
        self.array.start(operation, what, times, now);
        self.sr |= sr::BSY;
        if self.fails {
            return Err(forbidden("CR", "3.6.2: a flash operation below its minimum supply"));
        }
        Ok(())
    }

    fn flag_error(&mut self, flag: u32) {
        self.sr |= flag;
        if self.cr & cr::ERRIE != 0 {
            self.sr |= sr::OPERR;
        }
    }

    /// Returns true if a sector exists and may be changed.
    fn is_open(&self, sector: usize) -> bool {
        sector < SECTOR_COUNT && self.options >> optcr::NWRP_AT & self.optcr >> optcr::NWRP_AT & 1 << sector != 0
    }

    fn is_locked(&self) -> bool {
        self.keys != Keys::Unlocked
    }

    fn write_key(&mut self, key: u32) -> Result<(), Refused> {
        self.keys = self.keys.take(key, KEYS);
        match self.keys {
            Keys::Wrong => Err(forbidden("KEYR", "3.6.1: a wrong key")),
            _ => Ok(()),
        }
    }

    fn write_option_key(&mut self, key: u32) -> Result<(), Refused> {
        self.option_keys = self.option_keys.take(key, OPTION_KEYS);
        match self.option_keys {
            Keys::Wrong => Err(forbidden("OPTKEYR", "3.7.2: a wrong key")),
            _ => Ok(()),
        }
    }

    fn control(&self) -> u32 {
        self.cr | if self.is_locked() { cr::LOCK } else { 0 }
    }

    fn write_cr(&mut self, value: u32, now: Nanos) -> Result<(), Refused> {
        if self.is_busy() {
            return Err(forbidden("CR", "3.6.1: written while BSY is set"));
        }
        if self.is_locked() {
            return if value == self.control() {
                Ok(())
            } else {
                Err(forbidden("CR", "3.6.1: written while locked"))
            };
        }
        check_modelled("CR", value, cr::WRITABLE)?;
        self.cr = value & !cr::LOCK;
        if value & cr::LOCK != 0 {
            self.keys = Keys::None;
        }
        if value & cr::STRT != 0 {
            return self.erase(now);
        }
        Ok(())
    }

    fn erase(&mut self, now: Nanos) -> Result<(), Refused> {
        let sector = field(self.cr, cr::SNB_AT, cr::SNB) as usize;
        let (bytes, times) = match (self.cr & cr::MER != 0, self.cr & cr::SER != 0) {
            (true, _) if !(0..SECTOR_COUNT).all(|sector| self.is_open(sector)) => return self.refuse_erase(),
            (true, _) => (0..SIZE, ERASE_ALL),
            (false, true) if !self.is_open(sector) => return self.refuse_erase(),
            (false, true) => {
                let bytes = SECTORS[sector]..SECTORS[sector + 1];
                let times = match bytes.len() >> 10 {
                    16 => ERASE_16K,
                    64 => ERASE_64K,
                    _ => ERASE_128K,
                };
                (bytes, times)
            }
            (false, false) => {
                self.cr &= !cr::STRT;
                return Err(forbidden("CR", "3.6.3: STRT without SER or MER"));
            }
        };
        let Some(&millis) = times.get(self.parallelism() as usize) else {
            return Err(Refused::Unimplemented("CR.PSIZE: 64 bits"));
        };
        let typical = Nanos::from_millis(millis);
        let worst = Nanos(typical.0 * WORST_ERASE);
        self.start(
            Operation::Erase(bytes.start / WORD..bytes.end / WORD),
            (typical, worst),
            now,
        )
    }

    fn refuse_erase(&mut self) -> Result<(), Refused> {
        self.cr &= !cr::STRT;
        self.flag_error(sr::WRPERR);
        Ok(())
    }

    fn write_options(&mut self, value: u32, now: Nanos) -> Result<(), Refused> {
        if self.option_keys != Keys::Unlocked {
            return Err(forbidden("OPTCR", "3.7.2: written while locked"));
        }
        if value & optcr::OPTLOCK != 0 {
            self.option_keys = Keys::None;
            return Ok(());
        }
        self.optcr = value;
        if value & optcr::OPTSTRT != 0 {
            return self.start(Operation::Options, PROGRAM, now);
        }
        Ok(())
    }

    fn write_acr(&mut self, value: u32) -> Result<(), Refused> {
        check_modelled("ACR", value, acr::MODELLED)?;
        self.array.follow_acr(self.acr, value)?;
        self.acr = value;
        Ok(())
    }
}

impl FlashInterface for Interface {
    fn array(&self) -> &Array {
        &self.array
    }

    fn array_mut(&mut self) -> &mut Array {
        &mut self.array
    }

    fn restart(&mut self, memory: &mut Memory) {
        self.array.interrupt(memory);
        *self = Self::with(self.array.clone(), self.options);
    }

    fn timing(&self) -> FlashTiming {
        CACHES.timing(self.acr, self.acr & acr::LATENCY)
    }

    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused> {
        // A stray store would otherwise go unnoticed.
        if self.is_locked() || self.cr & cr::PG == 0 {
            self.flag_error(sr::PGSERR);
            return Err(forbidden("SR", "3.6.4: a store to the flash while PG is clear"));
        }
        if width.bytes() != 1 << self.parallelism() {
            self.flag_error(sr::PGPERR);
            return Err(forbidden(
                "SR",
                "3.6.4: a store to the flash of another width than PSIZE",
            ));
        }
        let offset = offset as usize;
        let sector = SECTORS.iter().rposition(|&start| start <= offset).unwrap_or(0);
        if !self.is_open(sector) {
            self.flag_error(sr::WRPERR);
            return Ok(());
        }
        let shift = 8 * (offset % WORD);
        let bits = u64::from(value) << shift | !(u64::from(width.mask()) << shift);
        let word = offset / WORD;
        self.start(Operation::Program { word, bits }, PROGRAM, now)
    }

    fn finish(&mut self, now: Nanos, memory: &mut Memory) {
        let Some(operation) = self.array.take_ended(now) else {
            return;
        };
        self.sr &= !sr::BSY;
        if self.cr & cr::EOPIE != 0 {
            self.sr |= sr::EOP;
        }
        if matches!(operation, Operation::Erase(_)) {
            self.cr &= !cr::STRT;
        }
        match operation {
            _ if self.fails => self.array.half_do(&operation, memory),
            Operation::Options => {
                self.optcr &= !optcr::OPTSTRT;
                self.options = self.optcr;
            }
            _ => self.array.complete(&operation, memory),
        }
    }
}

impl Peripheral for Interface {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            ACR => Ok(self.acr),
            KEYR | OPTKEYR => Ok(0),
            SR => Ok(self.sr),
            CR => Ok(self.control()),
            OPTCR => Ok(self.optcr | u32::from(self.option_keys != Keys::Unlocked)),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        match offset {
            ACR => self.write_acr(value)?,
            KEYR => self.write_key(value)?,
            OPTKEYR => self.write_option_key(value)?,
            // A 1 clears.
            SR => self.sr &= !value | sr::BSY,
            CR => self.write_cr(value, now)?,
            OPTCR => self.write_options(value, now)?,
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn due(&self) -> Option<Nanos> {
        self.array.due()
    }
}
