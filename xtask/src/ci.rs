//! `cargo ci`: the checks of a change. `cargo xtask soak` has those that take hours.

use std::process::Command;
use std::{env, fs};

use anyhow::Result;

use crate::board::Board;
use crate::cargo::cargo;
use crate::image::{self, Image, Options};
use crate::process;
use crate::steps::Steps;
use crate::vendor::so101;
use crate::workspace::{ALONE, root};
use crate::{
    apt, c_library, campaign, circles, fuzz, packages, parallel, performance, python, readme, ros2, semver, workflow,
};

/// Everything but the firmware.
const HOST: &str = "--workspace --exclude armwire-firmware";
/// Commands that mostly build, in directories of their own. One at a time they would leave a core idle for half of the
/// time: only one core links an image. The longest is first: begun late, it would run alone at the end.
const BUILDS: [&str; 11] = [
    "platforms",
    "examples",
    "coverage",
    "targets",
    "deny",
    "python sources",
    "features",
    "fw --board stm32g431",
    "no-panic",
    "fw --defmt --board stm32g431",
    // Last: it has the profile of the other image, and would wait for it.
    "fw --board pico",
];
/// Commands that mostly wait for programs in real time. The first takes longer than the others together.
const PROGRAMS: [&str; 5] = [
    "python tests",
    "vendor can",
    "recordings",
    "vendor sdk",
    "vendor differential",
];
/// The emulator takes one core while the other links images.
const EMULATOR: [&str; 2] = ["pico --seconds 30", "boards"];
/// Runs of the fault campaign with each image.
const CAMPAIGN_RUNS: u32 = 300;
/// Random runs of the adapter.
const ADAPTER_RUNS: &str = "5000";

/// Runs all checks.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run() -> Result<()> {
    let mut ci = Steps::default();
    // The fuzz targets need a C++ compiler, too.
    ci.step("programs in C", || apt::require(&c_library::TOOLS))?;
    ci.step("dependencies as locked", || {
        process::run(&mut cargo("fetch --locked"))?;
        each(&ALONE, |alone| {
            process::run(&mut cargo(&format!("fetch --locked {alone}")))
        })
    })?;
    // On a fresh clone this is the waiting time of a new user, without the download.
    ci.step("demo", || process::run(&mut cargo("demo")))?;
    ci.step("formatting", || {
        process::run(&mut cargo("fmt --all --check"))?;
        each(&ALONE, |alone| {
            process::run(&mut cargo(&format!("fmt --check {alone}")))
        })
    })?;
    ci.step("circles of imports", circles::check)?;
    ci.step("drawings", drawings)?;
    ci.step("clippy", || {
        process::run(&mut cargo(&format!(
            "clippy {HOST} --all-targets --all-features -- -D warnings"
        )))
    })?;
    ci.step("tests", || process::run(&mut cargo("test")))?;
    ci.step(
        "random runs of the adapter, documentation, type check of the firmware on a computer",
        || {
            let doc = |select: &str| {
                let mut doc = cargo(&format!("doc {select} --no-deps"));
                doc.env("RUSTDOCFLAGS", "-D warnings");
                doc
            };
            parallel::run_all(vec![
                adapter_runs(),
                doc(&format!("{HOST} --all-features")),
                // Links to disabled protocols would be broken.
                doc("--package armwire --no-default-features --features ling"),
                // An editor reads it so. Clippy, the tests and later steps compile every other crate.
                cargo("check --package armwire-firmware"),
            ])
        },
    )?;
    ci.step("README's example with its dependencies", readme::check)?;
    ci.step("crates from their packages", || {
        packages::check(packages::Tests::Compile)
    })?;
    ci.step("public API", semver::run)?;
    ci.step("page in a browser, C library", || {
        parallel::run_all(xtasks(&["web", "c"])?)
    })?;
    ci.step(
        "other systems and targets, examples, coverage, licences, images, link tests",
        || {
            let mut commands = xtasks(&BUILDS)?;
            let mut clippy = cargo("clippy --all-targets -- -D warnings");
            clippy.current_dir(root().join("host-tests/benches"));
            commands.extend([clippy, fuzz::clippy()?]);
            parallel::run_all(commands)
        },
    )?;
    // They are the targets that measured the coverage. With a fixed seed they begin with the same inputs each time.
    ci.step("fuzzing", || fuzz::run(&fuzz::Options::new(3, 1)))?;
    let g431 = ci.step("firmware image for the STM32G431", || image::release(Board::STM32G431))?;
    let f405 = ci.step("firmware image for the STM32F405", || image::release(Board::STM32F405))?;
    // The images are built, and no board by name has taken their place yet.
    ci.step("ordinary commands of the firmware", workflow::check)?;
    ci.step("virtual board, and both firmware images on it", || {
        let board = cargo("test --package armwire-virtual-board");
        parallel::run_all(vec![image_tests(&f405), image_tests(&g431), board])
    })?;
    ci.step(
        "firmware image of the Pico on an emulated chip, images of the boards by name, log of an image",
        || {
            // The STM32G431 has less room for it.
            let image = image::build(Options::all(Board::STM32G431))?;
            let mut log = cargo("test --package armwire-host-tests --features image --test image_log");
            log.env("ARMWIRE_LOG_IMAGE", &image.path);
            let mut commands = xtasks(&EMULATOR)?;
            commands.push(log);
            parallel::run_all(commands)
        },
    )?;
    ci.step("performance of both images, and instructions of the protocols", || {
        performance::run(&Default::default())
    })?;
    ci.step("faults around both firmware images", || {
        [&f405, &g431]
            .into_iter()
            .try_for_each(|image| campaign::run_on(&image.path, &campaign::Options::runs(CAMPAIGN_RUNS)))
    })?;
    ci.step("package for Python, CAN software, recordings, vendors' SDKs", || {
        // Otherwise the next step would build the node with one core idle.
        let mut commands = vec![cargo("test --package armwire-ros2 --no-run")];
        commands.extend(xtasks(&PROGRAMS)?);
        parallel::run_all(commands)
    })?;
    // Alone: the programs wait 34 ms for an answer.
    ci.step("programs on a virtual SO-101", || match python::newer_python() {
        Ok(_) => so101::compare(false),
        // Debian 12 has none.
        Err(missing) => {
            println!("skipped: {missing}");
            Ok(())
        }
    })?;
    // It measures how late readings are.
    ci.step("ROS 2 node and a DDS of another make", ros2::check)?;
    ci.finish();
    Ok(())
}

/// Checks that the drawings in `docs` are well-formed.
fn drawings() -> Result<()> {
    let parse = "import sys, xml.etree.ElementTree as tree\nfor file in sys.argv[1:]: tree.parse(file)";
    let mut drawings = Vec::new();
    for folder in ["docs", "docs/performance"] {
        for file in fs::read_dir(root().join(folder))? {
            drawings.push(file?.path());
        }
    }
    drawings.retain(|file| file.extension().is_some_and(|extension| extension == "svg"));
    println!("{} drawings", drawings.len());
    process::run(Command::new("python3").args(["-c", parse]).args(drawings))
}

/// Random runs of the adapter. They show how many had each circumstance.
fn adapter_runs() -> Command {
    let mut test = cargo("test --package armwire-host-tests --test adapter_runs");
    test.args(["--", "--show-output"]).env("ARMWIRE_RUNS", ADAPTER_RUNS);
    test
}

/// The tests of this image on the virtual board, with their measurements.
fn image_tests(image: &Image) -> Command {
    let mut test = image.tests();
    test.args(["--lib", "--bins", "--test", "image_endurance", "--", "--show-output"]);
    test
}

/// Commands of this program.
fn xtasks(commands: &[&str]) -> Result<Vec<Command>> {
    let program = env::current_exe()?;
    let xtask = |words: &&str| {
        let mut xtask = Command::new(&program);
        xtask.args(words.split(' '));
        xtask
    };
    Ok(commands.iter().map(xtask).collect())
}

/// Does the same for each of these packages.
fn each(packages: &[&str], act: impl Fn(&str) -> Result<()>) -> Result<()> {
    packages.iter().try_for_each(|package| act(package))
}
