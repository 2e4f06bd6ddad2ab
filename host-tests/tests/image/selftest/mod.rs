//! `armwire selftest` on the virtual board: an adapter passes, and each check fails where its fault is.

mod board;

use std::cell::Cell;
use std::time::Duration;

use armwire::alpha1::READ_FIRMWARE_VERSION;
use armwire::ling::{READ_INFO, TORQUE_OFF};
use armwire_bridge::Counters;
use armwire_bridge::config::{Config as AdapterConfig, HostTimeout, Poll};
use armwire_bridge::control::{Reply, Request};
use armwire_cli::selftest::{Check, Plan, Trouble, UsbError, counters, report, run};
use armwire_host_tests::image::requests::motion;
use armwire_host_tests::image::{Control, board_config, chip, facts, path};
use armwire_sim::alpha1::{Alpha1Robot, RobotConfig};
use armwire_sim::ling::legacy::{self, LegacyArm};
use armwire_sim::ling::{self, LingArm};
use armwire_virtual_board::line::Fault as ByteFault;
use armwire_virtual_board::{Chip, Config, Crystal, Nanos, Timing, VirtualBoard};

use board::{BoardUsb, Fault, Jumper, Suspend};

/// Number of bytes through the jumper after which each check that needs it has started.
const BEHIND_JUMPER: usize = 90;

/// A board that runs the image, with a jumper on its UART.
fn start(jumper: Jumper) -> VirtualBoard<Jumper> {
    VirtualBoard::start(board_config(jumper)).unwrap()
}

/// Runs the checks of a plan.
fn checks_of(usb: &mut BoardUsb<'_>, plan: &Plan) -> Vec<Check> {
    run(usb, plan, &|| false, &mut |check| println!("{}", check.line()))
}

/// A short plan with these checks.
fn only(names: &[&str]) -> Plan {
    Plan {
        echo_bytes: 500,
        stamps: 200,
        cancels: 30,
        resets: 2,
        saves: 2,
        crystal: Duration::from_secs(5),
        only: names.iter().map(|&name| name.to_owned()).collect(),
    }
}

fn result<'c>(checks: &'c [Check], name: &str) -> &'c Check {
    checks.iter().find(|check| check.name == name).expect(name)
}

/// The reason of a failed check.
fn failure(checks: &[Check], name: &str) -> String {
    match &result(checks, name).result {
        Err(Trouble::Failed(text)) => text.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

/// The reason of a check that did not run.
fn reason(checks: &[Check], name: &str) -> String {
    match &result(checks, name).result {
        Err(Trouble::NotTried(text)) => text.clone(),
        other => panic!("{name}: {other:?}"),
    }
}

/// Expects that this check failed and no other.
fn expect_only_failure(checks: &[Check], name: &str) {
    let failed: Vec<_> = checks
        .iter()
        .filter(|check| check.has_failed())
        .map(|check| check.name)
        .collect();
    assert_eq!(failed, [name]);
}

/// Runs one check with a fault, and returns the reason of its failure.
fn failure_with(name: &str, fault: impl FnOnce(&mut BoardUsb<'_>)) -> String {
    let mut board = start(Jumper::default());
    let mut usb = BoardUsb::new(&mut board);
    fault(&mut usb);
    let checks = checks_of(&mut usb, &only(&[name]));
    expect_only_failure(&checks, name);
    failure(&checks, name)
}

/// Expects each check to pass on a board of this kind.
fn passes(exact_cycles: bool, timing: Timing) {
    let config = Config {
        exact_cycles,
        timing,
        ..board_config(Jumper::default())
    };
    let mut board = VirtualBoard::start(config).unwrap();
    let checks = checks_of(&mut BoardUsb::new(&mut board), &Plan::default());
    let not_ok: Vec<_> = checks.iter().filter(|check| check.result.is_err()).collect();
    assert!(not_ok.is_empty(), "{not_ok:?}");
    assert_eq!(checks.len(), 13);
    let report = report(&checks, counters(&mut BoardUsb::new(&mut board)).as_ref());
    assert!(report["checks"][0]["firmware"].is_string(), "{report}");
    let chip_id = report["checks"][0]["chip"].as_str();
    assert!(
        chip_id.is_some_and(|id| id.starts_with("0x") && id.len() == 10),
        "{report}"
    );
    assert!(report["counters"]["config_saves"].as_u64() > Some(0), "{report}");
    assert!(!report.to_string().contains(facts(chip()).serial));
    board.report().check().unwrap();
}

#[test]
fn adapter_with_a_jumper_passes() {
    passes(false, Timing::Typical);
}

/// The core's own timing, which is as slow as a real board's.
#[test]
fn adapter_of_exact_cycles_passes() {
    passes(true, Timing::Worst);
}

/// A slow core, whose answers are armed long after their requests.
#[test]
fn answer_follows_cancel_at_any_moment() {
    let config = Config {
        exact_cycles: true,
        ..board_config(Jumper::default())
    };
    let mut board = VirtualBoard::start(config).unwrap();
    let plan = Plan {
        cancels: 3_000,
        ..only(&["cancels"])
    };
    let checks = checks_of(&mut BoardUsb::new(&mut board), &plan);
    assert!(!result(&checks, "cancels").has_failed(), "{checks:?}");
}

/// A busy computer, whose host controller polls once in a frame.
#[test]
fn adapter_on_a_slow_host_passes() {
    let mut board = start(Jumper::default());
    let mut usb = BoardUsb::new(&mut board);
    usb.latency = Duration::from_millis(3);
    usb.board.usb().set_poll_interval(Nanos::from_millis(1));
    let checks = checks_of(&mut usb, &only(&[]));
    let failed: Vec<_> = checks.iter().filter(|check| check.has_failed()).collect();
    assert!(failed.is_empty(), "{failed:?}");
    // Five seconds are too short for a better result.
    assert!(reason(&checks, "crystal").contains("too slow for a better"));
}

#[test]
fn missing_jumper_ends_the_run() {
    let mut board = start(Jumper::with(Fault::OutAfter(0)));
    let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&["echo", "saves"]));
    expect_only_failure(&checks, "jumper");
    assert!(failure(&checks, "jumper").starts_with("no bytes come back"));
    assert_eq!(reason(&checks, "echo"), "there is no jumper");
    assert_eq!(reason(&checks, "saves"), "there is no jumper");
}

#[test]
fn arm_in_the_jumpers_place_is_refused() {
    let requests = [&READ_INFO[..], &READ_FIRMWARE_VERSION].concat();
    for fault in [Fault::OutAfter(0), Fault::None] {
        let ling = Jumper::beside(LingArm::new(ling::Config::follower()));
        refused(ling, fault, "is it a Ling arm?", &READ_INFO);
    }
    let alpha1 = Jumper::beside(Alpha1Robot::new(RobotConfig::default()));
    refused(alpha1, Fault::None, "is it an Alpha1?", &requests);
    let older = Jumper::beside(LegacyArm::new(legacy::Config::default()));
    refused(older, Fault::None, "though none", &[]);
}

/// Expects that no other check runs on a line with an arm, and that the arm receives only these bytes.
fn refused(mut jumper: Jumper, fault: Fault, reason: &str, received: &[u8]) {
    jumper.fault = fault;
    let mut board = start(jumper);
    let checks = checks_of(&mut BoardUsb::new(&mut board), &Plan::default());
    expect_only_failure(&checks, "jumper");
    let text = failure(&checks, "jumper");
    assert!(text.contains(reason), "{text}");
    assert_eq!(board.with_arm(Jumper::take_received), received, "{reason}");
}

#[test]
fn armed_stream_keeps_its_dead_man_timer() {
    let config = AdapterConfig {
        host_timeout: HostTimeout {
            after_ms: 10_000,
            torque_off: true,
        },
        ..AdapterConfig::default()
    };
    let mut jumper = Jumper::beside(LingArm::new(ling::Config::follower()));
    jumper.fault = Fault::OutAfter(0);
    let mut board = start(jumper);
    BoardUsb::new(&mut board);
    Control::open(&mut board).order(&mut board, Request::SetConfig(config));
    let stream = motion().repeat(3);
    board.usb().write(&stream).unwrap();
    board.run_for(Nanos::from_millis(10)).unwrap();

    let checks = checks_of(&mut BoardUsb::new(&mut board), &Plan::default());
    expect_only_failure(&checks, "jumper");
    assert!(failure(&checks, "jumper").starts_with("a host streams motion"));
    let mut control = Control::open(&mut board);
    assert_eq!(control.call(&mut board, Request::GetConfig), Reply::Config(config));
    board.run_for(Nanos::from_millis(11_000)).unwrap();
    assert_eq!(
        board.with_arm(Jumper::take_received),
        [&stream[..], &TORQUE_OFF].concat()
    );
}

#[test]
fn stopped_check_ends_at_once() {
    let mut board = start(Jumper::default());
    let calls = Cell::new(0);
    let stopped = || calls.replace(calls.get() + 1) > 5;
    let plan = Plan {
        only: vec!["crystal".to_owned()],
        ..Plan::default()
    };
    let begin = board.now();
    let checks = run(&mut BoardUsb::new(&mut board), &plan, &stopped, &mut |_| {});
    assert_eq!(reason(&checks, "crystal"), "stopped");
    assert!(board.now().since(begin) < Nanos::from_millis(15_000));
}

#[test]
fn check_without_extent_is_not_tried() {
    let mut board = start(Jumper::default());
    let plan = Plan {
        stamps: 0,
        ..only(&["stamps"])
    };
    let checks = checks_of(&mut BoardUsb::new(&mut board), &plan);
    assert_eq!(reason(&checks, "stamps"), "the plan has none of it");
}

#[test]
fn unexpected_bytes_are_reported() {
    let mut board = start(Jumper::default());
    board.with_arm(|jumper| jumper.is_sending = true);
    let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&["echo"]));
    assert!(failure(&checks, "jumper").contains("though none were sent"));
    assert!(board.with_arm(Jumper::take_received).is_empty());
}

#[test]
fn jumper_that_comes_off_ends_the_run() {
    let mut board = start(Jumper::with(Fault::OutAfter(1_000)));
    let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&["echo", "halts", "saves"]));
    expect_only_failure(&checks, "echo");
    assert!(failure(&checks, "echo").contains("bytes came back"));
    assert_eq!(reason(&checks, "halts"), "the jumper, or the adapter, is gone");
    assert_eq!(reason(&checks, "saves"), "the jumper, or the adapter, is gone");
}

#[test]
fn flipped_bit_fails_each_check_with_bytes() {
    let names = [
        "echo",
        "halts",
        "reconfiguration",
        "cancels",
        "resets",
        "stamps",
        "gaps",
        "crystal",
        "saves",
        "suspend",
    ];
    for name in names {
        let mut board = start(Jumper::with(Fault::FlipAfter(BEHIND_JUMPER)));
        let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&[name]));
        expect_only_failure(&checks, name);
    }
}

#[test]
fn noise_on_the_line_fails_the_echo() {
    let text = failure_with("echo", |usb| {
        usb.board.uart().plan_fault(BEHIND_JUMPER as u64, ByteFault::Noise)
    });
    assert_eq!(text, "115200 baud, None parity: 1 noise errors");
}

#[test]
fn changed_descriptor_is_reported() {
    for (change, place) in [
        (0x0101_u16, "vendor and product"),
        (0x0200, "interface associations"),
        (0x0301, "manufacturer"),
    ] {
        let mut board = start(Jumper::default());
        let mut usb = BoardUsb::new(&mut board);
        usb.answers = match change {
            0x0101 => |request, answer| Ok(flipped(request.value == 0x0100, 8, answer)),
            0x0200 => |request, answer| Ok(flipped(request.value == 0x0200, 14, answer)),
            _ => |request, answer| Ok(flipped(request.value == 0x0301, 2, answer)),
        };
        let checks = checks_of(&mut usb, &only(&["suspend"]));
        expect_only_failure(&checks, "descriptors");
        let text = failure(&checks, "descriptors");
        assert!(text.contains(place), "{text}");
    }
}

/// An answer with a bit flipped in one of its bytes.
fn flipped(is_it: bool, place: usize, mut answer: Vec<u8>) -> Vec<u8> {
    if let Some(byte) = answer.get_mut(place).filter(|_| is_it) {
        *byte ^= 1;
    }
    answer
}

#[test]
fn stall_after_cancelled_request_is_reported() {
    let text = failure_with("cancels", |usb| {
        usb.answers = |request, answer| match request.request {
            0x21 => Err(UsbError::Stalled),
            _ => Ok(answer),
        };
    });
    assert!(text.contains("the adapter stalled"), "{text}");
}

#[test]
fn constant_counters_are_reported() {
    for (name, reason) in [
        ("resets", "0 seen by the adapter"),
        ("gaps", "0 and 0 were counted"),
        ("saves", "nothing was written"),
        ("suspend", "did not see"),
    ] {
        let text = failure_with(name, |usb| {
            usb.answers = |request, answer| match (request.kind, request.request) == Counters::READ_REQUEST {
                true => Ok(vec![0; answer.len()]),
                false => Ok(answer),
            };
        });
        assert!(text.contains(reason), "{name}: {text}");
    }
}

#[test]
fn different_toggles_are_reported() {
    for name in ["halts", "reconfiguration"] {
        let text = failure_with(name, |usb| usb.keeps_toggles = true);
        assert!(
            text.contains("came back") || text.contains("no reply"),
            "{name}: {text}"
        );
    }
}

#[test]
fn different_clocks_are_reported() {
    for (name, clock, reason) in [
        ("echo", 900, "took"),
        ("stamps", 900, "ahead"),
        ("crystal", 999, "more than 100 ppm"),
    ] {
        let text = failure_with(name, |usb| usb.clock = clock);
        assert!(text.contains(reason), "{name}: {text}");
    }
}

#[test]
fn crystal_of_another_frequency_is_reported() {
    let crystal = Crystal::new(8_002_000);
    let mut board = VirtualBoard::start(Config {
        crystal,
        ..board_config(Jumper::default())
    })
    .unwrap();
    let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&["crystal"]));
    let text = failure(&checks, "crystal");
    // It is 250 ppm fast. The times of the echoes limit the accuracy to ±29 ppm.
    let measured = text.split_once(" ±").and_then(|(ppm, _)| ppm.parse().ok());
    assert!(measured.is_some_and(|ppm: i32| (245..=255).contains(&ppm)), "{text}");
}

#[test]
fn missing_suspend_is_reported() {
    let text = failure_with("suspend", |usb| usb.suspend = Suspend::Pretended);
    assert_eq!(text, "the adapter did not see that the bus was suspended");
}

#[test]
fn unsupported_suspend_is_not_tried() {
    let mut board = start(Jumper::default());
    let mut usb = BoardUsb::new(&mut board);
    usb.suspend = Suspend::Unsupported;
    let checks = checks_of(&mut usb, &only(&["suspend"]));
    assert_eq!(reason(&checks, "suspend"), "no suspend here");
}

#[test]
fn unwritable_flash_is_reported() {
    // The STM32G431 saves at each supply at which it runs.
    if Chip::of_image(&path()).unwrap() != Chip::Stm32f405 {
        return;
    }
    let text = failure_with("saves", |usb| usb.board.set_supply(2_500));
    assert!(text.contains("SupplyLow"), "{text}");
}

#[test]
fn lost_save_is_reported() {
    let text = failure_with("saves", |usb| usb.forgets = true);
    assert_eq!(text, "after a restart the configuration is not the last one saved");
}

#[test]
fn configuration_is_as_before() {
    let mut board = start(Jumper::default());
    BoardUsb::new(&mut board);
    let mut control = Control::open(&mut board);
    let saved = AdapterConfig {
        poll: Poll::Hertz(200),
        ..AdapterConfig::default()
    };
    control.order(&mut board, Request::SetConfig(saved));
    control.order(&mut board, Request::SaveConfig);
    let in_force = AdapterConfig {
        poll: Poll::Hertz(100),
        ..AdapterConfig::default()
    };
    control.order(&mut board, Request::SetConfig(in_force));

    // The run is stopped after its first check.
    let checks = Cell::new(0);
    let stopped = || checks.replace(checks.get() + 1) > 0;
    let checks = run(
        &mut BoardUsb::new(&mut board),
        &only(&["saves", "suspend"]),
        &stopped,
        &mut |_| {},
    );
    assert!(result(&checks, "saves").result.is_ok());
    assert_eq!(reason(&checks, "suspend"), "stopped");
    let mut control = Control::open(&mut board);
    assert_eq!(control.call(&mut board, Request::GetConfig), Reply::Config(in_force));
    board.power_cycle().unwrap();
    let mut control = Control::open(&mut board);
    assert_eq!(control.call(&mut board, Request::GetConfig), Reply::Config(saved));
}

#[test]
fn saves_beside_full_pages_cost_no_byte() {
    // The start makes room.
    let chip = Chip::of_image(&path()).unwrap();
    let mut flash = vec![0xFF; chip.flash_size()];
    flash[facts(chip).config_flash].fill(0);
    for timing in [Timing::Typical, Timing::Worst] {
        let config = Config {
            flash: Some(flash.clone()),
            timing,
            ..board_config(Jumper::default())
        };
        let mut board = VirtualBoard::start(config).unwrap();
        let checks = checks_of(&mut BoardUsb::new(&mut board), &only(&["saves"]));
        assert!(result(&checks, "saves").result.is_ok());
        assert_eq!(
            board.erases().len(),
            2,
            "one at the start, and one at the check's restart"
        );
    }
}
