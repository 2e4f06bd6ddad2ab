//! `armwire selftest` where there is no adapter. The checks themselves run on a virtual board, in `host-tests`.

use crate::common::board::Board;
use crate::common::{failure, run};

#[test]
fn port_that_is_not_there_is_told() {
    let line = failure(&run(&["selftest", "/dev/nothing", "--yes"]));
    assert!(line.starts_with("/dev/nothing: no such port"), "{line}");
}

#[test]
fn port_of_no_adapter_is_refused() {
    let board = Board::start("selftest");
    let line = failure(&run(&["selftest", &board.port, "--yes"]));
    assert!(line.contains("this is not the port of an armwire adapter"), "{line}");
}

#[test]
fn checks_are_listed_where_one_is_unknown() {
    let output = run(&["selftest", "/dev/nothing", "--only", "echo,gap"]);
    let text = String::from_utf8(output.stderr).unwrap();
    assert!(!output.status.success());
    assert!(
        text.contains("possible values: echo, halts, reconfiguration, cancels"),
        "{text}"
    );
}
