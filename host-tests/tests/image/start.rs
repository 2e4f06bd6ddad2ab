//! The start of the firmware image: with any crystal, without one, and after a hard fault.
//!
//! Only the STM32F405 has a revision whose prefetch does not work.

use armwire_host_tests::image::{
    MEGABAUD, RawArm, board_config, chip, counters, exchange, facts, on_board, on_board_with, plug_in,
};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::report::{Cause, Crash};
use armwire_virtual_board::{Chip, Config, Crystal, Error, Nanos, VirtualBoard};

type Board = VirtualBoard<RawArm>;

/// The bits of RCC_CR that enable the crystal and report that it runs (RM0090 7.3.1, RM0440 7.4.1).
const HSEON: u32 = 1 << 16;
const HSERDY: u32 = 1 << 17;
/// ODR of a port, which begins with MODER (RM0090 8.4, RM0440 9.4).
const ODR: u64 = 0x14;
const OUTPUT: u32 = 0b01;

/// The line to the arm.
const PA2: usize = 2;

/// Frequencies of supported crystals, in megahertz.
const CRYSTALS: [u32; 4] = [8, 12, 16, 25];

/// Period of the firmware's restarts of a crystal.
const RETRY_MS: u64 = 2_000;

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

fn config(crystal: Crystal) -> Config<RawArm> {
    Config {
        crystal,
        ..board_config(RawArm::default())
    }
}

/// The level of an output pin. `None` for an input.
fn output(board: &mut Board, port: u64, pin: usize) -> Option<bool> {
    let mode = board.read_word(port).unwrap() >> (2 * pin) & 0b11;
    let is_high = board.read_word(port + ODR).unwrap() >> pin & 1 != 0;
    (mode == OUTPUT).then_some(is_high)
}

fn expect_served(board: &mut Board) {
    plug_in(board, MEGABAUD);
    assert_eq!(board.uart().baud(), Some(MEGABAUD.into()));
    exchange(board, &[1, 2, 3, 4], &[5, 6, 7, 8]);
}

/// Runs with an unusable crystal, and returns the times of the LED's changes, in milliseconds since it was first switched
/// on.
fn expect_waiting(board: &mut Board, span: u64) -> Vec<u64> {
    const STEP: u64 = 5;
    let (port, led) = facts(chip()).registers().led;
    board.run_for(millis(STEP)).unwrap();
    let mut changes = Vec::new();
    let mut was_on = false;
    for at in (0..span).step_by(STEP as usize) {
        assert_eq!(
            output(board, facts(chip()).registers().gpioa, PA2),
            Some(true),
            "the line to the arm, after {at} ms"
        );
        let is_on = output(board, port, led).unwrap();
        if is_on != was_on {
            changes.push(at);
        }
        was_on = is_on;
        board.run_for(millis(STEP)).unwrap();
    }
    changes
}

/// Three flashes of 100 ms each 2 s.
fn expect_error_flashes(changes: &[u64], rounds: u64) {
    let expected: Vec<u64> = (0..rounds)
        .flat_map(|round| [200, 300, 500, 600, 800, 900].map(|at| round * RETRY_MS + at))
        .collect();
    assert_eq!(changes.len(), expected.len(), "{changes:?}");
    for (&change, expected) in changes.iter().zip(expected) {
        assert!(change.abs_diff(expected) <= 15, "{changes:?}");
    }
}

#[test]
fn one_image_runs_with_each_crystal() {
    for megahertz in CRYSTALS {
        on_board_with(config(Crystal::new(megahertz * 1_000_000)), |board| {
            board.run_for(millis(20)).unwrap();
            expect_served(board);
        });
    }
}

#[test]
fn crystal_is_known_with_internal_oscillator_off() {
    // −8 % and +4.5 %, over all temperatures (DS8626, 5.3.9). The STM32G431's is more accurate.
    for internal_hz in [14_720_000, 16_720_000] {
        for megahertz in CRYSTALS {
            let config = Config {
                internal_hz,
                ..config(Crystal::new(megahertz * 1_000_000))
            };
            on_board_with(config, |board| {
                board.run_for(millis(20)).unwrap();
                assert_eq!(
                    board.uart().baud(),
                    Some(1_000_000),
                    "{megahertz} MHz, HSI {internal_hz} Hz"
                );
            });
        }
    }
}

#[test]
fn dead_crystal_shows_on_led_and_is_retried() {
    on_board_with(config(Crystal::dead()), |board| {
        let changes = expect_waiting(board, 3 * RETRY_MS);
        expect_error_flashes(&changes, 3);
        let control = board.read_word(facts(chip()).registers().clock_control).unwrap();
        assert_eq!(control & (HSEON | HSERDY), HSEON);
        // The crystal starts to work, as with a repaired solder joint.
        board.set_crystal(Crystal::new(8_000_000));
        board.run_for(millis(RETRY_MS + 100)).unwrap();
        expect_served(board);
        let counters = counters(board);
        assert_eq!((counters.watchdog_resets, counters.panics), (0, 0));
    });
}

#[test]
fn unsupported_crystal_shows_on_led() {
    for hertz in [4_000_000, 6_500_000, 10_000_000, 14_000_000, 20_000_000] {
        on_board_with(config(Crystal::new(hertz)), |board| {
            let changes = expect_waiting(board, RETRY_MS);
            expect_error_flashes(&changes, 1);
        });
    }
}

#[test]
fn late_crystal_is_awaited() {
    for startup in [60, 500, 1_900] {
        let crystal = Crystal {
            startup: Some(millis(startup)),
            ..Crystal::new(8_000_000)
        };
        on_board_with(config(crystal), |board| {
            board.run_for(millis(startup - 5)).unwrap();
            assert_eq!(board.uart().baud(), None);
            board.run_for(millis(20)).unwrap();
            expect_served(board);
        });
    }
}

#[test]
fn prefetch_is_off_on_revision_a() {
    if chip() != Chip::Stm32f405 {
        return;
    }
    const FLASH_ACR: u64 = 0x4002_3C00;
    const PRFTEN: u32 = 1 << 8;
    for (idcode, prefetches) in [
        (0x1000_6413, false),
        (0x2000_6411, false),
        (0x1001_6413, true),
        (0x100F_6413, true),
    ] {
        let config = Config {
            idcode,
            ..config(Crystal::new(8_000_000))
        };
        on_board_with(config, |board| {
            board.run_for(millis(20)).unwrap();
            let control = board.read_word(FLASH_ACR).unwrap();
            assert_eq!(control & PRFTEN != 0, prefetches, "{idcode:#x}");
        });
    }
}

#[test]
fn core_sleeps_without_the_clock_of_a_debugger() {
    const DBGMCU_CR: u64 = 0xE004_2004;
    const DBG_SLEEP: u32 = 1 << 0;
    on_board(RawArm::default(), |board| {
        board.run_for(millis(50)).unwrap();
        assert_eq!(board.read_word(DBGMCU_CR).unwrap() & DBG_SLEEP, 0);
    });
}

#[test]
fn watchdog_watches_before_the_clocks_run() {
    let mut board = VirtualBoard::start(config(Crystal::dead())).unwrap();
    board.run_for(millis(10)).unwrap();
    board.hold_core();
    board.run_for(millis(4_200)).unwrap();
    let report = board.report();
    report.check().unwrap();
    let causes: Vec<_> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [Cause::Watchdog]);
    board.set_crystal(Crystal::new(8_000_000));
    board.run_for(millis(100)).unwrap();
    expect_served(&mut board);
    assert_eq!(counters(&mut board).watchdog_resets, 1);
}

#[test]
fn written_flash_and_lost_power_are_no_crashes() {
    let mut board = VirtualBoard::start(board_config(RawArm::default())).unwrap();
    let board = &mut board;
    for is_written in [false, false, false, false, true, true, true, true] {
        board.run_for(millis(200)).unwrap();
        match is_written {
            true => board.restart_after_flashing(),
            false => board.power_cycle().unwrap(),
        }
    }
    expect_served(board);
    let counters = counters(board);
    let crashes = [counters.watchdog_resets, counters.panics, counters.hard_faults];
    assert_eq!((crashes, counters.recovery_starts), ([0; 3], 0));
}

#[test]
fn service_that_stops_ends_in_watchdog_reset() {
    /// ICER1 of the NVIC, and SPI1, interrupt 35 of both chips.
    const DISABLE: u64 = 0xE000_E184;
    const SERVICE: u32 = 1 << (35 - 32);
    // The watchdog's oscillator (DS8626, 5.3.9).
    for lsi_hz in [17_000, 47_000] {
        let mut board = VirtualBoard::start(Config {
            lsi_hz,
            ..board_config(RawArm::default())
        })
        .unwrap();
        expect_served(&mut board);
        board.write_word(DISABLE, SERVICE).unwrap();
        board.run_for(millis(5_000)).unwrap();
        let report = board.report();
        report.check().unwrap();
        let causes: Vec<_> = report.restarts.iter().map(|restart| restart.cause).collect();
        assert_eq!(causes, [Cause::Watchdog], "{lsi_hz} Hz");
        expect_served(&mut board);
        assert_eq!(counters(&mut board).watchdog_resets, 1);
    }
}

/// Makes the function of the LED's task an unmapped address: its next run is a hard fault.
pub(super) fn break_led_task<A: Arm>(board: &mut VirtualBoard<A>) {
    let task = board.symbol("led4show4POOL").unwrap();
    let flash_end = 0x0800_0000 + chip().flash_size() as u32;
    let is_code = |word: u32| (0x0800_0000..flash_end).contains(&word) && word % 2 == 1;
    let function = (task..task + 64)
        .step_by(4)
        .find(|&at| is_code(board.read_word(at).unwrap()));
    board.write_word(function.unwrap(), 0x7000_0001).unwrap();
}

#[test]
fn hard_fault_is_counted_and_adapter_restarts() {
    let mut board = VirtualBoard::start(config(Crystal::new(8_000_000))).unwrap();
    let board = &mut board;
    expect_served(board);
    break_led_task(board);
    let crashed = board.run_for(millis(200)).unwrap_err();
    assert!(
        matches!(
            crashed,
            Error::Crashed {
                crash: Crash::HardFault,
                ..
            }
        ),
        "{crashed}"
    );
    board.run_for(millis(100)).unwrap();
    expect_served(board);
    let counters = counters(board);
    assert_eq!(
        (counters.hard_faults, counters.panics, counters.watchdog_resets),
        (1, 0, 0)
    );
    let restarts = board.report().restarts;
    let causes: Vec<_> = restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [Cause::Software]);
}
