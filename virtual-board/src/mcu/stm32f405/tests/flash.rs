//! The flash interface, register by register (RM0090, 3.6).

use super::*;
use crate::flash::SIZE;

const ACR: u32 = 0x4002_3C00;
const KEYR: u32 = 0x4002_3C04;
const SR: u32 = 0x4002_3C0C;
const CR: u32 = 0x4002_3C10;
const OPTKEYR: u32 = 0x4002_3C08;
const OPTCR: u32 = 0x4002_3C14;

const DCEN: u32 = 1 << 10;
const DCRST: u32 = 1 << 12;

const PG: u32 = 1 << 0;
const SER: u32 = 1 << 1;
const MER: u32 = 1 << 2;
const SNB_AT: u32 = 3;
const X32: u32 = 2 << 8;
const STRT: u32 = 1 << 16;
const EOPIE: u32 = 1 << 24;
const ERRIE: u32 = 1 << 25;
const LOCK: u32 = 1 << 31;

const EOP: u32 = 1 << 0;
const OPERR: u32 = 1 << 1;
const WRPERR: u32 = 1 << 4;
const PGPERR: u32 = 1 << 6;
const PGSERR: u32 = 1 << 7;
const BSY: u32 = 1 << 16;

const SECTOR_1: u32 = 0x0800_4000;

fn unlocked() -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(KEYR, 0x4567_0123);
    bench.write(KEYR, 0xCDEF_89AB);
    assert_eq!(bench.read(CR) & LOCK, 0);
    bench
}

impl Bench {
    fn run_for(&mut self, span: Nanos) {
        self.run_until(self.now + span);
    }

    fn fill(&mut self, byte: u8) {
        *lock(&self.flash) = Flash::new(vec![byte; SIZE], None, Clock::default());
        self.memory.program(0, &vec![byte; SIZE]).unwrap();
    }

    fn flash_word(&self, address: u32) -> u32 {
        let at = (address - 0x0800_0000) as usize;
        u32::from_le_bytes(lock(&self.flash).bytes()[at..at + 4].try_into().unwrap())
    }
}

#[test]
fn erase_sets_only_its_sector_after_its_time() {
    for (sector, start, bytes, millis) in [
        (0, 0u32, 16 << 10, 250u64),
        (1, 0x4000, 16 << 10, 250),
        (4, 0x1_0000, 64 << 10, 550),
        (11, 0xE_0000, 128 << 10, 1_000),
    ] {
        let mut bench = unlocked();
        bench.fill(0);
        bench.write(CR, SER | sector << SNB_AT | X32);
        bench.write(CR, SER | sector << SNB_AT | X32 | STRT | EOPIE);
        assert_eq!(bench.read(SR), BSY);
        assert!(bench.part.peripherals.flash.is_busy());
        bench.run_for(Nanos(millis * 1_000_000 - 1));
        assert_eq!(bench.read(SR), BSY);
        assert_eq!(bench.flash_word(0x0800_0000 + start), 0);
        bench.run_for(Nanos(1));
        assert_eq!((bench.read(SR), bench.read(CR) & STRT), (EOP, 0), "sector {sector}");
        let erased = start as usize..(start + bytes) as usize;
        for (at, &byte) in lock(&bench.flash).bytes().iter().enumerate() {
            assert_eq!(byte, if erased.contains(&at) { 0xFF } else { 0 }, "{at:#x}");
        }
        assert_eq!(bench.byte(0x0800_0000 + start), 0xFF, "as read by the core");
        assert!(!bench.part.peripherals.flash.is_busy());
    }
}

#[test]
fn data_cache_keeps_erased_word_until_its_reset() {
    let mut bench = unlocked();
    bench.fill(0x5A);
    bench.write(ACR, DCEN);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    bench.run_for(Nanos::from_millis(250));
    assert_eq!(bench.flash_word(SECTOR_1), !0);
    assert_eq!(bench.read(SECTOR_1), 0x5A5A_5A5A);
    bench.write(ACR, 0);
    assert_eq!(bench.read(SECTOR_1), !0, "past the cache");
    bench.write(ACR, DCEN);
    assert_eq!(bench.read(SECTOR_1), 0x5A5A_5A5A);
    for value in [0, DCRST, 0, DCEN] {
        bench.write(ACR, value);
    }
    assert_eq!(bench.read(SECTOR_1), !0);
    assert_eq!(bench.drain_violations(), 0);
}

#[test]
fn data_cache_that_was_never_enabled_is_empty() {
    let mut bench = unlocked();
    bench.fill(0x5A);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    bench.run_for(Nanos::from_millis(250));
    bench.write(ACR, DCEN);
    assert_eq!(bench.read(SECTOR_1), !0);
}

#[test]
fn write_changes_flash_and_data_cache() {
    let mut bench = unlocked();
    bench.fill(0xFF);
    bench.write(ACR, DCEN);
    bench.write(CR, PG | X32);
    bench.store(SECTOR_1, Width::Word, 0x1234_5678);
    bench.run_for(Nanos(16_000));
    assert_eq!(bench.read(SECTOR_1), 0x1234_5678);
}

#[test]
fn cache_in_use_cannot_be_reset() {
    let mut bench = unlocked();
    bench.write(ACR, DCEN);
    bench.write(ACR, DCEN | DCRST);
    assert_eq!(bench.drain_violations(), 1);
}

#[test]
fn reset_empties_data_cache() {
    let mut bench = unlocked();
    bench.fill(0x5A);
    bench.write(ACR, DCEN);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    bench.run_for(Nanos::from_millis(250));
    bench.restart(Cause::Software);
    bench.write(ACR, DCEN);
    assert_eq!(bench.read(SECTOR_1), !0);
}

#[test]
fn mass_erase_sets_everything() {
    let mut bench = unlocked();
    bench.fill(0);
    bench.write(CR, MER | X32 | STRT);
    bench.run_for(Nanos::from_millis(8_000));
    assert!(lock(&bench.flash).bytes().iter().all(|&byte| byte == 0xFF));
}

#[test]
fn missing_sector_is_not_erased() {
    for sector in [12, 15] {
        let mut bench = unlocked();
        bench.fill(0);
        bench.write(CR, SER | sector << SNB_AT | X32 | STRT);
        assert_eq!(bench.read(SR), WRPERR, "{sector}");
        assert!(lock(&bench.flash).bytes().iter().all(|&byte| byte == 0));
    }
}

#[test]
fn programming_clears_bits_and_sets_none() {
    let mut bench = unlocked();
    bench.fill(0xFF);
    bench.write(CR, PG | X32);
    for (stored, holds) in [
        (0x1234_5678, 0x1234_5678),
        (0xFFFF_FFFF, 0x1234_5678),
        (0xFF00_00FF, 0x1200_0078),
    ] {
        bench.store(SECTOR_1 + 4, Width::Word, stored);
        assert_eq!(bench.read(SR), BSY);
        bench.run_for(Nanos(15_999));
        assert_eq!(bench.read(SR), BSY);
        bench.run_for(Nanos(1));
        assert_eq!(bench.read(SR), 0, "no EOP without EOPIE");
        assert_eq!(bench.flash_word(SECTOR_1 + 4), holds);
    }
    assert_eq!((bench.flash_word(SECTOR_1), bench.flash_word(SECTOR_1 + 8)), (!0, !0));
    bench.write(CR, PG | EOPIE);
    bench.store(SECTOR_1 + 9, Width::Byte, 0x42);
    bench.run_for(Nanos(16_000));
    assert_eq!(bench.read(SR), EOP);
    assert_eq!(bench.flash_word(SECTOR_1 + 8), 0xFFFF_42FF);
    assert_eq!(bench.byte(SECTOR_1 + 9), 0x42, "as read by the core");
}

#[test]
fn misfit_store_is_flagged_without_effect() {
    let mut bench = unlocked();
    bench.fill(0xFF);
    for (control, address, width, flag) in [
        (0, SECTOR_1, Width::Word, PGSERR),
        (PG, SECTOR_1, Width::Word, PGPERR),
        (PG | X32, SECTOR_1, Width::Byte, PGPERR),
    ] {
        bench.write(CR, control);
        bench.store(address, width, 0);
        assert_eq!(bench.read(SR), flag);
        bench.write(SR, flag);
        bench.write(CR, control | ERRIE);
        bench.store(address, width, 0);
        assert_eq!(bench.read(SR), flag | OPERR);
        bench.write(SR, flag | OPERR);
    }
    bench.write(CR, LOCK);
    bench.store(SECTOR_1, Width::Word, 0);
    assert_eq!(bench.read(SR), PGSERR);
    assert!(lock(&bench.flash).bytes().iter().all(|&byte| byte == 0xFF));
}

#[test]
fn protected_sector_is_neither_erased_nor_programmed() {
    let mut bench = unlocked();
    bench.fill(0x0F);
    bench.write(OPTKEYR, 0x0819_2A3B);
    bench.write(OPTKEYR, 0x4C5D_6E7F);
    // nWRP of sector 1 is bit 17.
    let options = bench.read(OPTCR) & !(1 << 17);
    bench.write(OPTCR, options | 2);
    bench.run_for(Nanos::from_millis(1));
    bench.write(CR, PG | X32);
    bench.store(SECTOR_1, Width::Word, 0);
    assert_eq!(bench.read(SR), WRPERR);
    bench.write(SR, WRPERR);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    assert_eq!(bench.read(SR), WRPERR);
    bench.run_for(Nanos::from_millis(300));
    assert_eq!(bench.flash_word(SECTOR_1), 0x0F0F_0F0F);
}

#[test]
fn reset_leaves_an_operation_half_done() {
    let mut bench = unlocked();
    bench.fill(0);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    bench.run_for(Nanos::from_millis(100));
    bench.restart(Cause::Watchdog);
    bench.settle();
    let flash = lock(&bench.flash);
    let sector = &flash.bytes()[0x4000..0x8000];
    assert!(sector.contains(&0) && sector.contains(&0xFF));
    assert!(flash.bytes()[0x8000..].iter().all(|&byte| byte == 0));
    drop(flash);
    assert!(!bench.part.peripherals.flash.is_busy());
}

#[test]
fn wrong_key_locks_control_register_until_reset() {
    for keys in [&[0x4567_0123, 0x4567_0123][..], &[0xCDEF_89AB], &[0]] {
        let mut bench = Bench::new(Reenabled::Restarts);
        for &key in keys.iter().chain(&[0x4567_0123, 0xCDEF_89AB]) {
            bench.write(KEYR, key);
        }
        assert_eq!(bench.read(CR) & LOCK, LOCK, "{keys:x?}");
        bench.write(CR, PG | X32);
        assert_eq!(bench.read(CR), LOCK, "nothing else is written");
        bench.restart(Cause::Software);
        bench.settle();
        bench.write(KEYR, 0x4567_0123);
        bench.write(KEYR, 0xCDEF_89AB);
        assert_eq!(bench.read(CR) & LOCK, 0);
    }
}

#[test]
fn locked_interface_neither_erases_nor_programs() {
    let mut bench = unlocked();
    bench.fill(0);
    bench.write(CR, LOCK);
    bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    bench.run_for(Nanos::from_millis(300));
    bench.store(SECTOR_1, Width::Word, 0x1234_5678);
    bench.run_for(Nanos::from_millis(1));
    assert!(lock(&bench.flash).bytes().iter().all(|&byte| byte == 0));
    assert_eq!(bench.read(SR), PGSERR);
}

#[test]
fn each_width_programs_its_own_bytes() {
    for (size, width, value, holds) in [
        (0, Width::Byte, 0x12, 0xFFFF_FF12),
        (1, Width::Half, 0x1234, 0xFFFF_1234),
        (2, Width::Word, 0x1234_5678, 0x1234_5678),
    ] {
        let mut bench = unlocked();
        bench.fill(0xFF);
        bench.write(CR, PG | size << 8);
        bench.store(SECTOR_1, width, value);
        bench.run_for(Nanos(16_000));
        assert_eq!((bench.read(SR), bench.flash_word(SECTOR_1)), (0, holds));
    }
}

#[test]
fn error_stays_until_one_is_written() {
    let mut bench = unlocked();
    bench.store(SECTOR_1, Width::Word, 0);
    bench.write(CR, PG);
    bench.store(SECTOR_1, Width::Word, 0);
    assert_eq!(bench.read(SR), PGSERR | PGPERR);
    bench.write(SR, PGPERR);
    assert_eq!(bench.read(SR), PGSERR);
    bench.write(SR, PGSERR);
    assert_eq!(bench.read(SR), 0);
}

/// The duration of an operation with this timing.
fn lasts(timing: Timing, seed: u64, start: impl Fn(&mut Bench)) -> Nanos {
    let mut bench = unlocked();
    *lock(&bench.flash) = Flash::new(vec![0xFF; SIZE], None, Clock::new(timing, seed));
    start(&mut bench);
    let begin = bench.now;
    while bench.part.peripherals.flash.is_busy() {
        let next = bench.part.next_event();
        bench.run_until(next);
    }
    bench.now.since(begin)
}

#[test]
fn operation_takes_typical_to_maximum_time() {
    let erase = |bench: &mut Bench| bench.write(CR, SER | 1 << SNB_AT | X32 | STRT);
    let program = |bench: &mut Bench| {
        bench.write(CR, PG | X32);
        bench.store(SECTOR_1, Width::Word, 0);
    };
    for (start, typical, worst) in [
        (
            &erase as &dyn Fn(&mut Bench),
            Nanos::from_millis(250),
            Nanos::from_millis(500),
        ),
        (&program, Nanos(16_000), Nanos(100_000)),
    ] {
        assert_eq!(lasts(Timing::Typical, 1, start), typical);
        assert_eq!(lasts(Timing::Worst, 1, start), worst);
        let drawn: Vec<Nanos> = (0..8).map(|seed| lasts(Timing::Drawn, seed, start)).collect();
        assert!(drawn.iter().all(|span| (typical..=worst).contains(span)), "{drawn:?}");
        assert!(drawn.iter().any(|span| *span != drawn[0]), "{drawn:?}");
    }
}

#[test]
fn operation_below_supply_is_reported_and_fails() {
    for (millivolts, reported) in [(2_700, 0), (2_699, 1)] {
        let mut bench = unlocked();
        bench.fill(0xFF);
        lock(&bench.flash).millivolts = millivolts;
        bench.run_for(Nanos(1_000));
        bench.write(CR, PG | X32);
        for word in 0..16 {
            bench.store(SECTOR_1 + 4 * word, Width::Word, 0);
            bench.run_for(Nanos(16_000));
        }
        let right = (0..16)
            .filter(|word| bench.flash_word(SECTOR_1 + 4 * word) == 0)
            .count();
        assert_eq!(right == 16, reported == 0, "{right} words");
        assert_eq!((bench.drain_violations() == 0), reported == 0);
    }
}

#[test]
fn voltage_detector_follows_the_supply() {
    const PWR_CR: u32 = 0x4000_7000;
    const PWR_CSR: u32 = 0x4000_7004;
    const PVDO: u32 = 1 << 2;
    let mut bench = unlocked();
    let clocks = bench.read(RCC_APB1ENR);
    bench.write(RCC_APB1ENR, clocks | 1 << 28);
    // PVDE, PLS 110.
    bench.write(PWR_CR, 6 << 5 | 1 << 4);
    for (millivolts, is_low) in [
        (3_300, false),
        (2_940, false),
        (2_900, true),
        (3_000, true),
        (3_050, false),
    ] {
        lock(&bench.flash).millivolts = millivolts;
        bench.run_for(Nanos(1_000));
        assert_eq!(bench.read(PWR_CSR) & PVDO != 0, is_low, "{millivolts} mV");
    }
}
