//! `armwire sim alpha1` and `armwire sim alpha1-servo`, used through their ptys.

use std::fs::{self, File, OpenOptions};
use std::io::{Read, Write};
use std::os::unix::fs::OpenOptionsExt;

use rustix::fs::OFlags;
use rustix::process::Signal;

use crate::common::{Arm, NO_ANSWER, failure, free_path, retry_while, run, run_against, success, usage};

const STOP: [u8; 10] = [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED];
const STOPPED: [u8; 4] = [0xF2, 0x2F, 0xAA, 0xED];

/// The output of `armwire call alpha1`. The words of `args` are separated by spaces.
fn call(arm: &Arm, args: &str) -> String {
    success(&call_args(arm, args))
}

fn call_args<'a>(arm: &'a Arm, args: &'a str) -> Vec<&'a str> {
    ["call", "alpha1", &arm.port]
        .into_iter()
        .chain(args.split(' '))
        .collect()
}

fn open(arm: &Arm) -> File {
    // The pty must not become the controlling terminal.
    let flags = OFlags::NOCTTY.bits() as i32;
    let mut options = OpenOptions::new();
    options
        .read(true)
        .write(true)
        .custom_flags(flags)
        .open(&arm.port)
        .unwrap()
}

/// Waits for the next `N` bytes.
fn read<const N: usize>(port: &mut File) -> [u8; N] {
    let mut bytes = [0; N];
    port.read_exact(&mut bytes).unwrap();
    bytes
}

#[test]
fn virtual_robot_reports_its_versions() {
    let arm = Arm::start(
        "alpha1",
        "alpha1-info",
        &["--hardware", "Alpha1_V9", "--firmware", "2016010100"],
    );
    assert_eq!(call(&arm, "hardware-version"), "arm: Alpha1, hardware: Alpha1_V9\n");
    assert_eq!(call(&arm, "firmware-version"), "firmware: 2016010100\n");
    let info = success(&["info", "--arm", "alpha1", &arm.port]);
    assert!(info.contains("Alpha1_V9") && info.contains("2016010100"), "{info}");
    // The values begin in one column.
    let begins_there =
        |line: &str| line.is_char_boundary(17) && line[..17].ends_with("  ") && line.as_bytes()[17] != b' ';
    assert!(
        info.lines().all(begins_there) && info.contains("servos that run  1 2 3 "),
        "{info}"
    );
}

#[test]
fn virtual_robot_executes_requests() {
    let arm = Arm::start("alpha1", "alpha1-call", &[]);
    // The result is ignored: if the answer is late, the repeated request finds no servo 4.
    run(&call_args(&arm, "servo change-id 4 86"));
    for (args, answer) in [
        (
            "act --angles 10,240,90,90,90,90,90,90,90,90,90,90,90,90,90,90 --time 0 --interval 0",
            "act: done\n",
        ),
        ("servo read-angles 2", "servo 2: released, at 240°, sent to 240°\n"),
        (
            "servo-states",
            "servos that run: 1 3 4 5 6 7 8 9 10 11 12 13 14 15 16\n",
        ),
        ("servo move 2 60 --time 0 --lock 0", "servo 2: understood\n"),
        ("servo read-angles 2", "servo 2: released, at 60°, sent to 60°\n"),
        ("servo set-offset 3 -30", "servo 3: offset set\n"),
        ("servo read-offset 3", "servo 3: offset -30.00°\n"),
        ("servo led 86 1", "servo 86: understood\n"),
        ("play wave", "play: done\n"),
        ("stop", "stop: done\n"),
        ("offset-tool connect", "offset tool: done\n"),
        ("usb-type hid", "USB type: done\n"),
    ] {
        assert_eq!(call(&arm, args), answer, "{args}");
    }
    let refused = |args: &str| failure(&run(&call_args(&arm, args))).contains("reported failure");
    assert!(refused("play sleep"));
    let act = |angle: &str, interval| {
        format!(
            "act --angles {} --time 0 --interval {interval}",
            vec![angle; 16].join(",")
        )
    };
    assert_eq!(call(&arm, &act("1", 1000)), "act: done\n");
    assert!(refused(&act("2", 0)), "the interval is not over");
    assert!(failure(&run(&call_args(&arm, "servo version 4"))).contains("no answer"));
}

#[test]
fn virtual_robot_that_becomes_a_disk_is_gone() {
    for args in [&[][..], &["--hid"]] {
        let arm = Arm::start("alpha1", "alpha1-disk", args);
        let port = arm.port.clone();
        // The result is ignored: if the answer is late, there is no port for the repeated request.
        run(&call_args(&arm, "usb-type disk"));
        let last = arm.finish();
        assert!(
            last.starts_with("The robot is a disk on USB: this port is gone.\n"),
            "{last}"
        );
        let line = failure(&run(&["info", "--arm", "alpha1", &port]));
        assert!(line.contains("no such port"), "{line}");
    }
}

/// The output of a program that reads the servo states of a robot with this mask of running servos.
fn with_servos(args: &[&str], mask: u32) -> String {
    let states = mask.to_be_bytes();
    let check = states.iter().fold(0, |sum: u8, byte| sum.wrapping_add(*byte));
    let answer = [&[0xEF, 0xFE], &states[..], &[check, 0xED]].concat();
    let output = retry_while(NO_ANSWER, || {
        run_against(args, |_, pty, _| {
            pty.write(&answer).unwrap();
        })
    });
    assert!(output.status.success(), "{output:?}");
    String::from_utf8(output.stdout).unwrap()
}

/// The numbers of the servos whose values are 1, in each output.
#[test]
fn every_servo_state_is_in_every_output() {
    for mask in [0, 1, 0x5555_AAAA, 0xAAAA_5555, 0x8000_0000, u32::MAX] {
        let running: Vec<_> = (1..=32_u32).filter(|servo| mask >> (servo - 1) & 1 == 1).collect();
        let text = with_servos(&["call", "alpha1", "PORT", "servo-states"], mask);
        let numbers = text.trim_end().trim_start_matches("servos that run: ");
        let numbers: Vec<u32> = numbers.split(' ').filter_map(|number| number.parse().ok()).collect();
        assert_eq!(numbers, running, "{text}");

        let json = with_servos(&["call", "--json", "alpha1", "PORT", "servo-states"], mask);
        let json: serde_json::Value = serde_json::from_str(&json).unwrap();
        let runs = |servo: &u32| json[format!("servo_{servo}_runs")] == 1;
        assert_eq!((1..=32).filter(runs).collect::<Vec<_>>(), running);
        assert_eq!(json.as_object().unwrap().len(), 32);

        let csv = with_servos(&["monitor", "--arm", "alpha1", "PORT", "--csv", "--count", "1"], mask);
        let lines: Vec<Vec<_>> = csv.lines().map(|line| line.split(',').collect()).collect();
        let runs = |servo: &u32| {
            let column = format!("servo_{servo}_runs");
            let at = lines[0].iter().position(|name| *name == column).unwrap();
            lines[1][at] == "1"
        };
        assert_eq!((1..=32).filter(runs).collect::<Vec<_>>(), running);
    }
}

/// Such a row is 1, 0, or null for a servo that an Alpha1 does not have.
#[test]
fn servo_that_is_not_there_has_no_value() {
    for (mask, values) in [(0x0002_7FFB_u32, [1, 0, 0]), (0xFFFD_8004, [0, 1, 1])] {
        let json = with_servos(&["monitor", "--arm", "alpha1", "PORT", "--json", "--count", "1"], mask);
        let row: serde_json::Value = serde_json::from_str(&json).unwrap();
        let servo = |n: u32| &row[format!("servo_{n}_runs")];
        assert_eq!([servo(1), servo(3), servo(16)], values, "{row}");
        for n in 17..=32 {
            let expected = (mask >> (n - 1) & 1 == 1).then_some(1);
            assert_eq!(servo(n), &serde_json::json!(expected), "servo {n}: {row}");
        }
    }
}

#[test]
fn frames_may_come_in_pieces_and_bursts() {
    let arm = Arm::start("alpha1", "alpha1-pieces", &[]);
    let firmware = [0xF5, 0x5F, 0x01, 0, 0, 0, 0, 0, 0x01, 0xED];
    for cut in 1..STOP.len() {
        let mut port = open(&arm);
        port.write_all(&[&[0x55, 0xF1][..], &STOP, &STOP[..cut]].concat())
            .unwrap();
        assert_eq!(read(&mut port), STOPPED);
        port.write_all(&[&STOP[cut..], &firmware].concat()).unwrap();
        // After a pause between the pieces, the robot discards the cut request.
        let mut answer: [u8; 4] = read(&mut port);
        if answer == STOPPED {
            answer = read(&mut port);
        }
        assert_eq!(answer, [0xF5, 0x5F, 0xAA, b'2'], "cut at {cut}");
        assert_eq!(read(&mut port), *b"015121519\xA5\xED");
    }
}

#[test]
fn with_hid_answers_are_reports_of_64_bytes() {
    let arm = Arm::start("alpha1", "alpha1-hid", &["--hid"]);
    let mut port = open(&arm);
    let mut report = [0; 64];
    report[..10].copy_from_slice(&STOP);
    for _ in 0..3 {
        port.write_all(&report).unwrap();
        let answer: [u8; 64] = read(&mut port);
        assert_eq!(answer[..4], STOPPED);
        assert_eq!(answer[4..], [0; 60]);
    }
    drop(port);
    assert_eq!(call(&arm, "hardware-version"), "arm: Alpha1, hardware: Alpha1_V2.0\n");
    let last = arm.stop(Signal::INT);
    assert!(
        last.contains(" answered, 0 refused), 0 unknown frames, 0 noise bytes"),
        "{last}"
    );
}

#[test]
fn servo_bus_has_its_servos_and_no_robot() {
    let arm = Arm::start("alpha1-servo", "servo-ids", &["--ids", "3,7-9"]);
    assert_eq!(call(&arm, "servo version 8"), "servo 8: version 41 16 51 01\n");
    assert_eq!(
        call(&arm, "servo move 3 240 --time 0 --lock 1"),
        "servo 3: understood\n"
    );
    assert_eq!(
        call(&arm, "servo read-angles 3"),
        "servo 3: released, at 240°, sent to 240°\n"
    );
    assert!(call(&arm, "servo release all").contains("the arm does not answer it"));
    assert!(failure(&run(&call_args(&arm, "servo version 1"))).contains("no answer"));
    assert!(failure(&run(&call_args(&arm, "servo-states"))).contains("no answer"));
}

#[test]
fn single_wire_bus_echoes_every_byte() {
    let arm = Arm::start("alpha1-servo", "servo-echo", &["--echo", "--turnaround-us", "400"]);
    let mut port = open(&arm);
    let request = [0xFA, 0xAF, 0x01, 0x01, 0x5A, 0x32, 0x00, 0x32, 0xC0, 0xED];
    port.write_all(&request).unwrap();
    assert_eq!(read(&mut port), request);
    assert_eq!(read(&mut port), [0xAB]);
    drop(port);
    assert_eq!(call(&arm, "servo read-offset 16"), "servo 16: offset +0.00°\n");
}

#[test]
fn requests_with_damaged_answers_are_repeated() {
    let arm = Arm::start(
        "alpha1",
        "alpha1-faults",
        &["--faults", "corrupt=10000", "--faults-on", "answers", "--seed", "3"],
    );
    for _ in 0..10 {
        assert_eq!(call(&arm, "hardware-version"), "arm: Alpha1, hardware: Alpha1_V2.0\n");
    }
    let last = arm.stop(Signal::INT);
    assert!(!last.contains(" 10 requests"), "none was damaged: {last}");
}

#[test]
fn virtual_robots_end_cleanly_on_signals() {
    for (kind, signal) in [("alpha1", Signal::INT), ("alpha1-servo", Signal::TERM)] {
        let arm = Arm::start(kind, "alpha1-end", &[]);
        call(&arm, "servo version 1");
        let port = arm.port.clone();
        let last = arm.stop(signal);
        // Ten bytes per request; the number of requests may differ.
        assert!(
            last.contains("0 bytes in, ") && last.contains("0 out, 0 not read; "),
            "{last}"
        );
        assert!(
            last.ends_with(" answered, 0 refused), 0 unknown frames, 0 noise bytes.\n"),
            "{last}"
        );
        assert!(fs::symlink_metadata(port).is_err(), "the link is left behind");
    }
}

#[test]
fn virtual_robots_do_not_replace_a_file() {
    let path = free_path("alpha1-file");
    fs::write(&path, "precious").unwrap();
    for kind in ["alpha1", "alpha1-servo"] {
        let line = failure(&run(&["sim", kind, "--pty", path.to_str().unwrap()]));
        assert!(line.contains("exists and is not a symbolic link"), "{line}");
    }
    assert_eq!(fs::read_to_string(&path).unwrap(), "precious");
    fs::remove_file(path).unwrap();
}

#[test]
fn wrong_values_are_refused_with_their_range() {
    for (args, message) in [
        (&["alpha1", "--firmware", "2016"][..], "it has 4 bytes, not 10"),
        (
            &["alpha1", "--hardware", &"x".repeat(255)],
            "text length is 255 bytes, must be 0..=254",
        ),
        (&["alpha1-servo", "--ids", "0"], "servo id is 0, must be 1..=240"),
        (&["alpha1-servo", "--ids", "1-241"], "servo id is 241, must be 1..=240"),
        (&["alpha1-servo", "--ids", "5-3"], "'5-3' is a descending range"),
    ] {
        let args = [&["sim"], args].concat();
        let printed = usage(&args);
        assert!(printed.contains(message), "{printed}");
    }
}

#[test]
fn missing_hid_device_is_reported() {
    for args in [
        &["info", "--arm", "alpha1", "hid:/dev/no-such-hidraw"][..],
        &["call", "alpha1", "hid:/dev/no-such-hidraw", "stop"],
        &["monitor", "--arm", "alpha1", "hid:/dev/no-such-hidraw", "--csv"],
    ] {
        let line = failure(&run(args));
        assert!(
            line.starts_with("hid:/dev/no-such-hidraw: no such HID device"),
            "{line}"
        );
    }
}

#[test]
fn only_an_alpha1_is_a_hid_device() {
    for args in [
        &["info", "hid:"][..],
        &["call", "ling", "hid:0483:5750", "read-joints"],
        &["torque", "hid:", "on"],
    ] {
        let text = usage(args);
        assert!(
            text.contains("is a HID device, and only an alpha1 is one (--arm alpha1)"),
            "{text}"
        );
    }
    assert!(usage(&["info", "--arm", "xarm", "hid:"]).contains("and not on hid:"));
    let text = usage(&["info", "--arm", "alpha1", "hid:", "--baud", "9600"]);
    assert!(
        text.contains("--baud applies to serial ports only, not to hid:"),
        "{text}"
    );
}
