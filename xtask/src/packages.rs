//! `cargo xtask packages`: the crates as they would be published, tested and used from their `.crate` files.

use std::fs;
use std::path::Path;
use std::process::Command;

use anyhow::{Context, Result, ensure};

use crate::cargo::{cargo, target_dir};
use crate::files::empty_folder;
use crate::process::run;
use crate::readme;
use crate::toolchain::cargo_for;
use crate::vendor::background::Background;
use crate::workspace::root;

/// The crates to publish.
pub(crate) const PACKAGES: [&str; 6] = [
    "armwire",
    "armwire-feetech",
    "armwire-bridge",
    "armwire-sim",
    "armwire-host",
    "armwire-cli",
];
/// The packages whose README has an example.
const LIBRARIES: [&str; 5] = [
    "armwire",
    "armwire-feetech",
    "armwire-bridge",
    "armwire-sim",
    "armwire-host",
];
const VERSION: &str = env!("CARGO_PKG_VERSION");
/// Files that each package must contain in addition to its sources.
const FILES: [&str; 4] = ["README.md", "CHANGELOG.md", "LICENSE-MIT", "LICENSE-APACHE"];
/// The examples of the packages, and those that run without an arm.
const EXAMPLES: [(&str, &str, bool); 3] = [
    ("armwire", "decode", true),
    ("armwire-sim", "lossy_line", true),
    ("armwire-host", "joints", false),
];

/// The protocol that is not the engine's, and a target without `std`.
const FOREIGN: &str = "armwire-feetech";
const NO_STD: &str = "thumbv6m-none-eabi";

/// The page with programs for a PC, and the heading between them.
const PC: &str = "docs/pc.md";
const SECOND: &str = "\n### Over a port of your own\n";

/// The use of the tests in the packages.
#[derive(Clone, Copy)]
pub(crate) enum Tests {
    Run,
    /// They are the workspace's tests, which ran already.
    Compile,
}

/// Publishes the crates without an upload, and packages them. Builds [`FOREIGN`] alone, and the tests and examples of all,
/// from their `.crate` files, builds and runs the examples of their READMEs with these files only, and moves a virtual arm
/// with each program in [`PC`].
///
/// # Errors
///
/// The first package with a missing file, a failing build, test or example.
pub(crate) fn check(tests: Tests) -> Result<()> {
    let folder = target_dir()?.join("packages");
    let crates = folder.join("crates");
    empty_folder(&crates)?;
    publish()?;
    unpack(&crates)?;
    build_alone(FOREIGN, &crates)?;
    test(&crates, tests)?;
    run_examples(&crates)?;
    LIBRARIES
        .into_iter()
        .try_for_each(|library| run_readme(library, &folder))?;
    move_virtual_arms(&folder)
}

/// Publishes the crates, each after those that it depends on, without an upload. Cargo keeps none of these packages.
fn publish() -> Result<()> {
    let mut publish = cargo("publish --dry-run --quiet --no-verify --allow-dirty");
    run(publish.args(selection()))
}

/// The packages, as arguments of cargo.
fn selection() -> [String; PACKAGES.len()] {
    PACKAGES.map(|package| format!("--package={package}"))
}

/// Packages the crates and unpacks them into this folder.
fn unpack(crates: &Path) -> Result<()> {
    let mut package = cargo("package --quiet --no-verify --allow-dirty");
    run(package.args(selection()))?;
    for package in PACKAGES.map(versioned) {
        let archive = target_dir()?.join("package").join(format!("{package}.crate"));
        run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(crates))?;
        for file in FILES {
            let is_there = crates.join(&package).join(file).exists();
            ensure!(is_there, "{package}.crate has no {file}");
        }
        for page in ["README.md", "CHANGELOG.md"] {
            let text = fs::read_to_string(crates.join(&package).join(page))?;
            let mut links = text.split("](").skip(1);
            let leads_out = links.all(|link| link.starts_with("https://"));
            ensure!(leads_out, "{package}.crate: {page} has a link that is no address");
        }
    }
    Ok(())
}

/// Builds a crate as a stranger does: with the lock file of its package, and no feature that another crate asks for.
fn build_alone(package: &str, crates: &Path) -> Result<()> {
    println!("{package}: alone, for {NO_STD}");
    let package = versioned(package);
    let lock = crates.join(&package).join("Cargo.lock");
    make_workspace(crates, &[package], &lock)?;
    run(cargo_for(NO_STD, "build --quiet")?.current_dir(crates))
}

/// Makes a workspace of unpacked crates, which depend on one another and on no other file of the repository, with the
/// versions of a lock file.
fn make_workspace(crates: &Path, members: &[String], lock: &Path) -> Result<()> {
    let workspace = format!(
        "[workspace]\nresolver = \"3\"\nmembers = {members:?}\n{}\n{}",
        patch(crates),
        profiles()?
    );
    fs::write(crates.join("Cargo.toml"), workspace)?;
    fs::copy(lock, crates.join("Cargo.lock"))?;
    Ok(())
}

/// Runs or compiles the tests of the unpacked crates.
fn test(crates: &Path, tests: Tests) -> Result<()> {
    make_workspace(crates, &PACKAGES.map(versioned), &root().join("Cargo.lock"))?;
    let words = match tests {
        Tests::Run => "test --quiet --features armwire/async",
        Tests::Compile => "check --quiet --all-targets --features armwire/async",
    };
    run(&mut in_folder(words, crates)?)
}

/// Builds the examples of the unpacked crates, and runs those that need no arm.
fn run_examples(crates: &Path) -> Result<()> {
    for (package, example, needs_no_arm) in EXAMPLES {
        println!("{package}: example {example}");
        let action = if needs_no_arm { "run" } else { "build" };
        let words = format!("{action} --quiet --package {package} --example {example}");
        run(&mut in_folder(&words, crates)?)?;
    }
    Ok(())
}

/// Builds the example of a README in a new package, and runs it if it is a program.
fn run_readme(package: &str, folder: &Path) -> Result<()> {
    println!("{package}: the example of its README");
    let crates = folder.join("crates");
    let page = fs::read_to_string(crates.join(versioned(package)).join("README.md"))?;
    let user = folder.join(format!("{package}-user"));
    readme::make_package(&page, &user, &patch(&crates))?;
    let is_program = user.join("src/main.rs").exists();
    run(&mut in_folder(
        if is_program { "run --quiet" } else { "check --quiet" },
        &user,
    )?)
}

/// Moves a virtual arm with each program in [`PC`].
fn move_virtual_arms(folder: &Path) -> Result<()> {
    let page = fs::read_to_string(root().join(PC))?;
    let (first, second) = page
        .split_once(SECOND)
        .with_context(|| format!("{PC} has no second program"))?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    [first, second]
        .into_iter()
        .try_for_each(|program| move_virtual_arm(folder, program))
}

/// Builds the program of this text in a new package, and moves a virtual arm with it.
fn move_virtual_arm(folder: &Path, text: &str) -> Result<()> {
    println!("{PC}: a program and a virtual arm");
    let (crates, user) = (folder.join("crates"), folder.join("pc-user"));
    let packaged = |name: &str| crates.join(versioned(name)).display().to_string();
    let text = text
        .replace("armwire/protocol", &packaged("armwire"))
        .replace("armwire/host", &packaged("armwire-host"));
    readme::make_package(&text, &user, &patch(&crates))?;
    run(&mut in_folder("build --quiet", &user)?)?;
    let (arm, programs) = (folder.join("arm"), target_dir()?.join("debug"));
    let mut sim = Command::new(programs.join("armwire"));
    sim.args(["sim", "ling", "--pty"]).arg(&arm);
    let _sim = Background::start_with_line(&mut sim)?;
    run(Command::new(programs.join("readme")).arg(arm))
}

/// The section of a manifest that replaces the registry's crates by the unpacked ones.
fn patch(crates: &Path) -> String {
    let entries = LIBRARIES.map(|library| format!("{library} = {{ path = {:?} }}\n", crates.join(versioned(library))));
    format!("\n[patch.crates-io]\n{}", entries.concat())
}

/// The development profiles of the repository: dependencies are then compiled once for both workspaces.
fn profiles() -> Result<String> {
    let manifest = fs::read_to_string(root().join("Cargo.toml"))?;
    let sections = manifest
        .split("\n[")
        .filter(|section| section.starts_with("profile.dev"));
    Ok(sections.map(|section| format!("[{section}\n")).collect())
}

/// Cargo in this folder, with the target directory of the repository.
fn in_folder(words: &str, folder: &Path) -> Result<Command> {
    let mut command = cargo(words);
    command.current_dir(folder);
    command.env("CARGO_TARGET_DIR", target_dir()?);
    Ok(command)
}

fn versioned(package: &str) -> String {
    format!("{package}-{VERSION}")
}
