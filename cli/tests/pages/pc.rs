//! The commands in the page about an arm on a PC.

use crate::common::{Arm, NO_ANSWER, retry_while, run};

const PAGE: &str = include_str!("../../../docs/pc.md");

#[test]
fn first_move_and_stop_work_as_written() {
    let arm = Arm::start("ling", "pc-page", &[]);
    let mut calls = 0;
    for line in PAGE.lines().filter_map(|line| line.strip_prefix("$ armwire ")) {
        let command = line.split('#').next().unwrap_or_default();
        let args: Vec<_> = command
            .split_whitespace()
            .map(|arg| arg.replace("/dev/ttyUSB0", &arm.port))
            .collect();
        let args: Vec<_> = args.iter().map(String::as_str).collect();
        let is_motion = matches!(args[..], ["move" | "stop", ..]);
        if is_motion {
            let output = retry_while(NO_ANSWER, || run(&args));
            assert!(output.status.success(), "{command}: {output:?}");
            calls += 1;
        }
    }
    assert_eq!(calls, 2);
}
