//! Help.

use std::fs::File;
use std::process::Command;

use crate::common::terminal::Terminal;
use crate::common::{Arm, PROGRAM, failure, retry_while_busy, success, usage};

/// Adds a command and its subcommands: their words and help.
fn screens(command: &[String], screens: &mut Vec<(Vec<String>, String)>) {
    let words: Vec<_> = command.iter().map(String::as_str).collect();
    let help = success(&[&words[..], &["--help"]].concat());
    let list = help.lines().skip_while(|line| *line != "Commands:").skip(1);
    // Continuation lines are indented further.
    let names = list.take_while(|line| !line.is_empty()).filter_map(|line| {
        let name = line.strip_prefix("  ")?.split(' ').next()?;
        (!name.is_empty() && name != "help").then(|| name.to_owned())
    });
    let names: Vec<_> = names.collect();
    screens.push((command.to_owned(), help));
    for name in names {
        self::screens(&[command, &[name]].concat(), screens);
    }
}

fn all_screens() -> Vec<(Vec<String>, String)> {
    let mut all = Vec::new();
    screens(&[], &mut all);
    assert!(all.len() > 50, "{} screens", all.len());
    all
}

#[test]
fn help_is_80_columns_wide_without_a_terminal() {
    for (command, long) in all_screens() {
        let words: Vec<_> = command.iter().map(String::as_str).collect();
        let short = success(&[&words[..], &["-h"]].concat());
        let mut lines = long.lines().chain(short.lines());
        let wide = lines.find(|line| line.chars().count() > 80);
        assert_eq!(wide, None, "{command:?}");
    }
}

#[test]
fn help_that_goes_nowhere_is_an_error() {
    for (command, _) in all_screens() {
        goes_nowhere(&command.iter().map(String::as_str).chain(["--help"]).collect::<Vec<_>>());
    }
    for args in [
        &["--version"][..],
        &["help", "info"],
        &["completions", "bash"],
        &["list", "--json"],
    ] {
        goes_nowhere(args);
    }
}

/// Asserts that a program with a full disk for its output fails with that reason.
fn goes_nowhere(args: &[&str]) {
    let output = retry_while_busy(|| {
        let full = File::options().write(true).open("/dev/full").unwrap();
        Command::new(PROGRAM).args(args).stdout(full).output().unwrap()
    });
    let line = failure(&output);
    assert!(line.starts_with("cannot write the output: "), "{args:?}: {line}");
}

#[test]
fn results_that_go_nowhere_are_an_error() {
    let arm = Arm::start("ling", "full", &[]);
    let port = &*arm.port;
    for args in [
        &["info", port][..],
        &["info", port, "--json"],
        &["monitor", port, "--csv", "--count", "2"],
        &["call", "ling", port, "read-joints"],
        &["torque", port, "on"],
        &["bench", port, "--rate", "50", "--seconds", "0.1"],
        &["decode", "tests/texts/ling.bin"],
        &["sim", "ling"],
        &["sim", "xarm", "--listen", "127.0.0.1:0", "--no-report"],
        &["sim", "alpha1"],
        &["sim", "alpha1-servo"],
    ] {
        goes_nowhere(args);
    }
}

#[test]
fn numbers_of_options_are_refused_in_words() {
    for (args, expected) in [
        (
            &["monitor", "/dev/nothing", "--rate", "0"][..],
            "'0' is not a whole number from 1 to 1000",
        ),
        (
            &["record", "/dev/nothing", "x.mcap", "--rate", "x"],
            "'x' is not a whole number from 1 to 1000",
        ),
        (
            &["monitor", "/dev/nothing", "--count", "-1"],
            "'-1' is not a whole number from 1 to ",
        ),
        (
            &["sim", "ling", "--seed", "-1"],
            "'-1' is not a whole number from 0 to ",
        ),
        (
            &["sim", "ling", "--turnaround-us", "x"],
            "'x' is not a whole number from 0 to ",
        ),
        (
            &["sim", "alpha1", "--idle-ms", "4294967296"],
            "'4294967296' is not a whole number from 0 to 4294967295",
        ),
        (
            &["sim", "alpha1-servo", "--turnaround-us", "0.5"],
            "'0.5' is not a whole number from 0 to ",
        ),
    ] {
        let text = usage(args);
        assert!(text.contains(expected), "{text}");
    }
}

#[test]
fn wrong_baud_rate_is_refused_in_words() {
    for rate in ["0", "fast", "4294967296"] {
        let text = usage(&["info", "/dev/nothing", "--baud", rate]);
        assert!(text.contains("a baud rate is a number from 1 to 4294967295"), "{text}");
    }
}

#[test]
fn help_is_one_column_on_a_narrow_terminal() {
    const COLUMNS: u16 = 30;
    for (command, _) in all_screens() {
        let words: Vec<_> = command.iter().map(String::as_str).collect();
        let mut terminal = Terminal::new(COLUMNS, 6);
        let child = terminal.start(&[&words[..], &["-h"]].concat());
        assert!(terminal.finish(child).status.success());
        let help = without_colours(&terminal.seen);
        let is_word = |line: &str| !line.trim().contains(' ');
        // The usage is not wrapped: the terminal breaks it anywhere.
        let is_usage = |line: &str| line.starts_with("Usage: ") || line.starts_with("       ") && line.contains('<');
        let is_option = |line: &str| line.trim_start().starts_with("--") && !line.trim().contains("  ");
        let wide = help.lines().map(str::trim_end).find(|line| {
            line.chars().count() > COLUMNS.into() && !is_word(line) && !is_usage(line) && !is_option(line)
        });
        assert_eq!(wide, None, "{command:?}");
    }
}

/// Terminal text without its escape sequences, all of which end with `m`.
fn without_colours(text: &str) -> String {
    let mut parts = text.split('\x1b');
    let first = parts.next().unwrap_or_default();
    let rest = parts.map(|part| part.split_once('m').unwrap().1);
    std::iter::once(first).chain(rest).collect()
}

#[test]
fn help_is_as_wide_as_the_terminal() {
    for (columns, first) in [
        (40, "Identify the adapter and the arm on a"),
        (
            120,
            "Identify the adapter and the arm on a port, and show the arm's state",
        ),
    ] {
        let mut terminal = Terminal::new(columns, 24);
        let child = terminal.start(&["info", "--help"]);
        assert!(terminal.finish(child).status.success());
        assert_eq!(terminal.seen.lines().next(), Some(first));
        let text = without_colours(&terminal.seen);
        let wide = text
            .lines()
            .find(|line| line.trim_end().chars().count() > columns.into());
        assert_eq!(wide, None);
    }
}
