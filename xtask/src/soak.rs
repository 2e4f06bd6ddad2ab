//! `cargo xtask soak`: what takes hours. It finds what is rare; what a change broke, `cargo ci` finds.

use std::ffi::OsString;
use std::process::Command;

use crate::Result;
use crate::board::Board;
use crate::image::Options;
use crate::steps::Steps;
use crate::workspace;
use crate::{campaign, features, fuzz, image, mutants, process};

/// One part: its name, and what it does.
type Part = (&'static str, fn() -> Result);

/// In the order in which they run.
const PARTS: [Part; 7] = [
    ("streams", streams),
    ("adapter", adapter),
    ("features", features::every_set),
    ("fuzz", fuzz),
    ("campaign", campaign),
    ("endurance", endurance),
    ("mutants", mutants),
];

/// What `--help` prints.
pub(crate) const USAGE: &str = "\
usage: cargo xtask soak [PART...]

All parts run one after another, or only those that are named:

streams     decoders and an independent reference on 2.1 million streams
adapter     a million random runs of the adapter, its hosts and an arm
features    clippy and tests with every set of features
fuzz        each fuzz target for 30 minutes, with inputs that no other run tries
campaign    10 000 runs of the fault campaign
endurance   both firmware images: ten million frames, and 24 hours of virtual time
mutants     changes to the code, each of which a test must notice";

/// Runs these parts, or all.
///
/// # Errors
///
/// If one of the names is not a part's, or the first part that fails.
pub(crate) fn run(names: &[OsString]) -> Result {
    let chosen = choose(names)?;
    let mut steps = Steps::default();
    for (name, part) in chosen {
        steps.step(name, part)?;
    }
    steps.finish();
    Ok(())
}

/// The parts with these names, or all if there are none.
fn choose(names: &[OsString]) -> Result<Vec<Part>> {
    if names.is_empty() {
        return Ok(PARTS.to_vec());
    }
    let find = |name: &OsString| {
        let part = PARTS.into_iter().find(|(known, _)| name == known);
        part.ok_or_else(|| format!("unknown part `{}`\n\n{USAGE}", name.display()).into())
    };
    names.iter().map(find).collect()
}

/// 300 000 streams of each of the seven lines.
fn streams() -> Result {
    process::run(host_test("reference").env("ARMWIRE_STREAMS", "300000"))
}

fn adapter() -> Result {
    process::run(host_test("adapter_runs").env("ARMWIRE_RUNS", "1000000"))
}

/// A test of the host's, with optimisation.
fn host_test(name: &str) -> Command {
    let mut test = process::cargo();
    test.args(["test", "--release", "--package", "armwire-host-tests", "--test", name]);
    test.current_dir(workspace::root());
    test
}

fn fuzz() -> Result {
    fuzz::run(&["--seconds".into(), "1800".into()])
}

fn campaign() -> Result {
    campaign::run(&["--runs".into(), "10000".into()])
}

fn endurance() -> Result {
    for board in Board::ALL {
        let image = image::build(&Options::of(board))?.path;
        let run = |test: &str, options: &[&str]| {
            let mut cargo = process::cargo();
            cargo.args(["test", "--package", "armwire-host-tests", "--features", "image"]);
            cargo.args(["--test", test, "--", "--nocapture"]).args(options);
            cargo.env("ARMWIRE_IMAGE", &image).env("ARMWIRE_FRAMES", "10000000");
            process::run(cargo.current_dir(workspace::root()))
        };
        run("image_busy", &[])?;
        run("image_endurance", &["--ignored"])?;
    }
    Ok(())
}

fn mutants() -> Result {
    mutants::run(&[])
}

#[cfg(test)]
mod tests {
    use super::*;

    fn chosen(names: &[&str]) -> Result<Vec<&'static str>, String> {
        let names: Vec<OsString> = names.iter().map(OsString::from).collect();
        let parts = choose(&names).map_err(|error| error.to_string())?;
        Ok(parts.into_iter().map(|(name, _)| name).collect())
    }

    #[test]
    fn every_part_is_in_the_help() {
        let helped = USAGE.lines().skip(4).map(|line| line.split(' ').next().unwrap());
        assert!(helped.eq(PARTS.map(|(name, _)| name)));
    }

    #[test]
    fn parts_are_chosen_by_name() {
        assert_eq!(chosen(&[]).unwrap().len(), PARTS.len());
        assert_eq!(chosen(&["fuzz", "streams"]), Ok(vec!["fuzz", "streams"]));
        assert!(
            chosen(&["fuzz", "fuss"])
                .unwrap_err()
                .starts_with("unknown part `fuss`")
        );
    }
}
