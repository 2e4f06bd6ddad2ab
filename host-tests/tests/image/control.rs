//! The control interface of the firmware image: identity, configuration, counters and stamped events.

use armwire::ling::{JOINTS, Request, Response};
use armwire_bridge::config::{Config, Poll};
use armwire_bridge::control::{self, Event, Initiator, Reply};
use armwire_bridge::store::SAVE_BUDGET;
use armwire_host_tests::image::{
    Control, MEGABAUD, Program, RawArm, board_config, chip, counters, expect_exact, facts, joint_answer, on_board,
    open, plug_in, read_all,
};
use armwire_sim::ling::LingArm;
use armwire_virtual_board::line::{Arm, Direction};
use armwire_virtual_board::report::Cause;
use armwire_virtual_board::usb::cdc::LineCoding;
use armwire_virtual_board::{Nanos, VirtualBoard};

fn ling() -> LingArm {
    LingArm::new(armwire_sim::ling::Config::follower())
}

fn board<A: Arm>(arm: A) -> VirtualBoard<A> {
    let mut board = VirtualBoard::start(board_config(arm)).unwrap();
    plug_in(&mut board, MEGABAUD);
    board
}

/// Expects no forbidden access, and restarts for these causes only.
fn expect_restarts<A: Arm>(board: &mut VirtualBoard<A>, causes: &[Cause]) {
    let report = board.report();
    report.check().unwrap();
    let restarts: Vec<_> = report.restarts.iter().map(|restart| restart.cause).collect();
    assert_eq!(restarts, causes);
}

#[test]
fn adapter_identifies_itself() {
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        let reply = control.call(board, control::Request::Identify);
        let Reply::Identity(identity) = reply else {
            panic!("{reply:?}")
        };
        assert_eq!(identity.version, control::VERSION);
        assert_eq!(identity.firmware, env!("CARGO_PKG_VERSION"));
        assert_eq!(identity.board.as_str(), board.chip().to_string());
        assert_eq!(identity.serial, facts(board.chip()).serial);
        assert_eq!(identity.can_fd, facts(board.chip()).can_fd);
        assert_eq!(identity.no_can, !facts(board.chip()).can);
        // The commit of the build, if known: twelve digits, and a plus sign for changed files.
        let commit = identity.commit.trim_end_matches('+');
        assert!(commit.is_empty() || commit.len() == 12, "{commit}");
        assert!(commit.chars().all(|digit| digit.is_ascii_hexdigit()), "{commit}");
    });
}

#[test]
fn saved_configuration_survives_power_cycle() {
    let mut board = board(ling());
    let board = &mut board;
    let mut control = Control::open(board);
    let polling = Config {
        poll: Poll::Hertz(50),
        ..Config::default()
    };
    control.order(board, control::Request::SetConfig(polling));
    board.power_cycle().unwrap();
    open(board, MEGABAUD);
    let mut control = Control::open(board);
    let as_before = control.call(board, control::Request::GetConfig);
    assert_eq!(as_before, Reply::Config(Config::default()), "it was set, not saved");

    control.order(board, control::Request::SetConfig(polling));
    control.order(board, control::Request::SaveConfig);
    board.power_cycle().unwrap();
    open(board, MEGABAUD);
    let mut control = Control::open(board);
    let saved = control.call(board, control::Request::GetConfig);
    assert_eq!(saved, Reply::Config(polling));
    board.uart().forget_bytes();
    board.run_for(Nanos::from_millis(1_000)).unwrap();
    let line = board.uart().bytes();
    let requested = line
        .iter()
        .filter(|byte| byte.direction == Direction::ToArm && byte.sent == 0xAA);
    assert!(requested.count() >= 49, "it does not poll");

    control.order(board, control::Request::ResetConfig);
    board.power_cycle().unwrap();
    open(board, MEGABAUD);
    let mut control = Control::open(board);
    let reset = control.call(board, control::Request::GetConfig);
    assert_eq!(reset, Reply::Config(Config::default()));
    expect_restarts(board, &[Cause::Power; 3]);
}

#[test]
fn unreadable_configuration_is_counted_and_defaults_apply() {
    // Other data is in the first half of the configuration's flash.
    let place = facts(chip()).config_flash;
    let mut flash = vec![0xFF; chip().flash_size()];
    flash[place.start..place.start + place.len() / 2].fill(0x5A);
    let mut config = board_config(ling());
    config.flash = Some(flash);
    let mut board = VirtualBoard::start(config).unwrap();
    plug_in(&mut board, MEGABAUD);
    let board = &mut board;
    let mut control = Control::open(board);
    let reply = control.call(board, control::Request::GetConfig);
    assert_eq!(reply, Reply::Config(Config::default()));
    assert_eq!(counters(board).config_failures, 1);
}

#[test]
fn counters_match_those_read_without_port() {
    on_board(ling(), |board| {
        plug_in(board, MEGABAUD);
        let mut program = Program::default();
        for _ in 0..100 {
            program.call(board, Request::ReadJoints).unwrap();
        }
        let mut control = Control::open(board);
        let reply = control.call(board, control::Request::GetCounters);
        let Reply::Counters(counted) = reply else {
            panic!("{reply:?}")
        };
        assert_eq!(counted, counters(board));
        assert_eq!((counted.frames, counted.control_requests), (100, 1));
    });
}

#[test]
fn frames_are_stamped_at_their_last_byte() {
    on_board(ling(), |board| {
        plug_in(board, MEGABAUD);
        let mut control = Control::open(board);
        control.subscribe(board);
        let mut program = Program::default();
        let (mut stamps, mut instants) = (Vec::new(), Vec::new());
        for nth in 0..500 {
            board.run_for(Nanos((nth * 618_034) % 1_000_000)).unwrap();
            board.uart().forget_bytes();
            program.call(board, Request::ReadJoints).unwrap();
            let line = board.uart().bytes();
            instants.push(line.last().unwrap().at);
            read_all(board);
            let events = control.take_events(board);
            let [
                (
                    at,
                    Event::Frame {
                        initiator: Some(Initiator::Usb),
                        ..
                    },
                ),
            ] = &events[..]
            else {
                panic!("{events:?}");
            };
            stamps.push(*at);
        }
        expect_exact(&stamps, &instants);
        assert_eq!(counters(board).late_stamps, 0);
    });
}

#[test]
fn terminator_inside_frame_does_not_delay_stamp() {
    const BAUD: u32 = 2_000_000;
    on_board(RawArm::default(), |board| {
        plug_in(board, MEGABAUD);
        board.usb().set_line_coding(LineCoding::new(BAUD)).unwrap();
        let mut control = Control::open(board);
        control.subscribe(board);
        // The rate takes effect after 100 ms.
        board.run_for(Nanos::from_millis(105)).unwrap();
        board.uart().set_arm_baud(BAUD);
        let (mut stamps, mut instants) = (Vec::new(), Vec::new());
        for joint in 0..2_000 {
            let frame = joint_answer([joint; JOINTS]);
            // Frames whose checksum equals the terminator, and some others to compare them with.
            if joint % 100 > 0 && frame[frame.len() - 2] != 0xFF {
                continue;
            }
            board.uart().forget_bytes();
            board.with_arm(|arm| arm.send(&frame));
            board.run_for(Nanos::from_millis(2)).unwrap();
            instants.push(board.uart().bytes().last().unwrap().at);
            stamps.extend(control.take_events(board).iter().map(|&(at, _)| at));
        }
        expect_exact(&stamps, &instants);
        assert_eq!(counters(board).late_stamps, 0);
    });
}

#[test]
fn saves_beyond_budget_are_refused_after_power_cycle() {
    let mut board = board(ling());
    let board = &mut board;
    let mut control = Control::open(board);
    // An open port refuses erases.
    board.usb().set_control_lines(false, false).unwrap();
    let mut save = |board: &mut VirtualBoard<_>, after_ms| {
        let mut config = Config::default();
        config.host_timeout.after_ms = after_ms;
        control.order(board, control::Request::SetConfig(config));
        control.call(board, control::Request::SaveConfig)
    };
    for nth in 0..SAVE_BUDGET {
        assert_eq!(save(board, nth), Reply::Done, "save {nth}");
    }
    let reply = save(board, SAVE_BUDGET);
    let Reply::Failed(control::Failure::TooManySaves { wait_s }) = reply else {
        panic!("{reply:?}")
    };
    assert!((500..600).contains(&wait_s), "{wait_s} s");

    board.power_cycle().unwrap();
    open(board, MEGABAUD);
    let mut control = Control::open(board);
    control.order(board, control::Request::SetConfig(Config::default()));
    let reply = control.call(board, control::Request::SaveConfig);
    let failure = control::Failure::TooManySaves { wait_s: 600 };
    assert_eq!(reply, Reply::Failed(failure));
    expect_restarts(board, &[Cause::Power]);
}

#[test]
fn adapter_restarts_on_request() {
    let mut board = board(ling());
    let board = &mut board;
    let mut control = Control::open(board);
    control.order(board, control::Request::Restart);
    board.run_for(Nanos::from_millis(200)).unwrap();
    open(board, MEGABAUD);
    let answer = Program::default().call(board, Request::ReadJoints);
    assert!(matches!(answer, Some(Response::Joints(_))), "{answer:?}");
    expect_restarts(board, &[Cause::Software]);
}

#[test]
fn boot_loader_starts_on_request_until_power_cycle() {
    let mut board = board(ling());
    let board = &mut board;
    let mut control = Control::open(board);
    control.order(board, control::Request::RestartIntoBootLoader);
    board
        .run_until(Nanos::from_millis(200), |board| board.is_in_boot_loader())
        .unwrap();
    board.power_cycle().unwrap();
    open(board, MEGABAUD);
    assert!(!board.is_in_boot_loader());
    expect_restarts(board, &[Cause::Software, Cause::Power]);
}

#[test]
fn updates_in_a_row_are_no_crashes() {
    let mut board = board(ling());
    let board = &mut board;
    for _ in 0..4 {
        let mut control = Control::open(board);
        control.order(board, control::Request::RestartIntoBootLoader);
        board
            .run_until(Nanos::from_millis(200), |board| board.is_in_boot_loader())
            .unwrap();
        board.restart_after_flashing();
        open(board, MEGABAUD);
    }
    let reply = Control::open(board).call(board, control::Request::GetRecovery);
    assert_eq!(reply, Reply::Recovery { active: false });
    let counters = counters(board);
    assert_eq!(
        (counters.watchdog_resets, counters.hard_faults, counters.panics),
        (0, 0, 0)
    );
}
