//! The firmware image in a crash loop: three starts that crash lead to factory settings, without CAN and without a change
//! in flash, until the owner saves.

use armwire_bridge::can::{Frame, Id};
use armwire_bridge::config::{ArmKind, Config, HostTimeout};
use armwire_bridge::control::{Event, Reply, Request, Subscription};
use armwire_bridge::store::Saved;
use armwire_host_tests::image::{BIT_RATE, Control, MEGABAUD, RawArm, board_config, chip, counters, facts, plug_in};
use armwire_virtual_board::can::{NodeConfig, Sender};
use armwire_virtual_board::{Config as BoardConfig, Error, Nanos, Timing, VirtualBoard};

use super::start::break_led_task;

type Board = VirtualBoard<RawArm>;

/// The only other node on the bus.
const NODE: u8 = 9;

/// Time after a start at which the firmware serves its hosts.
const STARTED: Nanos = Nanos::from_millis(50);

const fn millis(millis: u64) -> Nanos {
    Nanos::from_millis(millis)
}

fn board() -> Board {
    let mut board = VirtualBoard::start(board_config(RawArm::default())).unwrap();
    board.can().join(NODE, NodeConfig::classic(BIT_RATE));
    run(&mut board, STARTED);
    board
}

/// Runs the board through crashes. Returns their number.
fn run(board: &mut Board, span: Nanos) -> u32 {
    let until = board.now() + span;
    let mut crashes = 0;
    while board.now() < until {
        match board.run_for(until.since(board.now())) {
            Ok(()) => {}
            Err(Error::Crashed { .. }) => crashes += 1,
            Err(error) => panic!("{error}"),
        }
    }
    crashes
}

/// The end of a run.
#[derive(Clone, Copy, Debug)]
enum End {
    Panic,
    HardFault,
    Watchdog,
}

impl End {
    const ALL: [Self; 3] = [Self::Panic, Self::HardFault, Self::Watchdog];

    /// Ends the run, and runs the next start.
    fn end(self, board: &mut Board) {
        match self {
            // The firmware finds the queue of its clock borrowed.
            Self::Panic => {
                let clock = board.symbol("5board6timers5CLOCK").unwrap();
                while let Ok(()) = board.run_for(millis(3)) {
                    board.write_word(clock, 1).unwrap();
                }
            }
            Self::HardFault => {
                break_led_task(board);
                board.run_for(millis(200)).unwrap_err();
            }
            Self::Watchdog => {
                let before = board.report().restarts.len();
                board.hold_core();
                while board.report().restarts.len() == before {
                    board.run_for(millis(100)).unwrap();
                }
            }
        }
        run(board, STARTED);
    }
}

/// Expects recovery, with this configuration in force.
fn expect_recovery(board: &mut Board, config: &Config) -> Control {
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    assert_eq!(
        control.call(board, Request::GetRecovery),
        Reply::Recovery { active: true }
    );
    assert_eq!(control.call(board, Request::GetConfig), Reply::Config(*config));
    assert!(!acknowledges(board));
    control
}

fn expect_normal(board: &mut Board, config: &Config) -> Control {
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    assert_eq!(
        control.call(board, Request::GetRecovery),
        Reply::Recovery { active: false }
    );
    assert_eq!(control.call(board, Request::GetConfig), Reply::Config(*config));
    assert!(acknowledges(board));
    control
}

/// Returns true if the adapter acknowledges frames of the other node on the bus. That node repeats a frame until then.
fn acknowledges(board: &mut Board) -> bool {
    let frame = Frame::new(Id::new(0x7FF).unwrap(), &[1, 2, 3]).unwrap();
    if board.can().unsent_by(NODE) == 0 {
        board.can().send_from(NODE, &frame).unwrap();
    }
    board.run_for(millis(20)).unwrap();
    board.can().unsent_by(NODE) == 0
}

/// The number of times that the LED is switched on within a second.
fn flashes(board: &mut Board) -> usize {
    const ODR: u64 = 0x14;
    let (port, pin) = facts(chip()).registers().led;
    let levels: Vec<_> = (0..100)
        .map(|_| {
            board.run_for(millis(10)).unwrap();
            board.read_word(port + ODR).unwrap() >> pin & 1
        })
        .collect();
    levels.windows(2).filter(|pair| pair == &[0, 1]).count()
}

/// A configuration that differs from the default in settings that recovery keeps, and in others.
fn unusual() -> Config {
    let mut config = Config {
        arm: ArmKind::Alpha1,
        host_timeout: HostTimeout {
            after_ms: 700,
            torque_off: true,
        },
        ..Config::default()
    };
    config.can.unsolicited = true;
    config
}

/// The part of it that recovery keeps.
fn kept() -> Config {
    let Config { arm, host_timeout, .. } = unusual();
    Config {
        arm,
        host_timeout,
        ..Config::default()
    }
}

fn save(board: &mut Board, config: &Config) {
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    control.order(board, Request::SetConfig(*config));
    control.order(board, Request::SaveConfig);
}

#[test]
fn three_crashed_starts_lead_to_recovery_until_save() {
    let mut board = board();
    let board = &mut board;
    save(board, &unusual());
    let (flash, operations) = (board.flash(), board.flash_operations());
    for end in End::ALL {
        expect_normal(board, &unusual());
        end.end(board);
    }
    let mut control = expect_recovery(board, &kept());
    assert!(board.uart().baud().unwrap().abs_diff(115_200) < 200);
    assert_eq!(flashes(board), 2);
    assert!(!board.can().frames().iter().any(|frame| frame.sender == Sender::Board));
    let counted = counters(board);
    assert_eq!(
        (
            counted.panics,
            counted.hard_faults,
            counted.watchdog_resets,
            counted.recovery_starts
        ),
        (1, 1, 1, 1)
    );
    assert_eq!((counted.dropped_events, counted.config_failures), (0, 0));
    assert_eq!((board.flash() == flash, board.flash_operations()), (true, operations));

    let events = Subscription {
        frames: false,
        events: true,
    };
    control.order(board, Request::Subscribe(events));
    let saved = Reply::Saved(Saved::Config(unusual()));
    assert_eq!(control.call(board, Request::GetSaved), saved);
    assert_eq!(board.flash_operations(), operations);
    control.order(board, Request::SaveConfig);
    board.run_for(millis(20)).unwrap();
    let events: Vec<_> = control.take_events(board).into_iter().map(|(_, event)| event).collect();
    let recovery = |active| Event::Recovery { active };
    assert_eq!(events, [recovery(true), recovery(false)]);
    assert!(acknowledges(board));
    assert_eq!(flashes(board), 0);

    board.power_cycle().unwrap();
    run(board, STARTED);
    expect_normal(board, &kept());
    assert_eq!(counters(board).recovery_starts, 0);
}

#[test]
fn store_that_crashes_the_load_is_not_touched() {
    let mut board = board();
    let board = &mut board;
    save(board, &unusual());
    let (flash, operations) = (board.flash(), board.flash_operations());
    board.break_flash(facts(chip()).config_flash);
    board.power_cycle().unwrap();
    assert_eq!(run(board, millis(500)), 3);
    let mut control = expect_recovery(board, &Config::default());
    assert_eq!(counters(board).hard_faults, 3);
    assert_eq!(control.call(board, Request::GetSaved), Reply::Saved(Saved::Unreadable));
    assert_eq!((board.flash() == flash, board.flash_operations()), (true, operations));

    let config = Config {
        host_timeout: unusual().host_timeout,
        ..Config::default()
    };
    control.order(board, Request::SetConfig(config));
    control.order(board, Request::SaveConfig);
    assert_eq!(
        control.call(board, Request::GetRecovery),
        Reply::Recovery { active: false }
    );
    assert_eq!(
        control.call(board, Request::GetSaved),
        Reply::Saved(Saved::Config(config))
    );
    board.power_cycle().unwrap();
    assert_eq!(run(board, STARTED), 0);
    expect_normal(board, &config);
}

#[test]
fn reset_of_a_crashing_store_ends_recovery() {
    // The longest stall of the core, for two erases, and the fastest oscillator of the watchdog (DS8626, 5.3.9).
    let mut board = VirtualBoard::start(BoardConfig {
        timing: Timing::Worst,
        lsi_hz: 47_000,
        ..board_config(RawArm::default())
    })
    .unwrap();
    let board = &mut board;
    board.can().join(NODE, NodeConfig::classic(BIT_RATE));
    run(board, STARTED);
    save(board, &unusual());
    board.break_flash(facts(chip()).config_flash);
    board.power_cycle().unwrap();
    assert_eq!(run(board, millis(500)), 3);
    let mut control = expect_recovery(board, &Config::default());
    control.send(board, Request::ResetConfig);
    assert_eq!(run(board, millis(1_500)), 0);
    assert!(acknowledges(board));
    assert_eq!(counters(board).watchdog_resets, 0);
    board.power_cycle().unwrap();
    assert_eq!(run(board, STARTED), 0);
    let mut control = expect_normal(board, &Config::default());
    assert_eq!(control.call(board, Request::GetSaved), Reply::Saved(Saved::Nothing));
}

#[test]
fn crashes_count_within_ten_seconds_of_run() {
    let mut board = board();
    let board = &mut board;
    let factory = Config::default();
    for _ in 0..2 {
        for _ in 0..2 {
            run(board, millis(9_000));
            End::HardFault.end(board);
            expect_normal(board, &factory);
        }
        run(board, millis(11_000));
        End::HardFault.end(board);
        expect_normal(board, &factory);
    }
    for _ in 0..3 {
        run(board, millis(9_000));
        End::HardFault.end(board);
    }
    expect_recovery(board, &factory);
    // Recovery lasts, and the next start is a normal one.
    run(board, millis(11_000));
    expect_recovery(board, &factory);
    End::HardFault.end(board);
    expect_normal(board, &factory);
}

#[test]
fn power_on_and_requested_restart_end_the_row() {
    let mut board = board();
    let board = &mut board;
    let restarts: [fn(&mut Board); 3] = [
        |board| {
            let mut control = expect_normal(board, &Config::default());
            control.order(board, Request::Restart);
            run(board, millis(200));
        },
        |board| board.power_cycle().unwrap(),
        // The record in RAM is still there.
        |board| board.dip_power(),
    ];
    for restart in restarts {
        for _ in 0..2 {
            End::HardFault.end(board);
        }
        restart(board);
        run(board, STARTED);
    }
    assert_eq!(counters_of(board), (0, 0));
    for _ in 0..3 {
        End::HardFault.end(board);
    }
    assert_eq!(counters_of(board), (3, 1));
    board.power_cycle().unwrap();
    run(board, STARTED);
    expect_normal(board, &Config::default());
}

/// Hard faults and starts in recovery since power-on.
fn counters_of(board: &mut Board) -> (u32, u32) {
    plug_in(board, MEGABAUD);
    let counters = counters(board);
    (counters.hard_faults, counters.recovery_starts)
}
