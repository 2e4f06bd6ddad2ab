//! `cargo xtask readme`: the README's example, built as a user would who copies it.

use std::fs;

use anyhow::{Context, Result};

use crate::cargo::{cargo, target_dir};
use crate::process;
use crate::workspace::root;

/// Builds a package of the README's Rust block with the dependencies of its TOML block, and nothing else.
///
/// # Errors
///
/// If the README has no such blocks, or they do not compile together.
pub(crate) fn check() -> Result<()> {
    let readme = fs::read_to_string(root().join("README.md"))?;
    let (example, dependencies) = (block(&readme, "rust")?, block(&readme, "toml")?);
    let path = root().join("protocol").display().to_string();
    let dependencies = dependencies.replace("armwire/protocol", &path);
    let package = "[package]\nname = \"readme\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n";
    let folder = target_dir()?.join("readme");
    fs::create_dir_all(folder.join("src"))?;
    fs::write(folder.join("Cargo.toml"), format!("{package}{dependencies}"))?;
    fs::write(folder.join("src/lib.rs"), format!("#![allow(dead_code)]\n{example}"))?;
    // With the versions that everything else has.
    fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock"))?;
    process::run(cargo("check --quiet").current_dir(folder))
}

/// The first block of this language.
fn block<'a>(text: &'a str, language: &str) -> Result<&'a str> {
    let (_, block) = text
        .split_once(&format!("```{language}\n"))
        .with_context(|| format!("the README has no {language} block"))?;
    let (block, _) = block.split_once("```").context("a block of the README does not end")?;
    Ok(block)
}
