//! TIM5, the firmware's clock (RM0090, chapter 18), and the independent watchdog (chapter 21).

use super::*;

const CR1: u32 = 0x4000_0C00;
const DIER: u32 = 0x4000_0C0C;
const SR: u32 = 0x4000_0C10;
const EGR: u32 = 0x4000_0C14;
const CNT: u32 = 0x4000_0C24;
const PSC: u32 = 0x4000_0C28;
const ARR: u32 = 0x4000_0C2C;
const CCR1: u32 = 0x4000_0C34;
const CCR2: u32 = 0x4000_0C38;

const UIF: u32 = 1 << 0;
const CC1IF: u32 = 1 << 1;
const CC2IF: u32 = 1 << 2;

/// TIM5 at 1 MHz from the initial 16 MHz, running from 0.
fn timer() -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    for (register, value) in [
        (RCC_APB1ENR, 1 << 17 | 1 << 3),
        (PSC, 15),
        (ARR, 0xFFFF_FFFF),
        (CCR1, 0xFFFF_FFFF),
        (CCR2, 0xFFFF_FFFF),
        (EGR, 1),
        (SR, 0),
        (CR1, 1),
    ] {
        bench.write(register, value);
    }
    bench.drain_interrupts();
    bench
}

impl Bench {
    /// The last change of an interrupt line: true for a rising edge.
    fn rose(&mut self) -> Option<bool> {
        self.drain_interrupts().pop()
    }
}

#[test]
fn counter_wraps_at_32_bits_with_update() {
    let mut bench = timer();
    bench.run_until(Nanos(70_000_000));
    assert_eq!(bench.read(CNT), 70_000, "beyond 16 bits");
    bench.write(DIER, UIF);
    bench.write(CNT, 0xFFFF_FFFE);
    bench.run_until(Nanos(70_001_000));
    assert_eq!((bench.read(CNT), bench.read(SR) & UIF), (0xFFFF_FFFF, 0));
    bench.run_until(Nanos(70_001_999));
    assert_eq!(bench.rose(), None);
    bench.run_until(Nanos(70_002_000));
    assert_eq!((bench.read(CNT), bench.read(SR) & UIF), (0, UIF));
    assert_eq!(bench.rose(), Some(true));
}

#[test]
fn compare_interrupts_at_match_and_every_round() {
    let mut bench = timer();
    bench.write(ARR, 999);
    bench.write(CCR1, 100);
    bench.write(DIER, CC1IF);
    bench.run_until(Nanos(99_999));
    assert_eq!((bench.read(SR) & CC1IF, bench.rose()), (0, None));
    bench.run_until(Nanos(100_000));
    assert_eq!((bench.read(SR) & CC1IF, bench.rose()), (CC1IF, Some(true)));
    bench.write(SR, !CC1IF);
    assert_eq!((bench.read(SR) & CC1IF, bench.rose()), (0, Some(false)));
    bench.run_until(Nanos(1_099_999));
    assert_eq!(bench.read(SR) & (UIF | CC1IF), UIF);
    bench.run_until(Nanos(1_100_000));
    assert_eq!(bench.read(SR) & CC1IF, CC1IF);
}

#[test]
fn passed_compare_value_matches_in_next_round() {
    let mut bench = timer();
    bench.run_until(Nanos(500_000));
    bench.write(DIER, CC1IF);
    bench.write(CCR1, 499);
    bench.run_until(Nanos(10_000_000));
    assert_eq!((bench.read(SR) & CC1IF, bench.rose()), (0, None));
}

#[test]
fn zero_clears_its_flag_one_sets_none() {
    let mut bench = timer();
    bench.write(CCR1, 10);
    bench.write(CCR2, 20);
    bench.run_until(Nanos(30_000));
    assert_eq!(bench.read(SR), CC1IF | CC2IF);
    bench.write(SR, !CC2IF);
    assert_eq!(bench.read(SR), CC1IF);
    bench.write(SR, 0xFFFF_FFFF);
    assert_eq!(bench.read(SR), CC1IF);
}

#[test]
fn prescaler_waits_for_an_update() {
    let mut bench = timer();
    bench.write(PSC, 159);
    bench.run_until(Nanos(100_000));
    assert_eq!(bench.read(CNT), 100, "a megahertz still");
    bench.write(EGR, 1);
    assert_eq!(bench.read(CNT), 0, "UG starts over");
    bench.run_until(Nanos(200_000));
    assert_eq!(bench.read(CNT), 10);
}

#[test]
fn counter_that_is_switched_off_stands() {
    let mut bench = timer();
    bench.run_until(Nanos(100_000));
    bench.write(CR1, 0);
    bench.run_until(Nanos(200_000));
    assert_eq!(bench.read(CNT), 100);
    bench.write(CR1, 1);
    bench.run_until(Nanos(300_000));
    assert_eq!(bench.read(CNT), 200);
}

const KR: u32 = 0x4000_3000;
const PR: u32 = 0x4000_3004;
const RLR: u32 = 0x4000_3008;
const IWDG_SR: u32 = 0x4000_300C;

/// Virtual time of this number of ticks of the 32 kHz LSI.
const fn ticks(count: u64) -> Nanos {
    Nanos(count * 31_250)
}

impl Bench {
    /// Writes the watchdog's prescaler and reload, and waits until they have crossed to its clock: PVU and RVU are
    /// clear.
    fn configure(&mut self, prescaler: u32, reload: u32) {
        self.write(PR, prescaler);
        self.write(RLR, reload);
        let start = self.now;
        while self.read(IWDG_SR) != 0 {
            assert!(self.now.since(start) < ticks(20));
            self.run_until(self.now + ticks(1));
        }
    }

    /// Returns true if the watchdog requested a reset.
    fn requests_reset(&mut self) -> bool {
        self.part.take_reset() == Some(Cause::Watchdog)
    }
}

#[test]
fn watchdogs_registers_open_with_their_key_alone() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(KR, 0xCCCC);
    bench.configure(3, 99);
    assert_eq!((bench.read(PR), bench.read(RLR)), (0, 0xFFF));
    bench.write(KR, 0x5555);
    bench.configure(3, 99);
    assert_eq!((bench.read(PR), bench.read(RLR)), (3, 99));
    bench.write(KR, 0xAAAA);
    bench.configure(4, 5);
    assert_eq!((bench.read(PR), bench.read(RLR)), (3, 99), "another key closes them");
}

#[test]
fn watchdog_resets_after_prescaler_times_reload_unless_fed() {
    // Prescaler 32, reload 100.
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(KR, 0xCCCC);
    bench.write(KR, 0x5555);
    bench.configure(3, 99);
    for _ in 0..3 {
        bench.write(KR, 0xAAAA);
        bench.run_until(bench.now + ticks(32 * 100 - 40));
        assert!(!bench.requests_reset());
    }
    bench.write(KR, 0xAAAA);
    let fed = bench.now;
    bench.run_until(fed + ticks(32 * 100 - 32));
    assert!(!bench.requests_reset());
    bench.run_until(fed + ticks(32 * 100));
    assert!(bench.requests_reset());
}

#[test]
fn started_watchdog_cannot_stop_unstarted_does_nothing() {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(KR, 0xAAAA);
    bench.run_until(Nanos::from_millis(2_000));
    assert!(!bench.requests_reset());
    bench.write(KR, 0xCCCC);
    bench.write(KR, 0);
    bench.write(KR, 0x5555);
    // 512 ms: prescaler 4, reload 4096 (table 107).
    bench.run_until(Nanos::from_millis(2_511));
    assert!(!bench.requests_reset());
    bench.run_until(Nanos::from_millis(2_513));
    assert!(bench.requests_reset());
}
