//! Other programs.

use std::path::Path;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, bail};

/// Prints a command and runs it to its end. Its output is visible.
///
/// # Errors
///
/// If it cannot be started or does not succeed.
pub(crate) fn run(command: &mut Command) -> Result<()> {
    run_to(&[0], command)
}

/// The same, where any of these exit codes means success.
///
/// # Errors
///
/// If it cannot be started or ends otherwise.
pub(crate) fn run_to(good: &[i32], command: &mut Command) -> Result<()> {
    println!("running `{}`", shown(command));
    let status = command.status().with_context(|| cannot_run(command))?;
    if !status.code().is_some_and(|code| good.contains(&code)) {
        bail!("`{}` failed: {status}", shown(command));
    }
    Ok(())
}

/// Runs a command to its end and returns its output.
///
/// # Errors
///
/// If it cannot be started or does not succeed. The error has its whole output.
pub(crate) fn output(command: &mut Command) -> Result<String> {
    let output = command.stdin(Stdio::null()).output();
    let output = output.with_context(|| cannot_run(command))?;
    if !output.status.success() {
        let text = [output.stdout, output.stderr].concat();
        bail!("`{}` failed: {}", shown(command), String::from_utf8_lossy(&text).trim());
    }
    Ok(String::from_utf8(output.stdout)?)
}

/// Replaces this process by a command, which gets the signals and the terminal.
///
/// # Errors
///
/// If it cannot be started.
#[cfg(unix)]
pub(crate) fn replace_ourselves(command: &mut Command) -> Result<()> {
    use std::os::unix::process::CommandExt;
    Err(command.exec()).with_context(|| cannot_run(command))
}

/// Runs a command to its end and exits with its exit code.
///
/// # Errors
///
/// If it cannot be started.
#[cfg(not(unix))]
pub(crate) fn replace_ourselves(command: &mut Command) -> Result<()> {
    let status = command.status().with_context(|| cannot_run(command))?;
    std::process::exit(status.code().unwrap_or(1))
}

/// The command as typed in a shell.
pub(crate) fn shown(command: &Command) -> String {
    let program = Path::new(command.get_program());
    let words = program.file_name().into_iter().chain(command.get_args());
    words.map(|word| word.to_string_lossy()).collect::<Vec<_>>().join(" ")
}

pub(crate) fn cannot_run(command: &Command) -> String {
    format!("cannot run `{}`", shown(command))
}

#[cfg(all(test, unix))]
mod tests {
    use super::*;

    #[test]
    fn only_good_exit_codes_succeed() {
        let end = |good: &[i32], script| run_to(good, Command::new("sh").args(["-c", script])).is_ok();
        assert!(end(&[0, 2], "exit 0") && end(&[0, 2], "exit 2"));
        assert!(!end(&[0, 2], "exit 1") && !end(&[0], "exit 2"));
        assert!(!end(&[0, 2], "kill -KILL $$"), "a signal is no exit code");
    }
}
