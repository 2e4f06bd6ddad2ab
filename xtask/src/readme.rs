//! `cargo xtask readme`: builds the README's example in a new package.

use std::fs;
use std::path::Path;

use anyhow::{Context, Result};

use crate::cargo::{cargo, target_dir};
use crate::process;
use crate::workspace::root;

/// Builds the README's example.
///
/// # Errors
///
/// If the README has no example, or it does not compile.
pub(crate) fn check() -> Result<()> {
    let readme = fs::read_to_string(root().join("README.md"))?;
    let path = root().join("protocol").display().to_string();
    let folder = target_dir()?.join("readme");
    make_package(&readme.replace("armwire/protocol", &path), &folder, "")?;
    process::run(cargo("check --quiet").current_dir(folder))
}

/// Creates a package from the Rust block of a page, with the dependencies in its TOML block. It is a program if the block
/// has a `main`. `more` is added to its manifest.
///
/// # Errors
///
/// If the page lacks a block, or the package cannot be written.
pub(crate) fn make_package(page: &str, folder: &Path, more: &str) -> Result<()> {
    let (example, dependencies) = (block(page, "rust")?, block(page, "toml")?);
    let package = "[package]\nname = \"readme\"\nedition = \"2024\"\n\n[workspace]\n\n[dependencies]\n";
    let source = match example.contains("fn main()") {
        true => "src/main.rs",
        false => "src/lib.rs",
    };
    fs::create_dir_all(folder.join("src"))?;
    fs::write(folder.join("Cargo.toml"), format!("{package}{dependencies}{more}"))?;
    fs::write(folder.join(source), format!("#![allow(dead_code)]\n{example}"))?;
    // The versions of the workspace.
    fs::copy(root().join("Cargo.lock"), folder.join("Cargo.lock"))?;
    Ok(())
}

/// The first block of this language.
fn block<'a>(text: &'a str, language: &str) -> Result<&'a str> {
    let (_, block) = text
        .split_once(&format!("```{language}\n"))
        .with_context(|| format!("the page has no {language} block"))?;
    let (block, _) = block.split_once("```").context("a block of the page does not end")?;
    Ok(block)
}
