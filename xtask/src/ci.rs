//! `cargo ci`: every check there is. Stops at the first that fails.

use std::process::Command;
use std::time::{Duration, Instant};

use crate::Result;
use crate::image::{self, Options};
use crate::process::{cargo, run as run_command, shown};
use crate::toolchain::Toolchain;
use crate::workspace;
use crate::{licences, no_panic, vendor};

/// Where the crates without `std` must build.
const NO_STD_TARGETS: [&str; 3] = [
    "thumbv6m-none-eabi",
    "thumbv7em-none-eabihf",
    "riscv32imc-unknown-none-elf",
];
/// The features of `armwire`, to be built and tested one by one.
const FEATURES: [&str; 5] = ["", "async", "defmt", "crc-table", "crc-table16"];
/// Everything but the firmware.
const HOST: [&str; 4] = ["--ignore-rust-version", "--workspace", "--exclude", "armwire-firmware"];

/// Runs every check.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run() -> Result {
    let mut ci = Ci::default();
    ci.step("formatting", || check(cargo().args(["fmt", "--all", "--check"])))?;
    ci.step("formatting of the link test", || {
        check(cargo().args(["fmt", "--check", "--manifest-path", "host-tests/no-panic/Cargo.toml"]))
    })?;
    ci.step("licences of dependencies", licences::run)?;
    ci.step("clippy", || {
        check(
            cargo()
                .arg("clippy")
                .args(HOST)
                .args(["--all-targets", "--all-features", "--", "-D", "warnings"]),
        )
    })?;
    ci.step("documentation", || {
        let mut doc = cargo();
        doc.arg("doc").args(HOST).args(["--no-deps", "--all-features"]);
        check(doc.env("RUSTDOCFLAGS", "-D warnings"))
    })?;
    ci.step("tests", || check(cargo().arg("test")))?;
    ci.step("features of armwire", features)?;
    ci.step("crates without std", no_std)?;
    ci.step("clippy for the microcontroller", clippy_thumb)?;
    ci.step("no path to a panic", no_panic::run)?;
    let image = ci.step("firmware image", || image::build(&Options::default()))?;
    println!("{image}");
    ci.step("firmware image with every option", || {
        image::build(&Options {
            crystal_12mhz: true,
            defmt: true,
        })
        .map(drop)
    })?;
    ci.step("virtual board", || {
        check(cargo().args(["test", "--ignore-rust-version", "--package", "armwire-virtual-board"]))
    })?;
    ci.step("firmware image on the virtual board", || {
        let mut test = cargo();
        test.args([
            "test",
            "--ignore-rust-version",
            "--package",
            "armwire-host-tests",
            "--features",
            "image",
        ]);
        check(test.env("ARMWIRE_IMAGE", &image.path))
    })?;
    ci.step("vendor's SDK", vendor::run)?;
    println!("\nall {} steps passed in {:.0?}", ci.steps, ci.time);
    Ok(())
}

/// What was done so far.
#[derive(Default)]
struct Ci {
    steps: u32,
    time: Duration,
}

impl Ci {
    /// Does one step, and says which and how long it took.
    fn step<T>(&mut self, name: &str, step: impl FnOnce() -> Result<T>) -> Result<T> {
        println!("\n== {name}");
        let start = Instant::now();
        let result = step();
        let time = start.elapsed();
        self.steps += 1;
        self.time += time;
        match &result {
            Ok(_) => println!("== {name}: passed in {time:.1?}"),
            Err(_) => println!("== {name}: FAILED after {time:.1?}"),
        }
        result.map_err(|error| format!("step \"{name}\": {error}").into())
    }
}

/// Each feature of `armwire` alone, and all of them: compiled in every way, and tested.
fn features() -> Result {
    let all = FEATURES[1..].join(",");
    for features in FEATURES.into_iter().chain([&*all]) {
        let select = [
            "--package",
            "armwire",
            "--no-default-features",
            &format!("--features={features}"),
        ];
        check(cargo().args(["check", "--all-targets"]).args(select))?;
        // With defmt, tests need a logger to link.
        if !features.contains("defmt") {
            check(cargo().args(["test", "--quiet", "--lib", "--tests"]).args(select))?;
        }
    }
    check(cargo().args([
        "check",
        "--all-targets",
        "--package",
        "armwire-bridge",
        "--features",
        "defmt",
    ]))
}

/// The crates that must build without `std` do, without features and with all.
fn no_std() -> Result {
    let toolchain = Toolchain::find(&NO_STD_TARGETS)?;
    for target in NO_STD_TARGETS {
        let build = || -> Result<Command> {
            let mut build = toolchain.cargo("build", target)?;
            build.args(["--package", "armwire", "--package", "armwire-bridge"]);
            Ok(build)
        };
        check(&mut build()?)?;
        check(build()?.arg("--all-features"))?;
    }
    Ok(())
}

/// Clippy as the firmware's compiler sees the code.
fn clippy_thumb() -> Result {
    let toolchain = Toolchain::find(&[image::TARGET])?;
    if toolchain == Toolchain::Debian {
        println!(
            "skipped: Debian's compiler comes without clippy; `rustup target add {}` helps",
            image::TARGET
        );
        return Ok(());
    }
    for package in ["armwire", "armwire-bridge", "armwire-firmware"] {
        let mut clippy = toolchain.cargo("clippy", image::TARGET)?;
        check(clippy.args(["--package", package, "--all-features", "--", "-D", "warnings"]))?;
    }
    let mut clippy = toolchain.cargo("clippy", image::TARGET)?;
    check(clippy.args([
        "--manifest-path",
        "host-tests/no-panic/Cargo.toml",
        "--",
        "-D",
        "warnings",
    ]))
}

/// Runs a check that is one command, and says which.
fn check(command: &mut Command) -> Result {
    println!("running `{}`", shown(command));
    run_command(command.current_dir(workspace::root()))
}
