//! The firmware image and its flash: duration of an erase, and saves at a low supply voltage.
//!
//! Only the STM32F405 has a minimum voltage for writes: the STM32G431 erases and programs at any supply at which it runs.

use armwire_bridge::config::Config;
use armwire_bridge::control::{self, Reply};
use armwire_host_tests::image::{Control, MEGABAUD, chip, counters, facts, on_board_with, open, path, plug_in};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::{Chip, Config as BoardConfig, Nanos, Timing, VirtualBoard};

fn ling() -> LingArm {
    LingArm::new(armwire_sim::ling::Config::follower())
}

/// A board on which a save begins with an erase: both sectors or pages are full.
fn with_full_flash(timing: Timing) -> BoardConfig<LingArm> {
    let mut contents = vec![0xFF; chip().flash_size()];
    contents[facts(chip()).config_flash].fill(0x5A);
    BoardConfig {
        flash: Some(contents),
        timing,
        ..BoardConfig::new(path(), ling())
    }
}

fn save(board: &mut VirtualBoard<LingArm>, control: &mut Control, after_ms: u16) -> Reply {
    let mut config = Config::default();
    config.host_timeout.after_ms = after_ms;
    control.order(board, control::Request::SetConfig(config));
    control.call(board, control::Request::SaveConfig)
}

#[test]
fn erase_takes_the_time_of_whole_words() {
    for (timing, takes) in [Timing::Typical, Timing::Worst].into_iter().zip(facts(chip()).erase) {
        on_board_with(with_full_flash(timing), |board| {
            plug_in(board, MEGABAUD);
            let mut control = Control::open(board);
            assert_eq!(save(board, &mut control, 700), Reply::Done);
            let erases = board.erases();
            assert!(!erases.is_empty());
            for (start, end) in erases {
                assert_eq!(end.since(start), takes);
            }
        });
    }
}

#[test]
fn save_is_refused_at_low_supply() {
    if chip() != Chip::Stm32f405 {
        return;
    }
    on_board_with(with_full_flash(Timing::Typical), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        let before = counters(board);
        let held = board.flash();
        board.set_supply(2_850);
        let refused = Reply::Failed(control::Failure::SupplyLow);
        assert_eq!(save(board, &mut control, 700), refused);
        assert_eq!(control.call(board, control::Request::ResetConfig), refused);
        assert_eq!((board.flash() == held, board.flash_operations()), (true, 0));
        let after = counters(board);
        assert_eq!(after.config_failures - before.config_failures, 2);
        assert_eq!(after.config_saves, 0);
        board.set_supply(3_300);
        assert_eq!(save(board, &mut control, 800), Reply::Done);
    });
}

#[test]
fn supply_drop_during_save_keeps_previous_configuration() {
    if chip() != Chip::Stm32f405 {
        return;
    }
    let mut board = VirtualBoard::start(BoardConfig::new(path(), ling())).unwrap();
    let board = &mut board;
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    assert_eq!(save(board, &mut control, 700), Reply::Done);
    for words in [1, 2, 4] {
        let mut config = Config::default();
        config.host_timeout.after_ms = 800;
        control.order(board, control::Request::SetConfig(config));
        let before = board.flash_operations();
        control.send(board, control::Request::SaveConfig);
        for _ in 0..5_000 {
            if board.flash_operations() >= before + words {
                break;
            }
            board.run_for(Nanos(2_000)).unwrap();
        }
        board.set_supply(2_800);
        board.run_for(Nanos::from_millis(50)).unwrap();
        assert_eq!(board.flash_operations(), before + words, "the rest was not written");
        board.set_supply(3_300);
        board.power_cycle().unwrap();
        open(board, MEGABAUD);
        control = Control::open(board);
        let Reply::Config(kept) = control.call(board, control::Request::GetConfig) else {
            panic!("no configuration")
        };
        assert_eq!(kept.host_timeout.after_ms, 700, "{words} words");
    }
    board.check().unwrap();
}
