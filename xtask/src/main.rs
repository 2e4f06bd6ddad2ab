//! The project's commands, behind the aliases in `.cargo/config.toml`.

mod board;
mod campaign;
mod cargo_tool;
mod ci;
mod coverage;
mod demo;
mod deny;
mod dfu;
mod features;
mod flash;
mod fuzz;
mod image;
mod integrity;
mod mutants;
mod no_panic;
mod performance;
mod process;
mod program;
mod readme;
mod semver;
mod soak;
mod steps;
mod toolchain;
mod unsafe_code;
mod vendor;
mod workspace;

use std::env;
use std::error::Error;
use std::ffi::OsString;
use std::process::ExitCode;

/// What a step gives: an error is one readable message.
type Result<T = (), E = Box<dyn Error>> = std::result::Result<T, E>;

const USAGE: &str = "\
cargo demo [-- OPTIONS]   run the firmware image on the virtual board and drive the virtual arm through it;
                          OPTIONS are `--board NAME` and the demo's own, see `cargo demo -- --help`
cargo fw [IMAGE]          build the firmware image, as .elf, .bin and .dfu
cargo flash [IMAGE]       build the firmware image and flash it with probe-rs
cargo ci                  run the checks that find the mistakes of a change

cargo xtask vendor        drive virtual arms with CAN software and the arm vendors' SDKs, all in Python; with
                          `differential`, only compare the parser of Ling's SDK and ours on damaged streams, with
                          `can-fd`, only exchange CAN FD frames between programs on a virtual bus
cargo xtask campaign      let things go wrong around the firmware image: --runs N, --from NUMBER, --seed S,
                          --only NUMBER, --write
cargo xtask performance   measure latency, load, rates, stack and sizes of both images on the virtual board, and instructions of
                          the protocols, and check the limits; --write measures longer, beside other crates, too, and
                          writes docs/performance.md
cargo xtask no-panic      link the protocol and bridge crates where a path to a panic is a link error
cargo xtask integrity     compare docs/integrity.md with what becomes of damaged frames; --write writes it
cargo xtask unsafe-code   check that the crates in which unsafe code is forbidden say so
cargo xtask deny          check the licences, versions, sources and known vulnerabilities of all dependencies
cargo xtask semver        compare what is public with the last release
cargo xtask soak [PART]   run what takes hours: streams, adapter, features, fuzz, campaign, endurance, mutants
cargo xtask mutants       change the code and see whether tests notice: for hours; options are those of cargo-mutants
cargo xtask fuzz          run the fuzz targets, each for 60 s or `--seconds N`; `--minimise` makes their corpus anew
cargo xtask coverage      print how much of the protocol and bridge crates the fuzz corpus reaches, and check the limit;
                          `--list` tells the lines that it does not reach

IMAGE: --board NAME       stm32f405, which it is without this option, or stm32g431
       --defmt            log over RTT

`--help` behind a command tells what it does and which options it has.";

fn main() -> ExitCode {
    let args: Vec<OsString> = env::args_os().skip(1).collect();
    match dispatch(&args) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn dispatch(args: &[OsString]) -> Result {
    let Some((command, rest)) = args.split_first() else {
        return Err(format!("no command\n\n{USAGE}").into());
    };
    // What stands behind `--` is for another program.
    let mut ours = rest.iter().take_while(|&arg| arg != "--");
    if ours.any(|arg| arg == "--help" || arg == "-h")
        && let Some(usage) = command.to_str().and_then(usage_of)
    {
        println!("{usage}");
        return Ok(());
    }
    match command.to_str() {
        Some("demo") => demo::run(rest),
        Some("fw") => image::build(&image::Options::parse(rest)?).map(|image| println!("{image}")),
        Some("flash") => flash::run(&image::Options::parse(rest)?),
        Some("ci") => no_options(rest).and_then(|()| ci::run()),
        Some("vendor") => vendor::run(rest),
        Some("campaign") => campaign::run(rest),
        Some("performance") => performance::run(rest),
        Some("no-panic") => no_options(rest).and_then(|()| no_panic::run()),
        Some("integrity") => integrity::run(rest),
        Some("unsafe-code") => no_options(rest).and_then(|()| unsafe_code::run()),
        Some("deny") => no_options(rest).and_then(|()| deny::run()),
        Some("semver") => no_options(rest).and_then(|()| semver::run()),
        Some("soak") => soak::run(rest),
        Some("mutants") => mutants::run(rest),
        Some("fuzz") => fuzz::run(rest),
        Some("coverage") => match rest {
            [list] if list == "--list" => coverage::run(true),
            _ => no_options(rest).and_then(|()| coverage::run(false)),
        },
        Some("help" | "--help" | "-h") => {
            println!("{USAGE}");
            Ok(())
        }
        _ => Err(format!("unknown command `{}`\n\n{USAGE}", command.display()).into()),
    }
}

fn no_options(args: &[OsString]) -> Result {
    match args.first() {
        Some(arg) => Err(format!("unknown option `{}`\n\n{USAGE}", arg.display()).into()),
        None => Ok(()),
    }
}

/// What there is to say of one command, if there is such a one.
fn usage_of(command: &str) -> Option<String> {
    match command {
        "campaign" => return Some(campaign::USAGE.to_owned()),
        "fuzz" => return Some(fuzz::USAGE.to_owned()),
        "performance" => return Some(performance::USAGE.to_owned()),
        "soak" => return Some(soak::USAGE.to_owned()),
        _ => {}
    }
    let mut lines = USAGE.lines().skip_while(|line| name_in(line) != Some(command));
    let mut usage = lines.next()?.to_owned();
    for line in lines.take_while(|line| line.starts_with(' ')) {
        usage += &format!("\n{line}");
    }
    if usage.contains("[IMAGE]") {
        let image = USAGE.split("\n\n").find(|part| part.starts_with("IMAGE:"));
        usage += &format!("\n\n{}", image.unwrap_or_default());
    }
    Some(usage)
}

/// The command with which a line of [`USAGE`] begins, if it does.
fn name_in(line: &str) -> Option<&str> {
    let rest = line.strip_prefix("cargo xtask ").or(line.strip_prefix("cargo "))?;
    rest.split_whitespace().next()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_command_says_what_it_does_and_does_nothing_else() {
        let mut commands = 0;
        for command in USAGE.lines().filter_map(name_in) {
            let usage = usage_of(command).unwrap();
            assert!(usage.contains(command), "{usage}");
            for help in ["--help", "-h"] {
                dispatch(&[command.into(), help.into()]).unwrap();
            }
            commands += 1;
        }
        assert!(commands >= 15, "{commands} commands: where are the others?");
        let usage = usage_of("flash").unwrap();
        assert!(
            usage.starts_with("cargo flash [IMAGE]") && usage.ends_with("log over RTT"),
            "{usage}"
        );
        assert!(
            usage_of("coverage")
                .unwrap()
                .ends_with("the lines that it does not reach")
        );
        let error = dispatch(&["flush".into(), "--help".into()]).unwrap_err();
        assert!(error.to_string().starts_with("unknown command `flush`"), "{error}");
    }
}
