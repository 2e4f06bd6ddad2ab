//! The flash interface (RM0440, chapter 5), with the memory behind it: 64 pages of 2 KiB in one bank, programmed by double
//! words with an error correction code.
//!
//! | Behaviour | Section |
//! |---|---|
//! | Wait states, prefetch, caches | 5.3.3, 5.3.4 |
//! | The data cache keeps what an erase changes, until it is reset | 5.3.7, 5.7.1 |
//! | Keys and the lock of CR; a wrong key locks until the next reset | 5.3.5 |
//! | An erase sets every bit of the page, or of all, at its end | 5.3.6 |
//! | Two stores of 32 bits program a double word, which must be erased | 5.3.7 |
//! | SIZERR, PGAERR, PGSERR, PROGERR | 5.3.7, 5.7.5 |
//! | An interrupted programming or erase of a double word causes an ECC error: ECCD, NMI | 5.3.2, 5.7.7 |
//!
//! During an operation the core stalls, as it executes from the flash. An interrupted double word always has an ECC
//! error, and reads as its actual bits. What ECCR then reads is the board's [choice](EccRegister).
//!
//! Refused with their name: fast programming, option bytes, write protection, interrupts.

use std::collections::BTreeSet;

use crate::core::{FlashTiming, Memory, Width};
use crate::flash::Flash;
use crate::mcu::common::flash::{Array, Caches, FlashInterface, KEYS, Keys, Operation, WORD};
use crate::shared::Shared;
use crate::soc::chance::draw;
use crate::soc::peripheral::{Peripheral, Refused, check_modelled, field, forbidden};
use crate::time::Nanos;

/// Size of the flash, and of a page (5.3.1).
pub(super) const SIZE: usize = 128 << 10;
const PAGE: usize = 2 << 10;

const ACR: u32 = 0x00;
const PDKEYR: u32 = 0x04;
const KEYR: u32 = 0x08;
const OPTKEYR: u32 = 0x0C;
const SR: u32 = 0x10;
const CR: u32 = 0x14;
const ECCR: u32 = 0x18;
const OPTR: u32 = 0x20;

/// Bits of ACR (5.7.1).
mod acr {
    pub(super) use crate::mcu::common::flash::acr::*;
    pub(super) const LATENCY: u32 = 0xF;
    pub(super) const DBG_SWEN: u32 = 1 << 18;
    pub(super) const MODELLED: u32 = LATENCY | PRFTEN | ICEN | DCEN | ICRST | DCRST | DBG_SWEN;
    pub(super) const AT_RESET: u32 = ICEN | DCEN | DBG_SWEN;
}

/// Flags of SR (5.7.5).
mod sr {
    pub(super) const EOP: u32 = 1;
    pub(super) const OPERR: u32 = 1 << 1;
    pub(super) const PROGERR: u32 = 1 << 3;
    pub(super) const PGAERR: u32 = 1 << 5;
    pub(super) const SIZERR: u32 = 1 << 6;
    pub(super) const PGSERR: u32 = 1 << 7;
    pub(super) const BSY: u32 = 1 << 16;
    pub(super) const CLEARABLE: u32 = 0xC3FB;
}

/// Bits of CR (5.7.6).
mod cr {
    pub(super) const PG: u32 = 1;
    pub(super) const PER: u32 = 1 << 1;
    pub(super) const MER1: u32 = 1 << 2;
    pub(super) const PNB_AT: u32 = 3;
    pub(super) const PNB: u32 = 0x7F;
    pub(super) const STRT: u32 = 1 << 16;
    pub(super) const EOPIE: u32 = 1 << 24;
    pub(super) const ERRIE: u32 = 1 << 25;
    pub(super) const OPTLOCK: u32 = 1 << 30;
    pub(super) const LOCK: u32 = 1 << 31;
    pub(super) const MODELLED: u32 = PG | PER | MER1 | PNB << PNB_AT | STRT | EOPIE | ERRIE | OPTLOCK | LOCK;
    pub(super) const AT_RESET: u32 = LOCK | OPTLOCK;
}

/// Fields of ECCR (5.7.7).
mod eccr {
    pub(super) const ADDR_ECC: u32 = 0x7_FFFF;
    pub(super) const SYSF_ECC: u32 = 1 << 22;
    pub(super) const ECCCIE: u32 = 1 << 24;
    pub(super) const ECCC: u32 = 1 << 30;
    pub(super) const ECCD: u32 = 1 << 31;
    pub(super) const ALL: u32 = ADDR_ECC | SYSF_ECC | ECCCIE | ECCC | ECCD;
}

/// ECCR after a read of a double word whose programming or erase was interrupted.
///
/// A reset or a loss of power during programming or an erase may corrupt the register (ES0431, "FLASH_ECCR corrupted upon
/// reset or power-down occurring during flash memory program or erase operation").
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum EccRegister {
    /// It has the address, as in the manual (5.7.7).
    #[default]
    Correct,
    /// Its address is 0.
    NoAddress,
    /// Its address is that of another double word, drawn from the [seed](crate::Config::seed).
    OtherAddress,
    /// All of it is drawn from the [seed](crate::Config::seed), also the flag of the error.
    Random,
}

/// The option bytes at delivery (5.7.8).
const OPTIONS: u32 = 0xFFEF_F8AA;

/// Duration of operations, typical and maximum (DS12589, table "Flash memory characteristics").
const PROGRAM: (Nanos, Nanos) = (Nanos(81_700), Nanos(83_350));
const ERASE: (Nanos, Nanos) = (Nanos(22_020_000), Nanos(24_470_000));

/// The caches (5.3.4: 1 KiB and 256 bytes), by lines of the width of a read: 64 bits in a category 2 device.
const CACHES: Caches = Caches {
    line: 8,
    code: 128,
    data: 32,
};

#[derive(Debug)]
pub(crate) struct Interface {
    array: Array,
    acr: u32,
    sr: u32,
    cr: u32,
    eccr: u32,
    keys: Keys,
    /// The first half of a double word, and its address.
    first_half: Option<(u32, u32)>,
    errors: EccErrors,
}

/// The double words with ECC errors, and how they are reported.
#[derive(Clone, Debug)]
struct EccErrors {
    broken: BTreeSet<usize>,
    register: EccRegister,
    seed: u64,
    /// Number of reported errors.
    reported: u64,
}

impl EccErrors {
    /// ECCR after a read of the double word at this offset.
    fn report(&mut self, offset: u32) -> u32 {
        self.reported += 1;
        let drawn = draw(self.seed, "ECCR", self.reported) as u32;
        let double_words = eccr::ADDR_ECC & !(WORD as u32 - 1);
        match self.register {
            EccRegister::Correct => eccr::ECCD | offset & double_words,
            EccRegister::NoAddress => eccr::ECCD,
            EccRegister::OtherAddress => eccr::ECCD | drawn & double_words,
            EccRegister::Random => drawn & eccr::ALL,
        }
    }
}

impl Interface {
    /// The interface of a chip whose ECCR is like this after an interrupted operation.
    pub(super) fn new(flash: Shared<Flash>, register: EccRegister, seed: u64) -> Self {
        let errors = EccErrors {
            broken: BTreeSet::new(),
            register,
            seed,
            reported: 0,
        };
        Self::with(Array::new(flash), errors)
    }

    /// The reset state of the interface, with these ECC errors.
    fn with(mut array: Array, errors: EccErrors) -> Self {
        array.restart_cache(acr::AT_RESET);
        Self {
            array,
            acr: acr::AT_RESET,
            sr: 0,
            cr: cr::AT_RESET,
            eccr: 0,
            keys: Keys::None,
            first_half: None,
            errors,
        }
    }

    pub(super) fn wait_states(&self) -> u32 {
        self.acr & acr::LATENCY
    }

    fn reset_registers(&mut self) {
        *self = Self::with(self.array.clone(), self.errors.clone());
    }

    fn start(&mut self, operation: Operation, times: (Nanos, Nanos), now: Nanos) {
        self.array.start(operation, "flash", times, now);
        self.sr |= sr::BSY;
    }

    fn fail(&mut self, flag: u32, reason: &'static str) -> Refused {
        self.sr |= flag;
        if self.cr & cr::ERRIE != 0 {
            self.sr |= sr::OPERR;
        }
        self.first_half = None;
        forbidden("SR", reason)
    }

    fn write_key(&mut self, value: u32) -> Result<(), Refused> {
        self.keys = self.keys.take(value, KEYS);
        match self.keys {
            Keys::Wrong => return Err(forbidden("KEYR", "5.3.5: a wrong key")),
            Keys::Unlocked => {
                self.keys = Keys::None;
                self.cr &= !cr::LOCK;
            }
            Keys::None | Keys::First => {}
        }
        Ok(())
    }

    fn write_cr(&mut self, value: u32, now: Nanos) -> Result<(), Refused> {
        if self.cr & cr::LOCK != 0 {
            return if value == self.cr {
                Ok(())
            } else {
                Err(forbidden("CR", "5.3.5: written while locked"))
            };
        }
        if self.is_busy() {
            return Err(forbidden("CR", "5.7.6: written while BSY is set"));
        }
        check_modelled("CR", value, cr::MODELLED)?;
        self.cr = value;
        if value & cr::STRT == 0 {
            return Ok(());
        }
        let bytes = if value & cr::MER1 != 0 {
            0..SIZE
        } else if value & cr::PER != 0 {
            let page = field(value, cr::PNB_AT, cr::PNB) as usize;
            page * PAGE..(page + 1) * PAGE
        } else {
            return Err(self.fail(sr::PGSERR, "5.3.6: STRT without PER or MER1"));
        };
        if bytes.end > SIZE {
            return Err(self.fail(sr::PGSERR, "5.3.6: the flash has no such page"));
        }
        self.start(Operation::Erase(bytes.start / WORD..bytes.end / WORD), ERASE, now);
        Ok(())
    }

    /// ECCC and ECCD are cleared by 1. The interrupt of corrected errors has no model.
    fn write_eccr(&mut self, value: u32) -> Result<(), Refused> {
        if value & eccr::ECCCIE != 0 {
            return Err(Refused::Unimplemented("ECCR.ECCCIE"));
        }
        self.eccr &= !(value & (eccr::ECCC | eccr::ECCD) | eccr::ECCCIE);
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
        if let Some(operation) = self.array.interrupt(memory) {
            self.errors.broken.extend(operation.words());
        }
        self.reset_registers();
        memory.set_flash_reads_on_bus(!self.errors.broken.is_empty());
    }

    fn timing(&self) -> FlashTiming {
        CACHES.timing(self.acr, self.wait_states())
    }

    fn store(&mut self, offset: u32, width: Width, value: u32, now: Nanos) -> Result<(), Refused> {
        if self.cr & (cr::LOCK | cr::PG) != cr::PG {
            return Err(self.fail(sr::PGSERR, "5.3.7: a store to the flash while PG is clear"));
        }
        if width != Width::Word {
            return Err(self.fail(sr::SIZERR, "5.3.7: a store to the flash that is no word"));
        }
        let double_word = WORD as u32;
        match self.first_half.take() {
            None if offset.is_multiple_of(double_word) => self.first_half = Some((offset, value)),
            Some((first, low)) if offset == first + 4 => {
                let word = first as usize / WORD;
                let value = u64::from(value) << 32 | u64::from(low);
                let old = self.array.word(word);
                if old != u64::MAX && value != 0 {
                    return Err(self.fail(sr::PROGERR, "5.3.7: programming a double word that is not erased"));
                }
                self.start(Operation::Program { word, bits: value }, PROGRAM, now);
            }
            _ => return Err(self.fail(sr::PGAERR, "5.3.7: a double word not programmed as two words in order")),
        }
        Ok(())
    }

    fn finish(&mut self, now: Nanos, memory: &mut Memory) {
        let Some(operation) = self.array.take_ended(now) else {
            return;
        };
        self.sr &= !sr::BSY;
        if self.cr & cr::EOPIE != 0 {
            self.sr |= sr::EOP;
        }
        self.array.complete(&operation, memory);
        if let Operation::Erase(words) = operation {
            self.cr &= !cr::STRT;
            self.errors.broken.retain(|word| !words.contains(word));
            memory.set_flash_reads_on_bus(!self.errors.broken.is_empty());
        }
    }

    fn check_read(&mut self, offset: u32) -> bool {
        if !self.errors.broken.contains(&(offset as usize / WORD)) {
            return false;
        }
        // The first error is kept.
        if self.eccr & eccr::ECCD == 0 {
            self.eccr = self.errors.report(offset);
        }
        true
    }
}

impl Peripheral for Interface {
    fn read(&mut self, offset: u32, _: Nanos) -> Result<u32, Refused> {
        match offset {
            ACR => Ok(self.acr),
            PDKEYR | KEYR | OPTKEYR => Ok(0),
            SR => Ok(self.sr),
            CR => Ok(self.cr),
            ECCR => Ok(self.eccr),
            OPTR => Ok(OPTIONS),
            0x24..=0x70 => Err(Refused::Unimplemented("PCROP1SR to SEC1R")),
            _ => Err(Refused::NoRegister),
        }
    }

    fn write(&mut self, offset: u32, value: u32, now: Nanos) -> Result<(), Refused> {
        match offset {
            ACR if value & !acr::MODELLED != 0 => return Err(Refused::Unimplemented("ACR")),
            ACR => {
                self.array.follow_acr(self.acr, value)?;
                self.acr = value;
            }
            KEYR => self.write_key(value)?,
            SR => self.sr &= !(value & sr::CLEARABLE),
            CR => self.write_cr(value, now)?,
            ECCR => self.write_eccr(value)?,
            PDKEYR => return Err(Refused::Unimplemented("PDKEYR")),
            OPTKEYR => return Err(Refused::Unimplemented("OPTKEYR")),
            OPTR => return Err(Refused::Unimplemented("OPTR")),
            0x24..=0x70 => return Err(Refused::Unimplemented("PCROP1SR to SEC1R")),
            _ => return Err(Refused::NoRegister),
        }
        Ok(())
    }

    fn due(&self) -> Option<Nanos> {
        self.array.due()
    }

    /// Resets the interface (RCC_AHB1RSTR.FLASHRST, 7.4.8).
    fn reset(&mut self, _: Nanos) {
        self.reset_registers();
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use super::*;
    use crate::flash::ERASED;
    use crate::shared::lock;
    use crate::timing::{Clock, Timing};

    struct Bench {
        interface: Interface,
        flash: Shared<Flash>,
        memory: Memory,
        now: Nanos,
    }

    impl Bench {
        /// A flash whose first page is programmed to zeros.
        fn new() -> Self {
            Self::with(EccRegister::Correct)
        }

        fn with(register: EccRegister) -> Self {
            let mut bytes = vec![ERASED; SIZE];
            bytes[..PAGE].fill(0);
            let memory = Memory::new(0x0800_0000, bytes.clone(), 0x2000_0000, 0x8000);
            let flash = Arc::new(Mutex::new(Flash::new(bytes, None, Clock::default())));
            Self {
                interface: Interface::new(flash.clone(), register, 0),
                flash,
                memory,
                now: Nanos(0),
            }
        }

        fn write(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
            self.interface.write(offset, value, self.now)
        }

        fn unlocked() -> Self {
            let mut bench = Self::new();
            bench.unlock();
            bench
        }

        fn unlock(&mut self) {
            for key in KEYS {
                self.write(KEYR, key).unwrap();
            }
        }

        fn finish(&mut self) -> Nanos {
            let start = self.now;
            self.now = self.interface.due().unwrap();
            self.interface.finish(self.now, &mut self.memory);
            Nanos(self.now.0 - start.0)
        }

        fn store(&mut self, offset: u32, value: u32) -> Result<(), Refused> {
            self.interface.store(offset, Width::Word, value, self.now)
        }

        fn status(&mut self) -> u32 {
            self.interface.read(SR, self.now).unwrap()
        }
    }

    #[test]
    fn page_is_erased_after_its_time() {
        let mut bench = Bench::unlocked();
        bench.write(CR, cr::PER | cr::STRT | cr::EOPIE).unwrap();
        assert_eq!((bench.status(), bench.memory.flash()[0]), (sr::BSY, 0));
        let took = bench.finish();
        assert_eq!(took, ERASE.0);
        assert_eq!((bench.status(), bench.memory.flash()[0]), (sr::EOP, ERASED));
        assert_eq!(lock(&bench.flash).bytes()[PAGE - 1], ERASED);
    }

    #[test]
    fn operations_take_the_time_of_the_timing() {
        for (timing, takes) in [(Timing::Typical, ERASE.0), (Timing::Worst, ERASE.1)] {
            let mut bench = Bench::unlocked();
            lock(&bench.flash).clock = Clock::new(timing, 0);
            bench.write(CR, cr::PER | cr::STRT).unwrap();
            assert_eq!(bench.finish(), takes);
            assert_eq!(lock(&bench.flash).erases, [(Nanos(0), takes)]);
        }
    }

    #[test]
    fn two_words_program_a_double_word() {
        let mut bench = Bench::unlocked();
        bench.write(CR, cr::PG).unwrap();
        bench.store(PAGE as u32, 0x1234_5678).unwrap();
        assert!(!bench.interface.is_busy());
        bench.store(PAGE as u32 + 4, 0x9ABC_DEF0).unwrap();
        let took = bench.finish();
        assert_eq!(took, PROGRAM.0);
        assert_eq!(
            bench.memory.flash()[PAGE..PAGE + 8],
            [0x78, 0x56, 0x34, 0x12, 0xF0, 0xDE, 0xBC, 0x9A]
        );
    }

    #[test]
    fn stores_that_the_manual_forbids_set_their_flags() {
        let mut bench = Bench::new();
        assert!(bench.store(PAGE as u32, 0).is_err());
        assert_eq!(bench.status(), sr::PGSERR);
        let mut bench = Bench::unlocked();
        bench.write(CR, cr::PG).unwrap();
        assert!(bench.interface.store(PAGE as u32, Width::Half, 0, Nanos(0)).is_err());
        assert!(bench.store(PAGE as u32 + 4, 0).is_err());
        bench.store(0, 1).unwrap();
        assert!(bench.store(4, 0).is_err());
        assert_eq!(bench.status(), sr::SIZERR | sr::PGAERR | sr::PROGERR);
    }

    #[test]
    fn wrong_key_locks_until_the_next_reset() {
        let mut bench = Bench::new();
        assert!(bench.write(KEYR, KEYS[1]).is_err());
        assert!(bench.write(KEYR, KEYS[0]).is_err());
        assert!(bench.write(CR, cr::PG).is_err());
        bench.interface.reset(Nanos(0));
        bench.write(KEYR, KEYS[0]).unwrap();
        bench.write(KEYR, KEYS[1]).unwrap();
        bench.write(CR, cr::PG).unwrap();
    }

    #[test]
    fn interrupted_double_word_fails_ecc_until_erased() {
        let mut bench = Bench::unlocked();
        bench.write(CR, cr::PG).unwrap();
        bench.store(PAGE as u32, 0).unwrap();
        bench.store(PAGE as u32 + 4, 0).unwrap();
        bench.interface.restart(&mut bench.memory);
        assert!(bench.interface.check_read(PAGE as u32 + 4));
        assert!(!bench.interface.check_read(PAGE as u32 + 8));
        assert_eq!(bench.interface.read(ECCR, Nanos(0)), Ok(eccr::ECCD | PAGE as u32));
        bench.write(ECCR, eccr::ECCD).unwrap();
        bench.write(KEYR, KEYS[0]).unwrap();
        bench.write(KEYR, KEYS[1]).unwrap();
        bench.write(CR, cr::PER | 1 << cr::PNB_AT | cr::STRT).unwrap();
        bench.finish();
        assert!(!bench.interface.check_read(PAGE as u32 + 4));
    }

    #[test]
    fn interrupted_operation_corrupts_ecc_register_as_chosen() {
        let reported = |register| {
            let mut bench = Bench::with(register);
            bench.unlock();
            bench.write(CR, cr::PG).unwrap();
            bench.store(PAGE as u32, 0).unwrap();
            bench.store(PAGE as u32 + 4, 0).unwrap();
            bench.interface.restart(&mut bench.memory);
            assert!(bench.interface.check_read(PAGE as u32), "{register:?}");
            bench.interface.read(ECCR, Nanos(0)).unwrap()
        };
        let exact = eccr::ECCD | PAGE as u32;
        assert_eq!(reported(EccRegister::Correct), exact);
        assert_eq!(reported(EccRegister::NoAddress), eccr::ECCD);
        let other = reported(EccRegister::OtherAddress);
        assert_eq!(other & !eccr::ADDR_ECC, eccr::ECCD);
        assert_ne!(other, exact);
        let random = reported(EccRegister::Random);
        assert_eq!(random & !eccr::ALL, 0);
        assert_ne!(random, exact);
    }

    #[test]
    fn missing_page_cannot_be_erased() {
        let mut bench = Bench::unlocked();
        assert!(bench.write(CR, cr::PER | 64 << cr::PNB_AT | cr::STRT).is_err());
        assert!(!bench.interface.is_busy());
    }
}
