//! The firmware's clock tree, and the reset flags (RM0090, chapter 7).

use super::*;

const CR: u32 = RCC;
const PLLCFGR: u32 = RCC + 0x04;
const CFGR: u32 = RCC + 0x08;
const APB1RSTR: u32 = RCC + 0x20;
const AHB1RSTR: u32 = RCC + 0x10;
const AHB2RSTR: u32 = RCC + 0x14;
const AHB3RSTR: u32 = RCC + 0x18;
const AHB2ENR: u32 = RCC + 0x34;
const AHB3ENR: u32 = RCC + 0x38;
const APB2RSTR: u32 = RCC + 0x24;
const APB2ENR: u32 = RCC + 0x44;
const CSR: u32 = RCC + 0x74;
const ACR: u32 = 0x4002_3C00;

const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
const PLLON: u32 = 1 << 24;
const PLLRDY: u32 = 1 << 25;

/// 8 MHz / 4 × 168 / 2, and / 7 for USB, from the crystal (7.3.2).
const PLL: u32 = 4 | 168 << 6 | 1 << 22 | 7 << 24;
/// The core from the PLL, APB1 a quarter, APB2 a half of it (7.3.3).
const TREE: u32 = 2 | 5 << 10 | 4 << 13;

/// Reset flags of CSR, and the bit that clears them (7.3.21).
const SOFTWARE: u32 = 1 << 28;
const WATCHDOG: u32 = 1 << 29;
const POWER: u32 = 1 << 27;
const RMVF: u32 = 1 << 24;

/// Runs until `flag` of CR is set.
fn wait(bench: &mut Bench, flag: u32) {
    let start = bench.now;
    while bench.read(CR) & flag == 0 {
        assert!(bench.now.since(start) < Nanos::from_millis(10), "{flag:#x}");
        bench.run_until(bench.now + Nanos(1_000));
    }
}

fn tree(pll: u32) -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    bench.write(ACR, 5);
    let control = bench.read(CR);
    bench.write(CR, control | HSEON);
    wait(&mut bench, HSERDY);
    bench.write(PLLCFGR, pll);
    let control = bench.read(CR);
    bench.write(CR, control | PLLON);
    wait(&mut bench, PLLRDY);
    bench.write(CFGR, TREE);
    assert_eq!(bench.read(CFGR) >> 2 & 3, 2, "SWS: the PLL drives the core");
    bench
}

#[test]
fn firmware_clock_tree_gives_uart_42_mhz() {
    let mut bench = tree(PLL);
    bench.write(USART_BRR, 42);
    assert_eq!(lock(&bench.line).board_baud(), Some(1_000_000));
}

#[test]
fn usb_needs_the_48_megahertz_of_the_pll() {
    for (pll, runs) in [(PLL, true), (PLL + (1 << 24), false)] {
        let mut bench = tree(pll);
        bench.write(AHB2ENR, 1 << 7);
        // GCCFG: PWRDWN and NOVBUSSENS.
        bench.write(0x5000_0038, 1 << 16 | 1 << 21);
        lock(&bench.host).set_cable(true);
        bench.run_until(bench.now + Nanos::from_millis(1));
        assert_eq!(lock(&bench.host).connected(), runs);
    }
}

#[test]
fn too_few_flash_wait_states_are_reported() {
    let mut bench = Bench::new(Reenabled::Restarts);
    let mut reported = |latency: u32| {
        bench.write(ACR, latency);
        bench.drain_violations()
    };
    assert_eq!(reported(0), 0, "16 MHz");
    let mut bench = tree(PLL);
    assert!((bench.drain_violations() == 0));
    bench.write(ACR, 4);
    assert_eq!(bench.drain_violations(), 1, "168 MHz takes five (3.5.1)");
}

#[test]
fn peripheral_held_in_reset_restarts() {
    let mut bench = Bench::new(Reenabled::Restarts);
    assert_ne!(bench.read(USART_CR1), 0);
    bench.write(APB1RSTR, 1 << 17);
    bench.write(APB1RSTR, 0);
    assert_eq!((bench.read(USART_CR1), bench.read(USART_BRR)), (0, 0));
    assert_eq!(bench.read(USART_SR), 0xC0, "TXE and TC");
}

/// Returns true if a peripheral refuses a read that begins this number of cycles after the write that enables its clock.
fn is_refused_after(
    bench: &mut Bench,
    (enable, mask, address): (u32, u32, u32),
    cycles: u64,
    reads_back: bool,
) -> bool {
    let before = bench.part.recorder().violations().len();
    let mut access = bench.access(enable, Width::Word);
    bench.part.write(access, mask, &mut bench.memory).unwrap();
    if reads_back {
        access.cycle += 1;
        bench.part.read(access, &mut bench.memory).unwrap();
    }
    access.address = address;
    access.cycle += cycles;
    bench.part.read(access, &mut bench.memory).unwrap();
    bench.part.recorder().violations().len() > before
}

#[test]
fn clock_runs_some_cycles_after_its_enable() {
    // GPIOA, TIM5 and TIM11, and the cycles between: two on the AHB, 1 and the prescaler on an APB.
    for (place, wait) in [
        ((RCC_AHB1ENR, 1, MODER), 2),
        ((RCC_APB1ENR, 1 << 3, 0x4000_0C00), 1 + 4),
        ((APB2ENR, 1 << 18, TIM11), 1 + 2),
    ] {
        for cycles in 1..10 {
            let refused = is_refused_after(&mut tree(PLL), place, cycles, false);
            assert_eq!(refused, cycles <= wait, "{cycles} cycles, {place:x?}");
        }
        assert!(!is_refused_after(&mut tree(PLL), place, 1, true), "{place:x?}");
    }
}

#[test]
fn reset_flags_name_cause_until_removed() {
    let mut bench = Bench::new(Reenabled::Restarts);
    assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), POWER);
    bench.write(CSR, RMVF);
    assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), 0);
    for (cause, flags) in [
        (Cause::Watchdog, WATCHDOG),
        (Cause::Software, WATCHDOG | SOFTWARE),
        (Cause::Power, POWER),
    ] {
        bench.restart(cause);
        bench.settle();
        assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), flags, "{cause:?}");
    }
}

/// TIM11, which captures the crystal's clock (7.2.11).
const TIM11: u32 = 0x4001_4800;
const TIM_CR1: u32 = TIM11;
const TIM_SR: u32 = TIM11 + 0x10;
const TIM_CCMR1: u32 = TIM11 + 0x18;
const TIM_CCER: u32 = TIM11 + 0x20;
const TIM_ARR: u32 = TIM11 + 0x2C;
const TIM_CCR1: u32 = TIM11 + 0x34;
const TIM_OR: u32 = TIM11 + 0x50;
const CC1IF: u32 = 1 << 1;
const CC1OF: u32 = 1 << 9;
const RTCPRE_AT: u32 = 16;

/// The chip with this crystal, switched on.
fn with_crystal(crystal: Crystal) -> Bench {
    let mut bench = Bench::new(Reenabled::Restarts);
    lock(&bench.oscillator).crystal = crystal;
    let control = bench.read(CR);
    bench.write(CR, control | HSEON);
    bench
}

fn is_ready(bench: &mut Bench) -> bool {
    bench.read(CR) & HSERDY != 0
}

#[test]
fn crystal_reads_on_and_becomes_ready_later() {
    let mut bench = with_crystal(Crystal::new(8_000_000));
    assert_eq!(bench.read(CR) & (HSEON | HSERDY), HSEON);
    bench.run_until(Nanos(1_999_000));
    assert!(!is_ready(&mut bench));
    bench.run_until(Nanos(2_002_000));
    assert!(is_ready(&mut bench));
    let control = bench.read(CR);
    bench.write(CR, control & !HSEON);
    assert_eq!(bench.read(CR) & (HSEON | HSERDY), 0);
}

#[test]
fn crystal_switched_off_during_startup_restarts() {
    let mut bench = with_crystal(Crystal::new(8_000_000));
    bench.run_until(Nanos(1_500_000));
    let control = bench.read(CR);
    bench.write(CR, control & !HSEON);
    bench.write(CR, control | HSEON);
    bench.run_until(Nanos(3_400_000));
    assert!(!is_ready(&mut bench));
    bench.run_until(Nanos(3_502_000));
    assert!(is_ready(&mut bench));
}

#[test]
fn dead_crystal_is_never_ready_until_replaced() {
    let mut bench = with_crystal(Crystal::dead());
    bench.run_until(Nanos::from_millis(5_000));
    assert!(!is_ready(&mut bench));
    lock(&bench.oscillator).crystal = Crystal::new(12_000_000);
    bench.run_until(Nanos::from_millis(5_003));
    assert!(is_ready(&mut bench));
}

/// Cycles of HSI between captures of every eighth edge of the crystal's clock divided by 30.
fn captured(bench: &mut Bench) -> u32 {
    let mut capture = || {
        while bench.read(TIM_SR) & CC1IF == 0 {
            bench.run_until(bench.now + Nanos(1_000));
        }
        bench.read(TIM_CCR1)
    };
    let first = capture();
    capture().wrapping_sub(first) & 0xFFFF
}

fn start_capturing(bench: &mut Bench) {
    bench.write(APB2ENR, 1 << 18);
    for (address, value) in [
        (CFGR, 30 << RTCPRE_AT),
        (TIM_OR, 2),
        (TIM_ARR, 0xFFFF),
        (TIM_CCMR1, 3 << 2 | 1),
        (TIM_CCER, 1),
        (TIM_CR1, 1),
    ] {
        bench.write(address, value);
    }
}

#[test]
fn timer_captures_divided_clock_of_running_crystal() {
    for (hertz, cycles) in [
        (8_000_000, 480..=480),
        (12_000_000, 320..=320),
        (16_000_000, 240..=240),
        (25_000_000, 153..=154),
    ] {
        let mut bench = with_crystal(Crystal::new(hertz));
        bench.run_until(Nanos::from_millis(3));
        start_capturing(&mut bench);
        for _ in 0..10 {
            let captured = captured(&mut bench);
            assert!(cycles.contains(&captured), "{hertz} Hz: {captured}");
        }
        assert!((bench.drain_violations() == 0));
    }
}

#[test]
fn unread_capture_is_flagged_at_the_next() {
    let mut bench = with_crystal(Crystal::new(8_000_000));
    bench.run_until(Nanos::from_millis(3));
    start_capturing(&mut bench);
    bench.run_until(bench.now + Nanos(31_000));
    assert_eq!(bench.read(TIM_SR) & (CC1IF | CC1OF), CC1IF);
    bench.run_until(bench.now + Nanos(60_000));
    assert_eq!(bench.read(TIM_SR) & (CC1IF | CC1OF), CC1IF | CC1OF);
    bench.read(TIM_CCR1);
    assert_eq!(bench.read(TIM_SR) & (CC1IF | CC1OF), CC1OF);
    bench.write(TIM_SR, 0);
    assert_eq!(bench.read(TIM_SR), 0);
}

#[test]
fn timer_needs_crystal_divider_and_input_to_capture() {
    let silent = |bench: &mut Bench| {
        bench.run_until(bench.now + Nanos::from_millis(1));
        assert_eq!(bench.read(TIM_SR), 0);
    };
    let mut bench = with_crystal(Crystal::dead());
    start_capturing(&mut bench);
    silent(&mut bench);
    for (address, value) in [(CFGR, 1 << RTCPRE_AT), (TIM_OR, 0), (TIM_CCER, 0), (TIM_CR1, 0)] {
        let mut bench = with_crystal(Crystal::new(8_000_000));
        bench.run_until(Nanos::from_millis(3));
        start_capturing(&mut bench);
        bench.write(address, value);
        bench.write(TIM_SR, 0);
        silent(&mut bench);
    }
    let mut bench = with_crystal(Crystal::new(8_000_000));
    bench.run_until(Nanos::from_millis(3));
    start_capturing(&mut bench);
    bench.write(APB2RSTR, 1 << 18);
    bench.write(APB2RSTR, 0);
    silent(&mut bench);
}

#[test]
fn crystal_measurement_with_core_on_crystal_is_reported() {
    let mut bench = tree(PLL);
    bench.write(APB2ENR, 1 << 18);
    bench.write(TIM_CCER, 1);
    assert_eq!(bench.drain_violations(), 1);
}

/// PA2's mode and level (8.4).
const MODER: u32 = 0x4002_0000;
const BSRR: u32 = 0x4002_0018;
const HIGH: u32 = 1 << 2;
const LOW: u32 = 1 << 18;
const OUTPUT: u32 = 1 << 4;
const ALTERNATE: u32 = 2 << 4;

#[test]
fn floating_arm_pin_is_reported() {
    // The violations for the UART's transmitter on or off, the pin's mode, and its level.
    let on = 1 << 13 | 1 << 3;
    for (steps, reported) in [
        (&[(USART_CR1, on), (MODER, ALTERNATE)][..], 0),
        (&[(USART_CR1, on), (MODER, ALTERNATE), (USART_CR1, 1 << 3)], 1),
        (&[(USART_CR1, on), (MODER, ALTERNATE), (USART_CR1, 1 << 13)], 1),
        (&[(USART_CR1, 0), (MODER, ALTERNATE)], 1),
        (
            &[
                (USART_CR1, 0),
                (BSRR, HIGH),
                (MODER, OUTPUT),
                (USART_CR1, on),
                (MODER, ALTERNATE),
            ],
            0,
        ),
        (&[(MODER, OUTPUT)], 1),
        (&[(BSRR, HIGH), (MODER, OUTPUT), (BSRR, LOW)], 1),
    ] {
        let mut bench = Bench::new(Reenabled::Restarts);
        let clocks = bench.read(RCC_AHB1ENR);
        bench.write(RCC_AHB1ENR, clocks | 1);
        for &(address, value) in steps {
            bench.write(address, value);
        }
        assert_eq!(bench.drain_violations(), reported, "{steps:x?}");
    }
}

/// Expects that each of these registers refuses this reserved bit, and keeps its content.
fn expect_refused(bits: &[(u32, u32)]) {
    for &(register, bit) in bits {
        let mut bench = Bench::new(Reenabled::Restarts);
        bench.write(AHB2ENR, 1 << 7);
        let before = bench.read(register);
        bench.drain_violations();
        bench.write(register, before | 1 << bit);
        assert_eq!(bench.drain_violations(), 1, "{register:#x}");
        assert_eq!(bench.read(register), before, "{register:#x}");
    }
}

#[test]
fn reserved_bits_of_rcc_cannot_be_set() {
    expect_refused(&[
        (RCC_AHB1ENR, 9),
        (AHB1RSTR, 20),
        (AHB2ENR, 8),
        (AHB2RSTR, 1),
        (AHB3ENR, 1),
        (AHB3RSTR, 1),
        (RCC_APB1ENR, 24),
        (APB1RSTR, 31),
        (APB2ENR, 13),
        (APB2RSTR, 9),
        (PLLCFGR, 15),
        (PLLCFGR, 28),
    ]);
}

#[test]
fn reserved_bits_of_otg_cannot_be_set() {
    const OTG: u32 = 0x5000_0000;
    expect_refused(
        &[
            (0x000, 2),
            (0x004, 0),
            (0x008, 1),
            (0x00C, 7),
            (0x010, 3),
            (0x018, 0),
            (0x024, 16),
            (0x038, 17),
            (0x800, 3),
            (0x804, 12),
            (0x810, 2),
            (0x814, 2),
            (0x834, 16),
            // DIEPCTL, DIEPINT, DIEPTSIZ, DOEPCTL, DOEPINT and DOEPTSIZ of endpoint 0, which has fewer, and of 1.
            (0x900, 16),
            (0x908, 2),
            (0x910, 7),
            (0x920, 20),
            (0x928, 2),
            (0x930, 31),
            (0xB00, 28),
            (0xB08, 2),
            (0xB10, 20),
            (0xB20, 22),
            (0xB28, 2),
            (0xB30, 31),
            (0xE00, 2),
        ]
        .map(|(offset, bit)| (OTG + offset, bit)),
    );
}
