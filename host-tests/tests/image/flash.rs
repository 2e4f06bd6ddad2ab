//! The firmware image and its flash: duration of an erase, saves at a low supply voltage, and interrupted saves.
//!
//! Only the STM32F405 has a minimum voltage for writes: the STM32G431 erases and programs at any supply at which it runs.

use std::ops::Range;

use armwire::ling::{JOINTS, Request};
use armwire_bridge::config::Config;
use armwire_bridge::control::{self, Reply};
use armwire_host_tests::image::{
    Control, MEGABAUD, Program, RawArm, board_config, chip, counters, exchange, expect_exact_frames, facts,
    joint_answer, noise, on_board_with, open, plug_in, read_all, same_bytes,
};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::report::{Cause, Crash};
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Chip, Config as BoardConfig, EccRegister, Error, Nanos, Timing, VirtualBoard};

fn ling() -> LingArm {
    LingArm::new(armwire_sim::ling::Config::follower())
}

/// Runs a test on a board with flash operations of this duration.
fn on_board_timed<A: Arm>(arm: A, timing: Timing, test: impl FnOnce(&mut VirtualBoard<A>)) {
    let config = BoardConfig {
        timing,
        ..board_config(arm)
    };
    on_board_with(config, test);
}

/// Fills both sectors or pages of a board that has started: a save begins with an erase, unless the port is open. The port
/// of a host without DTR counts as closed.
fn fill<A: Arm>(board: &mut VirtualBoard<A>) {
    fill_pages(board, facts(chip()).config_flash);
}

fn fill_pages<A: Arm>(board: &mut VirtualBoard<A>, place: Range<usize>) {
    board.usb().attach();
    board.usb().open_without_dtr(0, LineCoding::new(MEGABAUD)).unwrap();
    assert!(board.write_flash(place.start, &vec![0x5A; place.len()]));
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
        on_board_timed(ling(), timing, |board| {
            fill(board);
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

/// Saves, and sends `len` bytes from the arm, `after` the start of the erase. Returns what the host received.
fn send_during_erase(board: &mut VirtualBoard<RawArm>, len: usize, after: Nanos) -> Vec<u8> {
    fill(board);
    let mut control = Control::open(board);
    let mut config = Config::default();
    config.host_timeout.after_ms = 700;
    control.order(board, control::Request::SetConfig(config));
    let idle = board.flash_operations();
    control.send(board, control::Request::SaveConfig);
    board
        .run_until(Nanos::from_millis(10), |board| board.flash_operations() > idle)
        .unwrap();
    board.run_for(after).unwrap();
    assert!(board.erases().is_empty(), "the erase has ended");
    board.with_arm(|arm| arm.send(&noise(1, len)));
    board.run_for(facts(chip()).erase[0]).unwrap();
    let received = read_all(board);
    assert!(!board.erases().is_empty(), "the erase goes on");
    received
}

#[test]
fn bytes_during_erase_arrive_as_far_as_the_ring_has_room() {
    const ROOM: usize = 450;
    let nearly = Nanos(facts(chip()).erase[0].0 - 3_000_000);
    for after in [Nanos::from_millis(1), nearly] {
        for len in [7, ROOM] {
            on_board_timed(RawArm::default(), Timing::Typical, |board| {
                let received = send_during_erase(board, len, after);
                same_bytes("the host", &received, &noise(1, len));
                assert_eq!(
                    counters(board).ring_overruns,
                    0,
                    "{len} bytes, {after:?} after the start"
                );
            });
        }
    }
}

#[test]
fn bytes_during_erase_beyond_the_ring_are_counted_as_overrun() {
    // The ring has 1,024 bytes. These end within its first and second turn.
    for len in [1_100, 1_500, 1_900, 2_000, 2_500, 3_000] {
        on_board_timed(RawArm::default(), Timing::Typical, |board| {
            let after = Nanos::from_millis(1);
            let received = send_during_erase(board, len, after);
            let sent = noise(1, len);
            assert!(
                sent.ends_with(&received),
                "{} of {len} bytes, from two turns of the ring",
                received.len()
            );
            assert_eq!(counters(board).ring_overruns, 1, "{len} bytes");
            exchange(board, &noise(2, 1_000), &noise(3, 1_000));
        });
    }
}

/// The change of the rate is due at the end of the erase, when the ring is full of frames: the host's packet takes the line.
#[test]
fn frames_during_erase_arrive_before_change_of_rate() {
    const FRAMES: u16 = 12;
    on_board_timed(RawArm::default(), Timing::Typical, |board| {
        fill(board);
        let mut control = Control::open(board);
        board.usb().set_line_coding(LineCoding::new(115_200)).unwrap();
        control.send(board, control::Request::SaveConfig);
        board.run_for(Nanos::from_millis(2)).unwrap();
        board.usb().write(&[1]).unwrap();
        let frames: Vec<u8> = (0..FRAMES).flat_map(|nth| joint_answer([nth; JOINTS])).collect();
        board.uart().forget_bytes();
        board.with_arm(|arm| arm.send(&frames));
        assert_eq!(control.reply(board), Reply::Done);
        same_bytes("the host", &read_all(board), &frames);
        assert!(board.uart().baud().unwrap() < 116_000);
    });
}

/// The STM32s stamp by an interrupt handler, which waits for the flash.
#[test]
fn frames_during_erase_have_exact_stamps() {
    if chip() != Chip::Rp2040 {
        return;
    }
    const FRAMES: usize = 12;
    let erase = facts(chip()).erase[0];
    // Some arrive before the erase, or behind it, between the writes.
    for begin in [Nanos(0), Nanos(erase.0 - 4_000_000)] {
        on_board_timed(RawArm::default(), Timing::Typical, |board| {
            fill(board);
            let mut control = Control::open(board);
            control.subscribe(board);
            control.send(board, control::Request::SaveConfig);
            board.uart().forget_bytes();
            board.run_for(begin).unwrap();
            for nth in 0..FRAMES {
                board.with_arm(|arm| arm.send(&joint_answer([nth as u16; JOINTS])));
                board.run_for(Nanos(600_000)).unwrap();
            }
            assert_eq!(control.reply(board), Reply::Done);
            board.run_for(Nanos::from_millis(20)).unwrap();
            expect_exact_frames(board, &mut control, joint_answer([0; JOINTS]).len());
            assert_eq!(counters(board).late_stamps, 0);
        });
    }
}

#[test]
fn save_is_refused_at_low_supply() {
    if chip() != Chip::Stm32f405 {
        return;
    }
    on_board_timed(ling(), Timing::Typical, |board| {
        fill(board);
        let mut control = Control::open(board);
        let before = counters(board);
        let held = board.flash();
        board.set_supply(2_800);
        let refused = Reply::Failed(control::Failure::SupplyLow);
        assert_eq!(save(board, &mut control, 700), refused);
        assert_eq!(control.call(board, control::Request::ResetConfig), refused);
        assert_eq!((board.flash() == held, board.flash_operations()), (true, 0));
        let after = counters(board);
        assert_eq!(after.config_failures - before.config_failures, 2);
        assert_eq!(after.config_saves, 0);
        // The supply of an STM32F4DISCOVERY.
        board.set_supply(3_000);
        assert_eq!(save(board, &mut control, 800), Reply::Done);
    });
}

#[test]
fn supply_drop_during_save_keeps_previous_configuration() {
    if chip() != Chip::Stm32f405 {
        return;
    }
    let mut board = VirtualBoard::start(board_config(ling())).unwrap();
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

/// A flash content with a saved timeout of a host, in milliseconds.
struct Saved {
    flash: Vec<u8>,
    after_ms: u16,
}

/// The timeout whose save is interrupted, and the one that is saved afterwards.
const NEW_MS: u16 = 800;
const LATER_MS: u16 = 900;

/// The first save, and the last one before a save that erases.
fn before_saves() -> [Saved; 2] {
    let mut board = VirtualBoard::start(board_config(ling())).unwrap();
    let board = &mut board;
    // The second page is full after half of the budget of saves.
    let pages = facts(chip()).config_flash;
    fill_pages(board, pages.start..pages.start + pages.len() / 2);
    let mut control = Control::open(board);
    let mut save_next = |board: &mut _, after_ms| {
        assert_eq!(save(board, &mut control, after_ms), Reply::Done);
        let flash = board.flash();
        Saved { flash, after_ms }
    };
    let first = save_next(board, 1_000);
    let erased = board.erases().len();
    let mut last = save_next(board, 1_001);
    loop {
        let next = save_next(board, last.after_ms + 1);
        if board.erases().len() > erased {
            return [first, last];
        }
        last = next;
    }
}

/// Cuts the power in this flash operation of a save, and starts the board again. Returns false if the save has fewer.
fn interrupt_save(before: &Saved, ecc_register: EccRegister, operation: u32) -> bool {
    let mut board = VirtualBoard::start(BoardConfig {
        ecc_register,
        seed: operation.into(),
        ..board_config(ling())
    })
    .unwrap();
    let board = &mut board;
    fill(board);
    // A start with this content would make room.
    let pages = facts(chip()).config_flash;
    assert!(board.write_flash(pages.start, &before.flash[pages]));
    let mut control = Control::open(board);
    let mut config = Config::default();
    config.host_timeout.after_ms = NEW_MS;
    control.order(board, control::Request::SetConfig(config));
    board.cut_power_after(operation);
    control.send(board, control::Request::SaveConfig);
    match board.run_for(Nanos::from_millis(600)) {
        Ok(()) => return false,
        Err(Error::PowerCut { .. }) => board.power_cycle().unwrap(),
        Err(error) => panic!("{error}"),
    }
    open(board, MEGABAUD);
    let mut control = Control::open(board);
    let Reply::Config(kept) = control.call(board, control::Request::GetConfig) else {
        panic!("no configuration")
    };
    let kept = kept.host_timeout.after_ms;
    assert!(kept == before.after_ms || kept == NEW_MS, "{kept} ms");
    expect_sound_after_power_cut(board, &mut control);
    true
}

/// Cuts the power in this flash operation of a start that makes room, and starts the board again. Returns false if there are
/// fewer.
fn interrupt_start(before: &Saved, operation: u32) -> bool {
    let mut board = VirtualBoard::start(BoardConfig {
        flash: Some(before.flash.clone()),
        power_cut_after: Some(operation),
        seed: operation.into(),
        ..board_config(ling())
    })
    .unwrap();
    let board = &mut board;
    match board.run_for(Nanos::from_millis(600)) {
        Ok(()) => return false,
        Err(Error::PowerCut { .. }) => board.power_cycle().unwrap(),
        Err(error) => panic!("{error}"),
    }
    plug_in(board, MEGABAUD);
    let mut control = Control::open(board);
    let Reply::Config(kept) = control.call(board, control::Request::GetConfig) else {
        panic!("no configuration")
    };
    assert_eq!(kept.host_timeout.after_ms, before.after_ms);
    expect_sound_after_power_cut(board, &mut control);
    true
}

/// A save works, and no start but that after the power cut has a cause.
fn expect_sound_after_power_cut(board: &mut VirtualBoard<LingArm>, control: &mut Control) {
    assert_eq!(save(board, control, LATER_MS), Reply::Done);
    let counted = counters(board);
    assert_eq!(
        (counted.panics, counted.hard_faults, counted.watchdog_resets),
        (0, 0, 0)
    );
    let report = board.report();
    report.check().unwrap();
    let causes: Vec<Cause> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(causes, [Cause::Power]);
}

#[test]
fn interrupted_start_keeps_configuration() {
    let [_, full] = before_saves();
    let operations = (0..).take_while(|&operation| interrupt_start(&full, operation)).count();
    assert_eq!(operations, 1, "an erase");
}

/// Reads of the arm's pose beside them, as by a program on the port.
#[test]
fn reads_beside_100_saves_take_no_longer() {
    const SAVES: u16 = 100;
    const LIMIT: Nanos = Nanos::from_millis(20);
    for timing in [Timing::Typical, Timing::Worst] {
        on_board_timed(ling(), timing, |board| {
            plug_in(board, MEGABAUD);
            let mut control = Control::open(board);
            let mut program = Program::default();
            for nth in 0..SAVES {
                let mut config = Config::default();
                config.host_timeout.after_ms = 700 + nth;
                control.order(board, control::Request::SetConfig(config));
                control.send(board, control::Request::SaveConfig);
                for _ in 0..2 {
                    let before = board.now();
                    assert!(program.call(board, Request::ReadJoints).is_some());
                    let took = board.now().since(before);
                    assert!(took <= LIMIT, "{took:?} beside save {nth}");
                }
                assert_eq!(control.reply(board), Reply::Done, "save {nth}");
            }
            assert_eq!(board.erases(), []);
        });
    }
}

#[test]
fn save_without_room_waits_for_closed_port_or_start() {
    on_board_timed(ling(), Timing::Typical, |board| {
        plug_in(board, MEGABAUD);
        fill(board);
        let mut control = Control::open(board);
        let refused = Reply::Failed(control::Failure::NoRoom);
        assert_eq!(save(board, &mut control, 700), refused);
        assert_eq!(control.call(board, control::Request::ResetConfig), refused);
        assert_eq!(board.erases(), []);
        let Reply::Config(in_force) = control.call(board, control::Request::GetConfig) else {
            panic!("no configuration")
        };
        assert_eq!(in_force.host_timeout.after_ms, 700);
        board.usb().set_control_lines(false, false).unwrap();
        assert_eq!(save(board, &mut control, 700), Reply::Done);
        assert_eq!(board.erases().len(), 1);
    });
    let mut contents = vec![0xFF; chip().flash_size()];
    contents[facts(chip()).config_flash].fill(0x5A);
    let config = BoardConfig {
        flash: Some(contents),
        ..board_config(ling())
    };
    on_board_with(config, |board| {
        plug_in(board, MEGABAUD);
        let erases = board.erases();
        assert_eq!(erases.len(), 1);
        let mut control = Control::open(board);
        assert_eq!(save(board, &mut control, 700), Reply::Done);
        assert_eq!(board.erases(), erases);
    });
}

#[test]
fn interrupted_save_leaves_old_or_new_configuration() {
    let registers = match chip() {
        Chip::Stm32f405 | Chip::Rp2040 => &[EccRegister::Correct][..],
        Chip::Stm32g431 => &[
            EccRegister::Correct,
            EccRegister::NoAddress,
            EccRegister::OtherAddress,
            EccRegister::Random,
        ],
    };
    for (before, at_least) in before_saves().iter().zip(facts(chip()).save_operations) {
        for &register in registers {
            let operations = (0..)
                .take_while(|&operation| interrupt_save(before, register, operation))
                .count();
            assert!(operations >= at_least, "{register:?}: {operations} operations");
        }
    }
}

#[test]
fn ecc_error_outside_configuration_is_a_panic() {
    if chip() != Chip::Stm32g431 {
        return;
    }
    /// KEYR with its keys, and CR with PG (RM0440 5.7).
    const UNLOCK: [(u64, u32); 3] = [(0x4002_2008, 0x4567_0123), (0x4002_2008, 0xCDEF_89AB), (0x4002_2014, 1)];
    const FLASH: u64 = 0x0800_0000;
    let mut board = VirtualBoard::start(board_config(ling())).unwrap();
    let name = chip().to_string();
    let flash = board.flash();
    let place = flash.windows(name.len()).position(|bytes| bytes == name.as_bytes());
    let place = FLASH + place.unwrap() as u64 / 8 * 8;
    board.cut_power_after(0);
    for (address, value) in UNLOCK.into_iter().chain([(place, 0), (place + 4, 0)]) {
        board.write_word(address, value).unwrap();
    }
    let cut = board.run_for(Nanos::from_millis(1)).unwrap_err();
    assert!(matches!(cut, Error::PowerCut { .. }), "{cut}");
    board.power_cycle().unwrap();
    let crashed = board.run_for(Nanos::from_millis(500)).unwrap_err();
    assert!(
        matches!(
            crashed,
            Error::Crashed {
                crash: Crash::Panic,
                ..
            }
        ),
        "{crashed}"
    );
}
