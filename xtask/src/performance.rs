//! `cargo xtask performance`: builds the images and programs, and measures them.

use std::fs;

use anyhow::Result;
use clap::Args;

use crate::board::{Board, TARGET};
use crate::cargo::{cargo, target_dir};
use crate::image;
use crate::process;
use crate::toolchain::cargo_for;
use crate::workspace::root;

#[derive(Args, Default)]
pub(crate) struct Options {
    /// Measure 20000 answers instead of 2000, and other crates, and write docs/performance.md
    #[arg(long)]
    write: bool,
}

/// The measured programs, with profile and features of `host-tests/benches`: for speed one with all protocols, for size one
/// without any and one with each.
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
/// If something does not build, the program fails, or a limit is exceeded.
pub(crate) fn run(options: &Options) -> Result<()> {
    for board in Board::VIRTUAL {
        image::build(image::Options::of(board))?;
    }
    programs()?;
    let target = target_dir()?;
    let mut measure = cargo("run --package armwire-host-tests --features image --bin performance --");
    measure.arg(&target).arg(if options.write { "20000" } else { "2000" });
    if options.write {
        let mut bench = cargo("bench --quiet");
        bench.env("CARGO_TARGET_DIR", &target);
        process::run(bench.current_dir(root().join("host-tests/benches")))?;
        measure.arg(root().join("docs"));
    }
    process::run(&mut measure)
}

/// Builds the programs, into the folder `performance` of the target directory.
fn programs() -> Result<()> {
    let target = target_dir()?;
    let folder = target.join("performance");
    fs::create_dir_all(&folder)?;
    for (name, profile, features) in PROGRAMS {
        let mut build = cargo_for(TARGET, "rustc --quiet --bin thumb --no-default-features")?;
        build.args(["--profile", profile, &format!("--features=thumb,{features}")]);
        build.args(["--", "-Clink-arg=-Tlink.x", "-Clink-arg=--nmagic"]);
        process::run(build.current_dir(root().join("host-tests/benches")))?;
        let built = target.join(TARGET).join(profile).join("thumb");
        fs::copy(built, folder.join(name).with_extension("elf"))?;
    }
    Ok(())
}
