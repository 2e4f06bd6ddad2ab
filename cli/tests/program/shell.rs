//! Completions and manual pages.

use std::fs::{self, File};
use std::process::Command;

use crate::common::{PROGRAM, free_path, success};

#[test]
fn each_shell_has_completions() {
    for shell in ["bash", "zsh", "fish", "elvish", "powershell"] {
        // A script is larger than the buffer of a pipe.
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
    let above = free_path("man");
    let folder = above.join("man1");
    success(&["man", folder.to_str().unwrap()]);
    for page in ["armwire.1", "armwire-info.1", "armwire-call-ling-move.1"] {
        let text = fs::read_to_string(folder.join(page)).unwrap();
        assert!(text.contains(".SH NAME"), "{page}");
    }
    success(&["man", folder.to_str().unwrap()]);
    fs::remove_dir_all(above).unwrap();
}
