//! The built program on CAN: an arm and its adapter behind an SLCAN adapter, and errors.

use std::process::Output;
use std::sync::atomic::Ordering;
use std::time::Instant;

use armwire_bridge::can::Function;

use crate::adapter::run_flooded;
use crate::common::adapter::{BIT_RATE, CanBus, NODE};
use crate::common::{NO_ANSWER, TIMEOUT, failure, free_path, run, run_against, success, usage};

/// A request that needs several CAN frames.
const MOVE: [&str; 7] = ["move", "--joints", "0,0,0,0,0,0", "--speed", "20", "--gripper", "0"];

#[test]
fn info_shows_the_adapter_and_the_arm() {
    let bus = CanBus::start();
    let out = success(&["info", &bus.port()]);
    for line in [
        "adapter          virtual, serial number 0123456789AB, firmware 1.2.3",
        "configured       arm ling, poll off, silence after 500 ms",
        "can              node 3, 1000000 bit/s, telemetry off, commands off",
        "arm              Ling follower",
        "status           locked",
        "self-check       all 10 servos normal",
        "line             clean",
    ] {
        assert!(out.lines().any(|printed| printed == line), "{line} is not in\n{out}");
    }
    let again = success(&["info", &bus.port()]);
    assert_eq!(again.lines().count(), out.lines().count(), "a bus may be opened again");
}

#[test]
fn node_needs_no_bit_rate() {
    let bus = CanBus::start_as(1_000_000, 3);
    let link = free_path("slcan-link");
    std::os::unix::fs::symlink(&bus.path, &link).unwrap();
    let out = success(&["info", &format!("slcan:{}/3", link.display())]);
    std::fs::remove_file(link).unwrap();
    assert!(out.contains("can              node 3, 1000000 bit/s"), "{out}");
}

#[test]
fn call_in_many_frames_reaches_the_arm() {
    let bus = CanBus::start();
    let moved = success(&[&["call", "ling", &bus.port()], &MOVE[..]].concat());
    assert!(moved.contains("sent, the arm does not answer it"), "{moved}");
    let joints = success(&["call", "ling", &bus.port(), "read-joints"]);
    assert!(joints.contains("joint"), "{joints}");
    // After the answer, all earlier frames have arrived: those of the move, and one of this request.
    let requests = |frame: &&_| Function::of(armwire_bridge::can::Frame::id(frame)).unwrap().0 == Function::ArmRequest;
    assert!(
        bus.sent.lock().unwrap().iter().filter(requests).count() > 5,
        "the move is no longer than a frame"
    );
}

#[test]
fn monitor_reads_over_can() {
    let bus = CanBus::start();
    let out = success(&["monitor", &bus.port(), "--rate", "100", "--count", "3"]);
    assert_eq!(out.lines().count(), 3, "{out}");
}

/// The error of a failing program that contains this text. On a busy system the CAN adapter replies late without its
/// status, so the program is repeated.
fn failure_with(text: &str, mut run: impl FnMut() -> Output) -> String {
    let deadline = Instant::now() + TIMEOUT;
    loop {
        let line = failure(&run());
        if line.contains(text) || Instant::now() > deadline {
            return line;
        }
    }
}

#[test]
fn wrong_bit_rate_is_reported_with_adapter_status() {
    let bus = CanBus::start();
    let port = format!("slcan:{}@1000000/{NODE}", bus.path);
    let status = "the CAN adapter reports error passive, bus error";
    let line = failure_with(status, || run(&["call", "ling", &port, "read-joints"]));
    assert!(line.starts_with(&port) && line.contains(NO_ANSWER), "{line}");
    assert!(line.contains(status), "{line}");
    assert!(line.contains("does the bus have 1000000 bit/s"), "{line}");
}

#[test]
fn unacknowledged_request_is_reported_at_once() {
    let bus = CanBus::start();
    let port = format!("slcan:{}@{BIT_RATE}/4", bus.path);
    let line = failure(&run(&[&["call", "ling", &port], &MOVE[..]].concat()));
    assert!(line.contains("no flow control in 1000000 µs"), "{line}");
    assert!(line.contains("is the adapter on this bus as node 4"), "{line}");
}

#[test]
fn missing_adapter_does_not_answer() {
    let bus = CanBus::start();
    let port = format!("slcan:{}@{BIT_RATE}/4", bus.path);
    let line = failure(&run(&["info", &port]));
    assert!(
        line.contains("the adapter does not answer in 3000 ms: is the adapter on this bus as node 4"),
        "{line}"
    );
}

#[test]
fn reserved_line_explains_silence_on_can() {
    let bus = CanBus::start();
    bus.is_reserved.store(true, Ordering::Relaxed);
    let state = "9600 baud instead of the arm's 1000000 baud, set by the host on USB: polls and CAN are refused";
    let runs_at = format!("the line to the arm runs at {state}");
    let line = failure_with(&runs_at, || run(&["call", "ling", &bus.port(), "read-joints"]));
    assert!(line.contains(&runs_at), "{line}");
    let output = run(&["info", &bus.port()]);
    let out = String::from_utf8_lossy(&output.stdout);
    assert!(
        out.lines().any(|line| line == format!("rate             {state}")),
        "{output:?}"
    );
}

#[test]
fn older_adapter_does_not_support_reserve() {
    let bus = CanBus::start();
    let line = failure(&run(&["reserve", &bus.port()]));
    assert!(line.contains("the adapter does not support this request"), "{line}");
}

#[test]
fn port_without_an_slcan_adapter_is_reported() {
    let line = failure(&run_against(&["info", "slcan:PORT"], |_, _, _| {}));
    assert!(
        line.contains("no answer to SLCAN: is it a CAN adapter with this protocol, and at 115200 baud?"),
        "{line}"
    );
}

#[test]
fn flooded_port_has_no_slcan_adapter() {
    for bytes in [&b"temperature 25.3 C\r\n"[..], &[0xFF; 400]] {
        let line = failure(&run_flooded(&["counters", "slcan:PORT"], bytes));
        assert!(line.contains("no answer to SLCAN: is it a CAN adapter"), "{line}");
    }
}

#[test]
fn refusal_of_an_slcan_adapter_is_reported() {
    let refused = "the CAN adapter refuses 1000000 bit/s";
    let line = failure_with(refused, || {
        run_against(&["info", "slcan:PORT"], |_, pty, _| {
            pty.write(b"\x07").unwrap();
        })
    });
    assert!(line.contains(refused), "{line}");
}

#[test]
fn unknown_interface_is_reported() {
    let line = failure(&run(&["info", "can:can99"]));
    assert!(line.starts_with("can:can99: no such CAN interface"), "{line}");
}

#[test]
fn invalid_bit_rate_and_node_are_refused() {
    assert!(usage(&["info", "slcan:/dev/null@123"]).contains("bit rate '123' is not an SLCAN bit rate"));
    assert!(usage(&["info", "can:can0/16"]).contains("node id is 16, must be 0..=15"));
}

#[test]
fn servo_bus_is_looked_for_behind_the_adapter() {
    let bus = CanBus::start();
    // The adapter is set to another arm.
    let error = failure(&run(&["bus", &bus.port(), "--ids", "1-2"]));
    assert!(
        error.contains("no servo answers to the ids of --ids") && error.contains("is the adapter set to raw?"),
        "{error}"
    );
    let nobody = format!("slcan:{}@{BIT_RATE}/{}", bus.path, NODE + 1);
    let error = failure(&run(&["bus", &nobody, "--ids", "1-2"]));
    assert!(error.contains("is the adapter on this bus as node 4"), "{error}");
}
