//! `cargo xtask dist`: a reproducible release of the current commit, independent of the folder.
//!
//! Each system has an archive of its own, with everything for a user there: one download, with a name that says the
//! system, as those of ripgrep and probe-rs. A robot's computer may have no network for a second one.

mod archive;
mod common;
mod dependencies;
mod folder;
mod release;
mod system;
mod trial;

use std::fs;
use std::process::Command;

use anyhow::{Result, ensure};
use clap::Args;

use self::folder::archive_of;
use self::release::{Release, check_tree, git_command};
use self::system::SYSTEMS;
use crate::cargo::cargo;
use crate::files::empty_folder;
use crate::process::run;
use crate::{apt, platforms, python};

#[derive(Args)]
pub(crate) struct Options {
    /// Use it without Rust, build it again in another folder, and compare every byte
    #[arg(long)]
    check: bool,
}

impl Options {
    /// The release is used, and made twice.
    pub(crate) const CHECK: Self = Self { check: true };
}

/// Makes the release: a folder for each system, and an archive of it.
///
/// # Errors
///
/// If there are uncommitted changes, if a build fails, contains a path of this machine or needs a newer C library than
/// promised, if the release cannot be used, or if a second one differs.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    let release = Release::new()?;
    make(&release)?;
    if options.check {
        trial::run_all(&release)?;
        compare_with_another(&release)?;
    }
    Ok(())
}

fn make(release: &Release) -> Result<()> {
    apt::require(&[platforms::MINGW])?;
    run(&mut cargo("fetch --locked"))?;
    let tools = python::build_tools()?;
    for system in SYSTEMS {
        run(release.reproducible(&mut system.build(&tools)?)?)?;
    }
    // The wheels.
    release.xtask(&["python", "wheels"])?;
    release.make_common()?;
    for system in SYSTEMS {
        release.make_archive(system)?;
    }
    check_tree("the release changed the sources")
}

/// Builds the release in a clone, with the clone's own commands, and compares the archives.
fn compare_with_another(release: &Release) -> Result<()> {
    let clone = release.dist.join("clone");
    empty_folder(&clone)?;
    run(git_command("clone --quiet --shared --no-checkout .").arg(&clone))?;
    run(git_command(&format!("checkout --quiet {}", release.commit)).current_dir(&clone))?;
    let other = clone.join("target/dist");
    let mut dist = cargo("run --quiet --package xtask -- dist");
    dist.current_dir(&clone).env("CARGO_TARGET_DIR", clone.join("target"));
    run(&mut dist)?;
    for system in SYSTEMS {
        let folders = [release.folder(system), Release::folder_in(&other, system)];
        run(Command::new("diff").args(["--recursive", "--brief"]).args(&folders))?;
        let [ours, theirs] = folders.map(|folder| fs::read(archive_of(&folder)));
        ensure!(
            ours? == theirs?,
            "{}: the files are equal, but the archives differ",
            system.target
        );
    }
    fs::remove_dir_all(&clone)?;
    println!("a second release, built in {}, has the same bytes", clone.display());
    Ok(())
}
