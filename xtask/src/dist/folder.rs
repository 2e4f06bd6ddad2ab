//! Files and folders of a release.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::cargo::target_dir;
use crate::files::list;
use crate::process::{output, run, run_to};
use crate::toolchain::rustc;
use crate::workspace::root;

/// Checks that no file contains a path of this machine.
pub(super) fn check_paths(folder: &Path) -> Result<()> {
    let mut grep = Command::new("grep");
    grep.args(["--recursive", "--text", "--files-with-matches", "--fixed-strings"]);
    for path in [root(), &*target_dir()?, &*cargo_home()?, &*sysroot()?] {
        grep.arg("-e").arg(path);
    }
    // Exit code 1: nothing found.
    run_to(&[1], grep.arg(folder)).context("the files above contain paths of this machine")
}

/// The folder of the compiler.
pub(super) fn sysroot() -> Result<PathBuf> {
    Ok(output(rustc().args(["--print", "sysroot"]))?.trim_end().into())
}

pub(super) fn cargo_home() -> Result<PathBuf> {
    let home = env::var_os("CARGO_HOME").map(PathBuf::from);
    home.or_else(|| Some(env::home_dir()?.join(".cargo")))
        .context("neither CARGO_HOME nor HOME is set")
}

/// Writes `SHA256SUMS` of all files in a folder.
pub(super) fn add_checksums(folder: &Path) -> Result<()> {
    let files = list(folder)?;
    let names = files.iter().map(|file| file.strip_prefix(folder));
    let names = names.collect::<Result<Vec<_>, _>>()?;
    let sums = output(Command::new("sha256sum").args(names).current_dir(folder))?;
    write(&folder.join("SHA256SUMS"), &sums)
}

/// The archive of a folder, beside it.
pub(super) fn archive_of(folder: &Path) -> PathBuf {
    let mut archive = folder.as_os_str().to_owned();
    archive.push(".tar.gz");
    archive.into()
}

/// Packs a folder into an archive beside it. Every file has this time, in seconds since 1970.
pub(super) fn pack(folder: &Path, time: &str) -> Result<PathBuf> {
    let (Some(parent), Some(name)) = (folder.parent(), folder.file_name()) else {
        bail!("{} is in no folder", folder.display());
    };
    let archive = archive_of(folder);
    let mut tar = Command::new("tar");
    tar.args("--create --format=ustar --sort=name --owner=0 --group=0 --numeric-owner --mode=u=rwX,go=rX".split(' '));
    tar.arg(format!("--mtime=@{time}"));
    tar.args(["--use-compress-program=gzip --no-name --best", "--file"])
        .arg(&archive);
    run(tar.arg("-C").arg(parent).arg(name).env("LC_ALL", "C"))?;
    Ok(archive)
}

pub(super) fn copy(from: &Path, to: &Path) -> Result<()> {
    create_parent(to)?;
    fs::copy(from, to).with_context(|| format!("cannot copy {}", from.display()))?;
    Ok(())
}

/// Copies the files of a folder that has no folders in it.
pub(super) fn copy_folder(from: &Path, to: &Path) -> Result<()> {
    for entry in fs::read_dir(from)? {
        let entry = entry?;
        copy(&entry.path(), &to.join(entry.file_name()))?;
    }
    Ok(())
}

pub(super) fn write(file: &Path, text: &str) -> Result<()> {
    create_parent(file)?;
    fs::write(file, text).with_context(|| format!("cannot write {}", file.display()))
}

fn create_parent(file: &Path) -> Result<()> {
    let Some(parent) = file.parent() else {
        bail!("{} is in no folder", file.display());
    };
    Ok(fs::create_dir_all(parent)?)
}
