//! The built program with an adapter's control port: state, configuration, line, and refusals.

use std::io::{BufRead, BufReader};
use std::process::{Command, Output};
use std::time::{Duration, Instant};

use armwire_bridge::start::Recovery;
use armwire_sim::pty::Pty;
use rustix::process::{Pid, Signal, kill_process};

use crate::common::board::Board;
use crate::common::{
    PROGRAM, TIMEOUT, angles, failure, finish, retry_while, retry_while_busy, run, start, success, usage,
};
use crate::stop::stop_by_the_port;

/// The factory configuration, as printed.
const FACTORY: &str = "\
arm=ling
poll=off
can.node=0
can.bit-rate=1000000
can.data-bit-rate=off
can.telemetry-hz=0
can.commands=off
can.command-timeout-ms=100
can.unsolicited=off
host-timeout.after-ms=500
host-timeout.torque-off=off
";

/// The name of the control port in messages.
fn name(board: &Board) -> &str {
    board.control.strip_prefix("control:").unwrap()
}

/// Runs a program with a pty for PORT on which these bytes do not end.
pub(crate) fn run_flooded(args: &[&str], bytes: &[u8]) -> Output {
    let pty = Pty::open(None).unwrap();
    let port = pty.path().to_str().unwrap();
    let args = args.iter().map(|arg| arg.replace("PORT", port));
    let mut child = start(Command::new(PROGRAM).args(args));
    let deadline = Instant::now() + TIMEOUT;
    while child.try_wait().unwrap().is_none() && Instant::now() < deadline {
        let _ = pty.read(&mut [0; 256]).unwrap();
        let _ = pty.write(bytes).unwrap();
        // Other tests need the processor, too.
        pty.wait(Some(Duration::from_millis(1))).unwrap();
    }
    finish(child)
}

#[test]
fn flooded_control_port_gets_a_sentence() {
    let text = b"temperature 25.3 C\r\n".repeat(20);
    let messages: Vec<u8> = (0..=255).cycle().take(4_000).collect();
    for (args, bytes) in [
        (&["counters", "control:PORT"][..], &text),
        (&["config", "control:PORT"], &messages),
        (&["reserve", "control:PORT"], &messages),
        (&["stop", "control:PORT"], &text),
    ] {
        let line = failure(&run_flooded(args, bytes));
        let cause = "the adapter does not answer in 3000 ms, and ";
        assert!(
            line.contains(cause) && line.contains(" bytes arrive that are no message of it (first bytes: "),
            "{line}"
        );
        assert!(
            line.ends_with("): is it the control port of an armwire adapter?"),
            "{line}"
        );
    }
}

#[test]
fn info_shows_the_adapter_and_the_arm() {
    let board = Board::start("info");
    let out = success(&["info", &board.port, "--control", &board.control]);
    let lines: Vec<_> = out.lines().take(4).collect();
    assert_eq!(
        lines,
        [
            "adapter          virtual, serial number 0123456789AB, firmware 1.2.3 (1a2b3c4d5e6f), chip 0x10016413",
            "configured       arm ling, poll off, silence after 500 ms",
            "can              node 0, 1000000 bit/s, telemetry off, commands off",
            "arm              Ling follower",
        ]
    );
    assert!(out.contains("self-check       all 10 servos normal"), "{out}");
    let out = success(&["info", &board.port]);
    assert!(out.starts_with("arm "), "a pty has no adapter: {out}");
    let out = success(&["info", &board.control]);
    assert!(
        out.starts_with("adapter ") && !out.contains("arm              "),
        "{out}"
    );
}

#[test]
fn adapter_without_can_shows_none() {
    let board = Board::start_without_can("no-can");
    let out = success(&["info", &board.control]);
    let lines: Vec<_> = out.lines().collect();
    assert_eq!(
        lines,
        [
            "adapter          virtual, serial number 0123456789AB, firmware 1.2.3 (1a2b3c4d5e6f), chip 0x10016413",
            "configured       arm ling, poll off, silence after 500 ms",
        ]
    );
    for command in ["info", "config"] {
        let json = success(&[command, "--json", &board.control]);
        assert!(
            json.contains("host-timeout.after-ms") && !json.contains("can"),
            "{json}"
        );
    }
    let factory: String = FACTORY
        .split_inclusive('\n')
        .filter(|line| !line.starts_with("can."))
        .collect();
    assert_eq!(success(&["config", &board.control]), factory);
}

#[test]
fn can_setting_is_refused_without_can() {
    let board = Board::start_without_can("no-can-set");
    for setting in ["can.node=3", "can.commands=off"] {
        let line = failure(&run(&["config", &board.control, "set", "poll=200", setting]));
        let (name, _) = setting.split_once('=').unwrap();
        assert!(
            line.ends_with(&format!(": the adapter has no CAN, and no setting '{name}'")),
            "{line}"
        );
    }
    // Nothing was set.
    assert!(success(&["config", &board.control]).contains("poll=off"));
    assert!(success(&["config", &board.control, "set", "poll=200"]).contains("poll=200"));
}

#[test]
fn info_uses_the_named_control_port_or_fails() {
    let board = Board::start("named");
    let out = expect_control(&board, &["info", &board.port]);
    assert!(out.starts_with("adapter          virtual, "), "{out}");
}

#[test]
fn monitor_uses_the_named_control_port_or_fails() {
    let board = Board::start("named-too");
    expect_control(&board, &["monitor", &board.port, "--count", "1"]);
}

/// Checks that the command accepts the adapter's control port and no other port. Returns its output.
fn expect_control(board: &Board, command: &[&str]) -> String {
    let with = |control: &str| run(&[command, &["--control", control]].concat());
    let line = failure(&with("/dev/no-such-port"));
    assert!(line.starts_with("/dev/no-such-port: no such port"), "{line}");
    let line = failure(&with("tcp:127.0.0.1:1"));
    assert!(
        line.ends_with(
            "no control port of an armwire adapter found: a virtual board's must be named by --control, such as \
             control:PATH"
        ),
        "{line}"
    );
    let silent = Pty::open(None).unwrap();
    let line = failure(&with(silent.path().to_str().unwrap()));
    assert!(
        line.ends_with("is it the control port of an armwire adapter?"),
        "{line}"
    );
    success(&[command, &["--control", name(board)]].concat())
}

#[test]
fn xarm_has_no_control_port() {
    let board = Board::start("xarm");
    for command in ["info", "monitor"] {
        let text = usage(&[command, "--arm", "xarm", "127.0.0.1:1", "--control", &board.control]);
        assert!(text.contains("--control does not apply to an xarm"), "{text}");
    }
}

#[test]
fn configuration_is_shown_set_saved_and_reset() {
    let board = Board::start("config");
    let config = |args: &[&str]| success(&[&["config", &board.control], args].concat());
    assert_eq!(config(&[]), FACTORY);
    assert_eq!(config(&["show"]), FACTORY);
    let changed = FACTORY
        .replace("poll=off", "poll=200")
        .replace("can.node=0", "can.node=3");
    assert_eq!(config(&["set", "poll=200", "can.node=3"]), changed);
    assert_eq!(config(&["save"]), changed);
    let counters = success(&["counters", &board.control]);
    assert!(
        counters
            .lines()
            .any(|line| line == "config_saves                     1"),
        "{counters}"
    );

    let back: Vec<_> = FACTORY.lines().collect();
    assert_eq!(config(&[&["set", "--save"], &back[..]].concat()), FACTORY);
    config(&["set", "can.commands=on"]);
    assert_eq!(config(&["reset"]), FACTORY);
}

#[test]
fn repeated_key_is_refused_before_port_opens() {
    for settings in [["poll=5", "poll=6"], ["can.node=1", "can.node=1"]] {
        let text = usage(&[&["config", "/dev/no-such-port", "set", "arm=raw"][..], &settings].concat());
        let (key, _) = settings[0].split_once('=').unwrap();
        let message = format!("{key} is given twice: {} and {}", settings[0], settings[1]);
        assert!(text.contains(&message), "{text}");
    }
}

#[test]
fn configuration_is_json_for_programs() {
    let board = Board::start("config-json");
    let out = success(&["config", &board.control, "show", "--json"]);
    let json: serde_json::Value = serde_json::from_str(&out).unwrap();
    assert_eq!(
        (&json["arm"], &json["can.bit-rate"]),
        (&"ling".into(), &1_000_000.into())
    );
    assert_eq!((&json["can.commands"], &json["poll"]), (&false.into(), &"off".into()));
    assert_eq!(json.as_object().unwrap().len(), FACTORY.lines().count());
}

#[test]
fn refused_configuration_is_reported_and_changes_nothing() {
    let board = Board::start("refused");
    let set = |setting: &str| failure(&run(&["config", &board.control, "set", setting]));
    for (setting, reason) in [
        ("poll=1001", "poll rate 1001 Hz, allowed 1 to 1000 Hz"),
        ("can.bit-rate=300000", "CAN bit rate 300000 bit/s, allowed"),
        (
            "can.command-timeout-ms=0",
            "command timeout 0 ms, allowed 1 to 10000 ms",
        ),
    ] {
        let line = set(setting);
        let message = format!("{}: rejected: {reason}", name(&board));
        assert!(line.starts_with(&message), "{line}");
    }
    assert_eq!(success(&["config", &board.control]), FACTORY);
    let text = usage(&["config", &board.control, "set", "pole=200"]);
    assert!(
        text.contains("there is no setting 'pole'; there are: arm, poll, can.node"),
        "{text}"
    );
    let text = usage(&["config", &board.control, "set"]);
    assert!(text.contains("KEY=VALUE"), "{text}");
    let help = success(&["config", "help", "set"]);
    assert!(
        FACTORY
            .lines()
            .all(|line| help.contains(line.split('=').next().unwrap())),
        "{help}"
    );
}

#[test]
fn counters_have_their_names_and_latencies_their_bars() {
    let board = Board::start("counters");
    success(&["call", "ling", &board.port, "read-joints"]);
    let out = success(&["counters", &board.control]);
    assert!(out.lines().any(|line| line.starts_with("requests_usb  ")), "{out}");
    assert!(
        out.contains("\nanswer (from a request's last byte to its answer's last byte): "),
        "{out}"
    );
    assert!(out.contains('█'), "{out}");
    let brief = success(&["counters", &board.control, "--brief"]);
    assert!(
        brief.contains("requests_usb") && !brief.contains("framing_errors"),
        "{brief}"
    );

    let json: serde_json::Value = serde_json::from_str(&success(&["counters", &board.control, "--json"])).unwrap();
    assert!(json["counters"]["requests_usb"].as_u64() >= Some(1), "{json}");
    assert_eq!(
        json["counters"].as_object().unwrap().len(),
        armwire_bridge::Counters::COUNT
    );
    assert_eq!(json["latencies"]["answer"][0]["below_us"], 2);
    assert_eq!(json["latencies"]["answer"][15]["below_us"], serde_json::Value::Null);
}

#[test]
fn line_is_reserved_until_interrupt() {
    let board = Board::start("reserve");
    let mut reserve = start(Command::new(PROGRAM).args(["reserve", &board.port, "--control", &board.control]));
    let mut line = String::new();
    let mut out = BufReader::new(reserve.stdout.take().unwrap());
    out.read_line(&mut line).unwrap();
    let name = name(&board);
    assert_eq!(
        line,
        format!("{name}: the line is reserved for USB: no polls, no CAN, no torque-off; Ctrl-C releases it\n")
    );
    kill_process(Pid::from_child(&reserve), Signal::INT).unwrap();
    line.clear();
    out.read_line(&mut line).unwrap();
    assert_eq!(line, format!("{name}: the line is released\n"));
    assert!(finish(reserve).status.success());
    assert!(!success(&["info", &board.control]).contains("\nrate "));
}

#[test]
fn info_config_and_counters_report_a_reserved_line() {
    let board = Board::start("reserved");
    let mut reserve = start(Command::new(PROGRAM).args(["reserve", &board.control]));
    BufReader::new(reserve.stdout.take().unwrap())
        .read_line(&mut String::new())
        .unwrap();
    // The reservation of a killed program lasts for a while.
    reserve.kill().unwrap();
    finish(reserve);
    let state = "1000000 baud, reserved for USB ('armwire reserve'): polls and CAN are refused";
    let out = success(&["info", &board.control]);
    assert!(out.ends_with(&format!("\nrate             {state}\n")), "{out}");
    for command in ["config", "counters"] {
        let output = run(&[command, &board.control]);
        let line = String::from_utf8(output.stderr).unwrap();
        assert_eq!(line, format!("armwire: {}: the line runs at {state}\n", name(&board)));
    }
}

#[test]
fn monitor_shows_the_adapters_readings_and_time() {
    let board = Board::start("readings");
    success(&["config", &board.control, "set", "poll=100"]);
    let out = success(&["monitor", &board.control, "--from-adapter", "--json", "--count", "5"]);
    let rows: Vec<serde_json::Value> = out.lines().map(|line| serde_json::from_str(line).unwrap()).collect();
    assert_eq!(rows.len(), 5);
    let stamps: Vec<_> = rows
        .iter()
        .map(|row| row["adapter_time_us"].as_u64().unwrap())
        .collect();
    assert!(stamps.windows(2).all(|pair| pair[0] < pair[1]), "{stamps:?}");
    for row in &rows {
        assert!(row["joint_6_deg"].as_f64().unwrap().abs() < 0.1, "{row}");
        assert_eq!(row["status"], "locked");
        assert_eq!(row["latency_us"], serde_json::Value::Null);
    }
}

#[test]
fn monitor_reports_an_adapter_without_polls() {
    let board = Board::start("hint");
    let mut monitor = start(Command::new(PROGRAM).args(["monitor", &board.control, "--from-adapter", "--count", "1"]));
    // Another host sends requests until the monitor has received an answer.
    while monitor.try_wait().unwrap().is_none() {
        success(&["call", "ling", &board.port, "read-joints"]);
    }
    let output = finish(monitor);
    let (stdout, stderr) = (
        String::from_utf8_lossy(&output.stdout),
        String::from_utf8_lossy(&output.stderr),
    );
    assert!(stderr.starts_with("armwire: the adapter does not poll"), "{output:?}");
    assert!(
        stdout.lines().count() == 1 && stdout.contains("gripper: 0.0 % open, status: locked"),
        "{output:?}"
    );
}

#[test]
fn adapter_for_another_arm_cannot_be_monitored() {
    let board = Board::start("raw");
    success(&["config", &board.control, "set", "arm=raw"]);
    let line = failure(&run(&["monitor", &board.control, "--from-adapter"]));
    assert!(
        line.ends_with("the adapter is configured for arm 'raw', which has no readings"),
        "{line}"
    );
}

/// The reason against a request to an adapter by the port of its arm, where the system does not show whose that is.
const NOT_SHOWN: &str =
    "the system does not show which adapter has this port: its control port must be named by --control";

#[test]
fn control_port_is_asked_for_not_guessed() {
    let board = Board::start("unshown");
    for args in [
        &["config", &board.port][..],
        &["config", &board.port, "set", "poll=200"],
        &["counters", &board.port],
        &["reserve", &board.port],
        &["monitor", &board.port, "--from-adapter"],
    ] {
        let line = failure(&run(args));
        assert!(line.starts_with(&format!("{}: {NOT_SHOWN}", board.port)), "{line}");
    }
    assert_eq!(success(&["config", &board.control]), FACTORY, "nothing was sent");
}

#[test]
fn named_control_port_is_used_by_every_command() {
    let board = Board::start("named-all");
    expect_control(&board, &["config", &board.port]);
    expect_control(&board, &["counters", &board.port, "--brief"]);
    let named = ["--control", name(&board)];
    let set = success(&[&["config", &board.port][..], &named, &["set", "poll=200"]].concat());
    assert!(set.contains("poll=200\n"), "{set}");
}

#[test]
fn missing_control_port_is_reported() {
    let board = Board::start("none");
    let line = failure(&run(&["config", "/dev/no-such-port"]));
    assert!(line.starts_with("/dev/no-such-port: no such port"), "{line}");
    let text = usage(&["info", &board.port, "--control", "tcp:localhost"]);
    assert!(text.contains("'localhost' has no port"), "{text}");
}
/// The state of an adapter in recovery.
const RECOVERY: &str = "factory settings after crashed starts, without CAN: the saved settings are unused and unchanged \
                        until others are saved";

/// An adapter in recovery.
fn recovering(name: &str, crashed_in_load: bool) -> Board {
    Board::start_as(name, Some(Recovery { crashed_in_load }))
}

/// The lines on standard error of a program that succeeds.
fn warnings(args: &[&str]) -> Vec<String> {
    let output = run(args);
    assert!(output.status.success(), "{output:?}");
    let text = String::from_utf8(output.stderr).unwrap();
    text.lines().map(str::to_owned).collect()
}

#[test]
fn info_shows_an_adapter_in_recovery() {
    let board = recovering("info-recovery", false);
    let out = success(&["info", &board.control]);
    assert_eq!(
        out.lines().nth(1),
        Some(&*format!("recovery         {RECOVERY}")),
        "{out}"
    );
    let json = success(&["info", "--json", &board.control]);
    assert!(json.contains(&format!("\"recovery\": \"{RECOVERY}\"")), "{json}");
    let usual = Board::start("info-usual");
    let out = success(&["info", &usual.control]);
    assert!(!out.contains("recovery"), "{out}");
}

#[test]
fn commands_that_move_warn_of_recovery_once() {
    let board = recovering("move-recovery", false);
    let warning = format!("armwire: {}: the adapter has {RECOVERY}", name(&board));
    let target = ["--joints", "0,0,0,0,0,0", "--speed", "400", "--gripper", "50"];
    let port = [&board.port, "--control", &board.control];
    for command in [
        [&["move"], &port[..], &target].concat(),
        [&["torque"], &port[..], &["on"]].concat(),
        [&["call", "ling"], &port[..], &["move"], &target].concat(),
    ] {
        assert_eq!(warnings(&command), [&*warning], "{command:?}");
    }
    let usual = Board::start("move-usual");
    let port = [&usual.port, "--control", &usual.control];
    assert_eq!(warnings(&[&["move"], &port[..], &target].concat()), [""; 0]);
}

#[test]
fn save_names_what_it_overwrites_and_ends_recovery() {
    let overwritten = "saved settings are overwritten: arm=ling poll=50 can.node=15 can.bit-rate=500000 \
                       can.data-bit-rate=off can.telemetry-hz=0 can.commands=off can.command-timeout-ms=100 \
                       can.unsolicited=off host-timeout.after-ms=300 host-timeout.torque-off=on";
    let unreadable = "saved settings that are unreadable are overwritten";
    for (crashed_in_load, overwritten) in [(false, overwritten), (true, unreadable)] {
        for action in [&["save"][..], &["set", "poll=7", "--save"], &["reset"]] {
            let board = recovering("config-recovery", crashed_in_load);
            let config = [&["config", &board.control], action].concat();
            assert_eq!(warnings(&config), [format!("armwire: {}: {overwritten}", name(&board))]);
            assert_eq!(warnings(&config), [""; 0]);
            assert!(!success(&["info", &board.control]).contains("recovery"));
        }
    }
}

#[test]
fn setting_without_save_does_not_end_recovery() {
    let board = recovering("set-recovery", false);
    let warning = format!("armwire: {}: the adapter has {RECOVERY}", name(&board));
    for action in [&["show"][..], &["set", "poll=7"]] {
        assert_eq!(warnings(&[&["config", &board.control], action].concat()), [&*warning]);
    }
}

/// A move to this angle of the first joint, by the port of the board's arm.
fn move_to<'a>(board: &'a Board, joints: &'a str) -> Vec<&'a str> {
    let target = ["--joints", joints, "--speed", "400", "--gripper", "50"];
    [&["move", &board.port, "--control", &board.control][..], &target].concat()
}

#[test]
fn refused_motion_is_not_reported_as_sent() {
    let board = Board::start("refused-motion");
    let call = ["call", "ling", &board.port, "--control", &board.control, "move"];
    let target = ["--joints", "30,0,0,0,0,0", "--speed", "400", "--gripper", "50"];
    let moved = move_to(&board, "30,0,0,0,0,0");
    for args in [
        &moved[..],
        &[&moved[..], &["--wait"]].concat(),
        &[call, target].concat(),
    ] {
        success(&["stop", &board.control]);
        let output = retry_while_busy(|| run(args));
        let line = failure(&output);
        let expected = format!("{}: motion is refused for ", board.port);
        let seconds: f32 = line
            .strip_prefix(&expected)
            .unwrap()
            .split(' ')
            .next()
            .unwrap()
            .parse()
            .unwrap();
        assert!(
            (0.1..=2.0).contains(&seconds) && line.ends_with(" s more: stopped by a host on USB"),
            "{line}"
        );
        assert!(output.stdout.is_empty(), "{output:?}");
    }
    assert!(angles(&board.port)[0].abs() < 0.5, "it moves");
}

#[test]
fn motion_after_the_refusal_is_sent() {
    let board = Board::start("later-motion");
    success(&["stop", &board.control]);
    let args = [&move_to(&board, "30,0,0,0,0,0")[..], &["--wait"]].concat();
    let out = retry_while("motion is refused", || run(&args));
    assert!(
        String::from_utf8_lossy(&out.stdout).starts_with("target reached: "),
        "{out:?}"
    );
}

#[test]
fn hold_that_a_stop_refuses_is_no_failure() {
    let board = Board::start("refused-hold");
    success(&["stop", &board.control]);
    let out = stop_by_the_port(&board.port, &["--gripper", "0"]);
    assert!(
        out.starts_with("stopped: ") && out.ends_with("status: locked\n"),
        "{out}"
    );
}
