//! Help, completions and manual pages.

use std::fs::{self, File};
use std::process::Command;

use crate::common::terminal::Terminal;
use crate::common::{PROGRAM, free_path, success};

const COMMANDS: [&[&str]; 22] = [
    &[],
    &["sim"],
    &["sim", "ling"],
    &["sim", "xarm"],
    &["sim", "alpha1"],
    &["sim", "alpha1-servo"],
    &["info"],
    &["list"],
    &["monitor"],
    &["move"],
    &["torque"],
    &["set-zero"],
    &["call"],
    &["call", "ling", "move"],
    &["call", "xarm", "raw"],
    &["call", "alpha1", "act"],
    &["decode"],
    &["config"],
    &["config", "set"],
    &["counters"],
    &["hold"],
    &["update"],
];

#[test]
fn help_is_80_columns_wide_without_a_terminal() {
    for command in COMMANDS {
        for option in ["-h", "--help"] {
            let help = success(&[command, &[option]].concat());
            let wide = help.lines().find(|line| line.chars().count() > 80);
            assert_eq!(wide, None, "{command:?} {option}");
        }
    }
}

/// What is left of text on a terminal without its escape sequences, each of which ends with an m.
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

#[test]
fn each_shell_has_completions() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        // A script is longer than a pipe.
        let path = free_path(shell);
        let mut command = Command::new(PROGRAM);
        let command = command
            .args(["completions", shell])
            .stdout(File::create(&path).unwrap());
        assert!(command.status().unwrap().success());
        let script = fs::read_to_string(&path).unwrap();
        fs::remove_file(path).unwrap();
        assert!(script.contains("armwire") && script.contains("set-zero"), "{shell}");
    }
}

#[test]
fn each_command_has_a_manual_page() {
    let folder = free_path("man");
    fs::create_dir(&folder).unwrap();
    success(&["man", folder.to_str().unwrap()]);
    for page in ["armwire.1", "armwire-info.1", "armwire-call-ling-move.1"] {
        let text = fs::read_to_string(folder.join(page)).unwrap();
        assert!(text.contains(".SH NAME"), "{page}");
    }
    fs::remove_dir_all(folder).unwrap();
}
