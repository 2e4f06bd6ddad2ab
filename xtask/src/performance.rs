//! `cargo xtask performance`: builds the images and programs, and runs the program that measures them.

use std::ffi::OsString;
use std::fs;

use crate::Result;
use crate::board::Board;
use crate::image::{self, Options, TARGET};
use crate::process;
use crate::toolchain::Toolchain;
use crate::workspace;

/// What `--help` prints.
pub(crate) const USAGE: &str = "\
usage: cargo xtask performance [--write]

Measures latency in 2000 answers of the arm. With --write: in 20000, and beside other crates, and writes docs/performance.md
and its plots.";

/// The program.
const RUN: &str = "run --package armwire-host-tests --features image --bin performance --";

/// The programs that are counted: with all protocols for speed; without one and with each for size. Profile and features of
/// `host-tests/benches`.
const PROGRAMS: [(&str, &str, &str); 5] = [
    ("all", "release", "ling,xarm,alpha1"),
    ("none", "size", ""),
    ("Ling", "size", "ling"),
    ("xArm", "size", "xarm"),
    ("Alpha1", "size", "alpha1"),
];

/// Measures, prints the tables, and fails if a limit is exceeded.
///
/// # Errors
///
/// If an option is unknown, something does not build, the program fails, or a limit is exceeded.
pub(crate) fn run(args: &[OsString]) -> Result {
    let write = match args {
        [] => false,
        [option] if option == "--write" => true,
        _ => return Err(USAGE.into()),
    };
    let (root, target) = (workspace::root(), workspace::target_dir()?);
    for board in Board::ALL {
        image::build(&Options::of(board))?;
    }
    programs()?;
    let mut measure = process::cargo();
    measure.args(RUN.split(' ')).arg(&target);
    measure.arg(if write { "20000" } else { "2000" });
    if write {
        let mut bench = process::cargo();
        bench.args(["bench", "--quiet"]).env("CARGO_TARGET_DIR", &target);
        process::run(bench.current_dir(root.join("host-tests/benches")))?;
        measure.arg(root.join("docs"));
    }
    process::run(measure.current_dir(root))
}

/// Builds the programs, into the folder `performance` of the target directory.
fn programs() -> Result {
    let toolchain = Toolchain::find(&[TARGET])?;
    let folder = workspace::target_dir()?.join("performance");
    fs::create_dir_all(&folder)?;
    for (name, profile, features) in PROGRAMS {
        let mut cargo = toolchain.cargo("rustc", TARGET)?;
        cargo
            .args([
                "--quiet",
                "--bin",
                "thumb",
                "--profile",
                profile,
                "--no-default-features",
            ])
            .arg(format!("--features=thumb,{features}"))
            .args(["--", "-Clink-arg=-Tlink.x", "-Clink-arg=--nmagic"]);
        process::run(cargo.current_dir(workspace::root().join("host-tests/benches")))?;
        let built = toolchain.target_dir()?.join(TARGET).join(profile).join("thumb");
        fs::copy(built, folder.join(name).with_extension("elf"))?;
    }
    Ok(())
}
