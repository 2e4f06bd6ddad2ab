//! `armwire list`.

use armwire_sim::pty::Pty;

use crate::common::{Arm, NO_ANSWER, failure, retry_while, run, success};

#[test]
fn list_shows_the_arms_on_ports() {
    let ling = Arm::start("ling", "list-ling", &["--serial", "ADFS990101000001"]);
    let alpha1 = Arm::start("alpha1", "list-alpha1", &[]);
    let silent = Pty::open(None).unwrap();
    let silent = silent.path().to_str().unwrap();
    let out = success(&[
        "list",
        &ling.port,
        &alpha1.port,
        silent,
        "/dev/no-such-port",
        "hid:/dev/no-such-hidraw",
    ]);
    for line in [
        format!(
            "{}  arm: Ling follower, serial: ADFS990101000001, hardware: v1.10, firmware: v6.10",
            ling.port
        ),
        format!("{}  arm: Alpha1, hardware: Alpha1_V2.0", alpha1.port),
        format!("{silent}  arm: no answer"),
    ] {
        assert!(out.lines().any(|printed| printed == line), "{line} is not in\n{out}");
    }
    assert!(
        out.contains("/dev/no-such-port  error: /dev/no-such-port: no such port"),
        "{out}"
    );
    assert!(
        out.contains("hid:/dev/no-such-hidraw  error: hid:/dev/no-such-hidraw: no such HID device"),
        "{out}"
    );
}

#[test]
fn list_is_json_for_programs() {
    let arm = Arm::start("ling", "list-json", &[]);
    let json: serde_json::Value = serde_json::from_str(&success(&["list", "--json", &arm.port])).unwrap();
    let mut ports = json.as_array().unwrap().iter();
    let ours = ports.find(|port| port["port"] == *arm.port).unwrap();
    assert_eq!(ours["arm"], "Ling follower");
}

#[test]
fn info_is_json_for_programs() {
    let arm = Arm::start("ling", "info-json", &[]);
    let json: serde_json::Value = serde_json::from_str(&success(&["info", "--json", &arm.port])).unwrap();
    assert_eq!(
        (
            &json["arm"],
            &json["joint_6_deg"],
            &json["stroke_mm"],
            &json["noise_bytes"]
        ),
        (&"Ling follower".into(), &0.0.into(), &50.into(), &0.into())
    );
    let silent = Pty::open(None).unwrap();
    let output = run(&["info", "--json", silent.path().to_str().unwrap()]);
    assert!(
        failure(&output).contains(NO_ANSWER) && output.stdout.is_empty(),
        "{output:?}"
    );
}

#[test]
fn info_json_has_the_adapters_configuration() {
    let board = crate::common::board::Board::start("info-json");
    let output = retry_while(NO_ANSWER, || {
        run(&["info", "--json", &board.port, "--control", &board.control])
    });
    let json: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    assert_eq!(
        (&json["adapter_board"], &json["config"]["can.bit-rate"], &json["arm"]),
        (&"virtual".into(), &1_000_000.into(), &"Ling follower".into())
    );
}
