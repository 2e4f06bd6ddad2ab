//! The linker's inputs for an image: a change of any file makes another image, whose commit has a `+`.

// The sources for `build.rs`.
#[path = "../../firmware/sources.rs"]
mod sources;

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail, ensure};
use serde_json::Value;

use crate::board::Board;
use crate::cargo::{cargo_in_firmware, target_dir};
use crate::files::empty_folder;
use crate::image::Options;
use crate::process::{output, run};
use crate::program::Program;
use crate::workspace::{firmware, root};

use sources::SOURCES;

/// The board of the image, and its command of cargo.
const BOARD: Board = Board::STM32F405;
const BUILD: &str = "build --release";

/// Compares the linker's list of its inputs with the list of sources.
///
/// # Errors
///
/// If an input is no source.
pub(crate) fn compare() -> Result<()> {
    let inputs = inputs()?;
    println!("of the repository, the linker reads {inputs:?}");
    let sources = SOURCES.map(|source| firmware().join(source).canonicalize());
    let sources = sources.into_iter().collect::<Result<Vec<_>, _>>()?;
    for input in &inputs {
        let file = root().join(input).canonicalize()?;
        let is_source = sources.iter().any(|source| file.starts_with(source));
        ensure!(is_source, "firmware/sources.rs lacks {}", input.display());
    }
    Ok(())
}

/// The files of the repository that the linker read. Cargo tracks all others: they are in the target directory, or belong to
/// a dependency of `Cargo.lock`.
fn inputs() -> Result<Vec<PathBuf>> {
    let messages = output(&mut cargo_in_firmware(&format!("{BUILD} --message-format=json")))?;
    let list = fs::read_to_string(out_dir(&messages)?.join("linker-inputs.d"))?;
    let target = target_dir()?;
    let files = files(&list).map(|file| root().join(file));
    let files = files.filter(|file| !file.starts_with(&target));
    let inputs: Vec<_> = files
        .filter_map(|file| Some(file.strip_prefix(root()).ok()?.to_owned()))
        .collect();
    ensure!(inputs.iter().any(|input| input == "memory.x"), "{list}");
    Ok(inputs)
}

/// The folder of the files that the firmware's `build.rs` makes, by cargo's messages.
fn out_dir(messages: &str) -> Result<PathBuf> {
    for message in messages.lines() {
        let message: Value = serde_json::from_str(message)?;
        let is_ours = |id: &str| id.contains("armwire-firmware");
        if message["reason"] == "build-script-executed" && message["package_id"].as_str().is_some_and(is_ours) {
            return Ok(message["out_dir"].as_str().context("a script has a folder")?.into());
        }
    }
    bail!("cargo ran no build.rs of the firmware")
}

/// The files in a linker's dependency file, each of which has an empty rule.
fn files(list: &str) -> impl Iterator<Item = &str> {
    list.lines().filter_map(|line| line.strip_suffix(':'))
}

/// Changes each input of the linker, and `build.rs`, in a clone of the last commit. Each change takes a link of an image.
///
/// # Errors
///
/// If a change makes the same image.
pub(crate) fn change_each() -> Result<()> {
    let inputs = inputs()?;
    let clone = target_dir()?.join("linker-inputs");
    empty_folder(&clone)?;
    run(Command::new("git")
        .args(["clone", "--quiet", "--shared"])
        .arg(root())
        .arg(&clone))?;
    let unchanged = image(&clone)?;
    for input in inputs
        .iter()
        .map(PathBuf::as_path)
        .chain([Path::new("firmware/build.rs")])
    {
        let file = clone.join(input);
        let text = fs::read_to_string(&file)?;
        fs::write(&file, format!("{text}\n/* changed */\n"))?;
        ensure!(
            image(&clone)? != unchanged,
            "a change of {} makes the same image",
            input.display()
        );
        fs::write(&file, text)?;
    }
    fs::remove_dir_all(&clone)?;
    Ok(())
}

/// The flash of the image that a clone makes.
fn image(clone: &Path) -> Result<Vec<u8>> {
    let mut build = cargo_in_firmware(BUILD);
    // Only the packages of the clone are compiled again.
    build.env("CARGO_TARGET_DIR", target_dir()?);
    run(build.current_dir(clone.join("firmware")))?;
    Ok(Program::parse(&fs::read(Options::of(BOARD).program()?)?)?.bin())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_file_has_an_empty_rule() {
        let list = "image: \\\n  memory.x \\\n  out/link.x\n\nmemory.x:\n\nout/link.x:\n";
        assert_eq!(files(list).collect::<Vec<_>>(), ["memory.x", "out/link.x"]);
    }
}
