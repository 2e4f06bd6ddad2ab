//! `cargo xtask campaign`: the fault campaign, with the image for the STM32F405 on the virtual board.

use std::ffi::OsString;
use std::path::Path;

use crate::Result;
use crate::image;
use crate::process;
use crate::workspace;

/// The program.
const RUN: &str = "run --package armwire-host-tests --features image --bin campaign --";

/// What `--help` prints.
pub(crate) const USAGE: &str = "\
usage: cargo xtask campaign [--runs N] [--from NUMBER] [--seed S] [--only NUMBER] [--write]

--runs N        so many runs, 300 without this option
--from NUMBER   of these those from this number on, all without this option
--seed S        of what is drawn, 1 without this option
--only NUMBER   just the run of this number
--write         put the table into docs/faults.md";

/// Builds the image, or takes that which `ARMWIRE_IMAGE` names, and runs the campaign with these options of its own.
///
/// # Errors
///
/// If an option is none of its own, which is found before anything is built, or if a run fails.
pub(crate) fn run(options: &[OsString]) -> Result {
    check(options)?;
    run_on(&image::for_virtual_board()?, options)
}

/// Runs the campaign on this image.
///
/// # Errors
///
/// If a run fails.
pub(crate) fn run_on(image: &Path, options: &[OsString]) -> Result {
    let mut cargo = process::cargo();
    cargo.args(RUN.split(' ')).args(options).env("ARMWIRE_IMAGE", image);
    process::run(cargo.current_dir(workspace::root()))
}

/// That these are options that the campaign takes.
fn check(options: &[OsString]) -> Result {
    let (mut write, mut is_part) = (false, false);
    let mut options = options.iter().map(|option| option.to_string_lossy());
    while let Some(option) = options.next() {
        let most = match &*option {
            "--runs" | "--from" | "--only" => u64::from(u32::MAX),
            "--seed" => u64::MAX,
            "--write" => {
                write = true;
                continue;
            }
            _ => return Err(format!("unknown option `{option}`\n\n{USAGE}").into()),
        };
        let number = options.next().and_then(|number| number.parse::<u64>().ok());
        let number = number.filter(|&number| number <= most);
        let number = number.ok_or_else(|| format!("`{option}` needs a number, up to {most}\n\n{USAGE}"))?;
        is_part |= option == "--only" || option == "--from" && number > 0;
    }
    match write && is_part {
        true => Err("`--write` needs all runs".into()),
        false => Ok(()),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const CAMPAIGN: &str = include_str!("../../host-tests/src/bin/campaign.rs");

    fn checked(options: &str) -> Result<(), String> {
        let options: Vec<OsString> = options.split_whitespace().map(OsString::from).collect();
        check(&options).map_err(|error| error.to_string())
    }

    #[test]
    fn the_options_are_those_of_the_campaign() {
        let options = |text: &'static str| text.lines().filter(|line| line.starts_with("--"));
        assert_eq!(options(USAGE).count(), 5);
        // The last line ends the string.
        let theirs = options(CAMPAIGN).map(|line| line.trim_end_matches("\";"));
        assert!(theirs.eq(options(USAGE)), "the two usages differ");
        for line in options(USAGE) {
            let option = line.split_whitespace().next().unwrap();
            let number = if option == "--write" { "" } else { "7" };
            assert_eq!(checked(&format!("{option} {number}")), Ok(()));
        }
    }

    #[test]
    fn what_is_no_option_is_refused() {
        assert_eq!(checked("--write --from 0 --runs 9 --seed 18446744073709551615"), Ok(()));
        for (options, error) in [
            ("--rounds 3", "unknown option `--rounds`"),
            ("--runs", "`--runs` needs a number"),
            ("--seed x --write", "`--seed` needs a number"),
            ("--runs 4294967296", "`--runs` needs a number, up to 4294967295"),
            ("--write 3", "unknown option `3`"),
            ("--from 1 --write", "`--write` needs all runs"),
            ("--write --only 0", "`--write` needs all runs"),
        ] {
            assert!(checked(options).unwrap_err().starts_with(error), "{options}");
        }
    }
}
