//! The README's example, built as a user would who copies it.

use std::fs;

use crate::Result;
use crate::process::{cargo, run as run_command};
use crate::workspace;

/// Builds a package of the README's Rust block with the dependencies of its TOML block, and nothing else.
///
/// # Errors
///
/// If the README has no such blocks, or they do not compile together.
pub(crate) fn check() -> Result {
    let root = workspace::root();
    let readme = fs::read_to_string(root.join("README.md"))?;
    let (example, dependencies) = (block(&readme, "rust")?, block(&readme, "toml")?);
    let path = root.join("protocol").display().to_string();
    let dependencies = dependencies.replace("armwire/protocol", &path);
    let package = "[package]\nname = \"readme\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n";
    let folder = workspace::target_dir()?.join("readme");
    fs::create_dir_all(folder.join("src"))?;
    fs::write(folder.join("Cargo.toml"), format!("{package}{dependencies}"))?;
    fs::write(folder.join("src/lib.rs"), format!("#![allow(dead_code)]\n{example}"))?;
    // With the versions that everything else has.
    fs::copy(root.join("Cargo.lock"), folder.join("Cargo.lock"))?;
    run_command(cargo().args(["check", "--quiet"]).current_dir(folder))
}

/// The first block of this language.
fn block<'a>(text: &'a str, language: &str) -> Result<&'a str> {
    let (_, block) = text
        .split_once(&format!("```{language}\n"))
        .ok_or_else(|| format!("the README has no {language} block"))?;
    let (block, _) = block.split_once("```").ok_or("a block of the README does not end")?;
    Ok(block)
}
