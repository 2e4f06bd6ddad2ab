//! Passes the board's memory map to the linker as the `memory.x` that the workspace includes: a plain `cargo build` then
//! links.

mod sources;

use std::path::Path;
use std::process::Command;
use std::{env, fs};

use armwire_boards::{Board, Uart};

use sources::SOURCES;

/// The names of the boards' features and memory files.
const BOARDS: [&str; 3] = ["rp2040", "stm32f405", "stm32g431"];

fn main() {
    println!("cargo:rustc-env=ARMWIRE_COMMIT={}", commit());
    warn_of_other_profiles();
    let here = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let out = env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let chosen = |board: &&str| env::var_os(format!("CARGO_FEATURE_BOARD_{}", board.to_uppercase())).is_some();
    // `src/board/mod.rs` reports a missing board, or two of them.
    let Some(board) = BOARDS.into_iter().find(chosen) else {
        return;
    };
    let memory = Path::new(&out).join("board-memory.x");
    fs::write(memory, format!("INCLUDE {board}.x\n")).expect("cargo has made the folder");
    // The interrupts of the arm's UART are bound by its name.
    println!("cargo:rustc-check-cfg=cfg(arm_at_usart3)");
    println!("cargo:rerun-if-env-changed=ARMWIRE_BOARD");
    let name = env::var("ARMWIRE_BOARD").unwrap_or(board.into());
    if Board::find(&name).is_some_and(|board| board.uart == Uart::Usart3) {
        println!("cargo:rustc-cfg=arm_at_usart3");
    }
    println!("cargo:rustc-link-search={out}");
    println!("cargo:rustc-link-search={here}/memory");
    // The linker's list of what it read, which `cargo xtask workflow` compares with the sources.
    println!("cargo:rustc-link-arg-bins=--dependency-file={out}/linker-inputs.d");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    if board == "rp2040" {
        // The second stage of its boot loader.
        println!("cargo:rustc-link-arg-bins=-Tlink-rp.x");
    }
    // Identical functions are kept once.
    println!("cargo:rustc-link-arg-bins=--icf=all");
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
}

/// Warns of a build outside of this folder, which takes the profiles of the workspace.
fn warn_of_other_profiles() {
    println!("cargo:rerun-if-env-changed=ARMWIRE_PROFILES");
    let is_image = env::var("CARGO_CFG_TARGET_OS").is_ok_and(|system| system == "none");
    if is_image && env::var_os("ARMWIRE_PROFILES").is_none() {
        println!("cargo:warning=this is not the image that ships: `cd firmware` first, where cargo has its profiles");
    }
}

/// The commit of the build, followed by `+` if files of the image were modified. Empty without git.
fn commit() -> String {
    let logs = git(&["rev-parse", "--git-path", "logs/HEAD"]);
    for path in SOURCES.into_iter().chain(logs.as_deref()) {
        println!("cargo:rerun-if-changed={path}");
    }
    let Some(head) = git(&["rev-parse", "--short=12", "HEAD"]) else {
        return String::new();
    };
    match git(&[&["status", "--porcelain", "--"], &SOURCES[..]].concat()).as_deref() {
        Some("") => head,
        _ => head + "+",
    }
}

/// The output of git, without its line end. `None` without git or a repository.
fn git(args: &[&str]) -> Option<String> {
    let output = Command::new("git").args(args).output().ok()?;
    let text = String::from_utf8(output.stdout).ok()?;
    output.status.success().then(|| text.trim_end().into())
}
