//! `armwire selftest` without an adapter. The tests in `host-tests` run its checks on a virtual board.

use crate::common::board::Board;
use crate::common::{failure, run};

#[test]
fn missing_port_is_reported() {
    let line = failure(&run(&["selftest", "/dev/nothing", "--yes"]));
    assert!(line.starts_with("/dev/nothing: no such port"), "{line}");
}

#[test]
fn port_without_an_adapter_is_refused() {
    let board = Board::start("selftest");
    let line = failure(&run(&["selftest", &board.port, "--yes"]));
    assert!(line.contains("no adapter on USB is known to have this port"), "{line}");
}

#[test]
fn report_replaces_no_file() {
    let reported_to = |path| failure(&run(&["selftest", "/dev/nothing", "--yes", "--report", path]));
    let line = reported_to("/no/such/folder/report");
    assert!(line.starts_with("/no/such/folder/report: its folder: "), "{line}");
    let line = reported_to(concat!(env!("CARGO_MANIFEST_DIR"), "/Cargo.toml"));
    assert!(line.ends_with("the file exists: delete it, or name another"), "{line}");
}

#[test]
fn error_of_unknown_check_lists_known_ones() {
    let output = run(&["selftest", "/dev/nothing", "--only", "echo,gap"]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success());
    assert!(
        text.contains("possible values: echo, halts, reconfiguration, cancels"),
        "{text}"
    );
}
