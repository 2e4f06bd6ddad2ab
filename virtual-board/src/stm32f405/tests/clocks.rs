//! The clock tree that the firmware sets up, and the flags that say why the part started (RM0090, chapter 7).

use super::*;

const RCC: u64 = 0x4002_3800;
const CR: u64 = RCC;
const PLLCFGR: u64 = RCC + 0x04;
const CFGR: u64 = RCC + 0x08;
const APB1RSTR: u64 = RCC + 0x20;
const AHB2ENR: u64 = RCC + 0x34;
const CSR: u64 = RCC + 0x74;
const ACR: u64 = 0x4002_3C00;

const HSEON: u64 = 1 << 16;
const HSERDY: u64 = 1 << 17;
const PLLON: u64 = 1 << 24;
const PLLRDY: u64 = 1 << 25;

/// 8 MHz / 4 × 168 / 2, and / 7 for USB, from the crystal (7.3.2).
const PLL: u64 = 4 | 168 << 6 | 1 << 22 | 7 << 24;
/// The core from the PLL, APB1 a quarter, APB2 a half of it (7.3.3).
const TREE: u64 = 2 | 5 << 10 | 4 << 13;

/// Reset flags of CSR, and what clears them (7.3.21).
const SOFTWARE: u64 = 1 << 28;
const WATCHDOG: u64 = 1 << 29;
const POWER: u64 = 1 << 27;
const RMVF: u64 = 1 << 24;

/// Runs until `flag` of CR is up.
fn wait(bench: &mut Bench, flag: u64) {
    let start = bench.now;
    while bench.read(CR) & flag == 0 {
        assert!(bench.now.since(start) < Nanos::from_millis(10), "{flag:#x}");
        bench.run_until(bench.now + Nanos(1_000));
    }
}

fn tree(pll: u64) -> Bench {
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
fn the_firmwares_clock_tree_gives_the_arms_uart_42_megahertz() {
    let mut bench = tree(PLL);
    bench.write(USART_BRR, 42);
    assert_eq!(port::lock(&bench.line).board_baud(), Some(1_000_000));
}

#[test]
fn usb_needs_the_48_megahertz_of_the_pll() {
    for (pll, runs) in [(PLL, true), (PLL + (1 << 24), false)] {
        let mut bench = tree(pll);
        bench.write(AHB2ENR, 1 << 7);
        // GCCFG: PWRDWN and NOVBUSSENS.
        bench.write(0x5000_0038, 1 << 16 | 1 << 21);
        port::lock(&bench.host).set_cable(true);
        bench.run_until(bench.now + Nanos::from_millis(1));
        assert_eq!(port::lock(&bench.host).connected(), runs);
    }
}

#[test]
fn too_few_wait_states_for_the_clock_are_told() {
    let mut bench = Bench::new(Reenabled::Restarts);
    let mut told = |latency: u64| {
        bench.write(ACR, latency);
        bench.part.drain_told().len()
    };
    assert_eq!(told(0), 0, "16 MHz");
    let mut bench = tree(PLL);
    assert!(bench.part.drain_told().is_empty());
    bench.write(ACR, 4);
    assert_eq!(bench.part.drain_told().len(), 1, "168 MHz takes five (3.5.1)");
}

#[test]
fn a_peripheral_that_is_held_in_reset_starts_over() {
    let mut bench = Bench::new(Reenabled::Restarts);
    assert_ne!(bench.read(USART_CR1), 0);
    bench.write(APB1RSTR, 1 << 17);
    bench.write(APB1RSTR, 0);
    assert_eq!((bench.read(USART_CR1), bench.read(USART_BRR)), (0, 0));
    assert_eq!(bench.read(USART_SR), 0xC0, "TXE and TC");
}

#[test]
fn the_reset_flags_name_the_cause_until_they_are_removed() {
    let mut bench = Bench::new(Reenabled::Restarts);
    assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), POWER);
    bench.write(CSR, RMVF);
    assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), 0);
    for (cause, flags) in [
        (ResetCause::Model("IWDG"), WATCHDOG),
        (ResetCause::Core, WATCHDOG | SOFTWARE),
        (ResetCause::PowerOn, POWER),
    ] {
        bench.part.reset(bench.now.into(), cause);
        bench.settle();
        assert_eq!(bench.read(CSR) & (POWER | WATCHDOG | SOFTWARE), flags, "{cause:?}");
    }
}
