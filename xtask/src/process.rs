//! Other programs.

use std::env;
use std::path::Path;
use std::process::{Command, Stdio};

use crate::Result;

/// The cargo that runs us, in the environment of whoever called it.
pub(crate) fn cargo() -> Command {
    let mut cargo = Command::new(env::var_os("CARGO").unwrap_or_else(|| "cargo".into()));
    forget_our_package(&mut cargo);
    cargo
}

/// Removes what `cargo run` told us about our own package: build scripts would see it change and run again.
pub(crate) fn forget_our_package(command: &mut Command) {
    for (name, _) in env::vars_os() {
        let told = name
            .to_str()
            .is_some_and(|name| name.starts_with("CARGO_PKG_") || name.starts_with("CARGO_MANIFEST_"));
        if told {
            command.env_remove(name);
        }
    }
}

/// Runs a command to its end, its output in plain sight.
///
/// # Errors
///
/// If it cannot be started or does not succeed.
pub(crate) fn run(command: &mut Command) -> Result {
    run_to(&[0], command)
}

/// Runs a command to its end, which is good with any of these exit codes, its output in plain sight.
///
/// # Errors
///
/// If it cannot be started or ends otherwise.
pub(crate) fn run_to(good: &[i32], command: &mut Command) -> Result {
    let status = command
        .status()
        .map_err(|error| format!("cannot run `{}`: {error}", shown(command)))?;
    if !status.code().is_some_and(|code| good.contains(&code)) {
        return Err(format!("`{}` failed: {status}", shown(command)).into());
    }
    Ok(())
}

/// Runs a command to its end and returns what it printed.
///
/// # Errors
///
/// If it cannot be started or does not succeed; with what it said.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command
        .stdin(Stdio::null())
        .output()
        .map_err(|error| format!("cannot run `{}`: {error}", shown(command)))?;
    if !output.status.success() {
        let said = String::from_utf8_lossy(&output.stderr);
        return Err(format!("`{}` failed: {}", shown(command), said.trim()).into());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Runs a command in our place: signals, the terminal and the exit code are its own.
///
/// # Errors
///
/// If it cannot be started.
#[cfg(unix)]
pub(crate) fn replace_ourselves(command: &mut Command) -> Result {
    use std::os::unix::process::CommandExt;
    let error = command.exec();
    Err(format!("cannot run `{}`: {error}", shown(command)).into())
}

/// Runs a command to its end and exits as it did.
///
/// # Errors
///
/// If it cannot be started.
#[cfg(not(unix))]
pub(crate) fn replace_ourselves(command: &mut Command) -> Result {
    let status = command
        .status()
        .map_err(|error| format!("cannot run `{}`: {error}", shown(command)))?;
    std::process::exit(status.code().unwrap_or(1))
}

/// The command as one would type it.
pub(crate) fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let words = program.file_name().into_iter().chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_the_good_exit_codes_are_a_good_end() {
        let end = |good: &[i32], script| run_to(good, Command::new("sh").args(["-c", script])).is_ok();
        assert!(end(&[0, 2], "exit 0") && end(&[0, 2], "exit 2"));
        assert!(!end(&[0, 2], "exit 1") && !end(&[0], "exit 2"));
        assert!(!end(&[0, 2], "kill -KILL $$"), "it has no exit code");
    }
}
