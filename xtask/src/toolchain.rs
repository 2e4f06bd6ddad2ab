//! The active compiler, and its `core` library for other targets, which rustup adds if it is missing.

use std::env;
use std::fs;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::cargo::{cargo, target_dir};
use crate::installation::with_lock;
use crate::process::output;

/// Cargo with these words as arguments, for this target. More arguments can be added.
///
/// # Errors
///
/// If the target is missing and rustup cannot add it. The error has the command.
pub(crate) fn cargo_for(target: &str, words: &str) -> Result<Command> {
    require_target(target)?;
    let mut command = cargo(words);
    command.args(["--target", target]);
    // That of a package outside of the workspace is another one.
    command.env("CARGO_TARGET_DIR", target_dir()?);
    Ok(command)
}

/// Checks that the active compiler has this target, or lets rustup add it.
///
/// # Errors
///
/// If the target is missing and rustup cannot add it. The error has the command.
pub(crate) fn require_target(target: &str) -> Result<()> {
    ensure!(
        has_target(target),
        "no compiler for {target}; run `rustup target add {target}`"
    );
    Ok(())
}

/// The active compiler.
pub(crate) fn rustc() -> Command {
    Command::new(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()))
}

/// A line of `rustc -vV`, such as `host`.
///
/// # Errors
///
/// If there is no such line.
pub(crate) fn rustc_property(name: &str) -> Result<String> {
    let lines = output(rustc().arg("-vV"))?;
    let value = lines
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
    value
        .map(Into::into)
        .with_context(|| format!("`rustc -vV` has no {name}"))
}

/// Returns true if the active compiler has this target, or rustup has added it.
fn has_target(target: &str) -> bool {
    is_installed(target) || add_with_rustup(target)
}

fn is_installed(target: &str) -> bool {
    let libraries = output(rustc().args(["--print", "target-libdir", "--target", target]));
    let files = libraries.map(|folder| fs::read_dir(folder.trim()));
    let mut files = files.into_iter().flatten().flatten();
    files.any(|file| file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore-")))
}

/// Returns true if rustup is installed and has added the target.
fn add_with_rustup(target: &str) -> bool {
    println!("rustup adds {target}");
    let added = with_lock(|| output(Command::new("rustup").args(["target", "add", target])));
    if let Err(error) = &added {
        println!("rustup failed: {error:#}");
    }
    added.is_ok() && is_installed(target)
}
