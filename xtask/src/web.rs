//! `cargo xtask web`: the page in `web/`, its engine in WebAssembly, and their tests.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result};
use clap::Args;

use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::files::empty_folder;
use crate::image;
use crate::process::{output, run};
use crate::toolchain::cargo_for;
use crate::workspace::root;
use crate::{apt, demo, examples};

/// The folder of the built page, in the target directory.
pub(crate) const PAGE: &str = "web";
/// The picture in README, of those that the tests take.
const PICTURE: &str = "1280x800-light.png";
const TARGET: &str = "wasm32-unknown-unknown";
/// The command that builds the engine.
const ENGINE: &str = "build --package armwire-web --profile web --locked --quiet";
/// The module's name in cargo and on the page.
const MODULE: &str = "armwire_web.wasm";
const SERVED_MODULE: &str = "armwire.wasm";
/// Features that compilers enable for this target by default.
const WASM_FEATURES: [&str; 6] = [
    "--enable-bulk-memory",
    "--enable-multivalue",
    "--enable-mutable-globals",
    "--enable-nontrapping-float-to-int",
    "--enable-reference-types",
    "--enable-sign-ext",
];
/// Options of a new mount namespace, whose mounts other programs do not see.
const UNSHARE: [&str; 3] = ["--mount", "--propagation", "private"];
/// Extensions of the page's files.
const SERVED: [&str; 3] = ["html", "css", "js"];

#[derive(Args, Default)]
pub(crate) struct Options {
    /// Only build the page, without tests
    #[arg(long)]
    build: bool,
    /// Write the picture of the page in README
    #[arg(long, conflicts_with = "build")]
    write: bool,
}

/// Builds the page and tests it.
///
/// # Errors
///
/// The first check that fails, or a missing tool that cannot be installed.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    let page = build()?;
    println!("the page is in {}", page.display());
    if options.build {
        return Ok(());
    }
    run(&mut cargo("test --package armwire-web --locked --quiet"))?;
    test_page(&page)?;
    if options.write {
        fs::copy(screenshots()?.join(PICTURE), root().join("docs/page.png"))?;
    }
    test_serial(&page)
}

/// Builds the page into a folder that a static host can serve.
fn build() -> Result<PathBuf> {
    apt::require(&examples::NODE)?;
    let test = folder("test");
    run(Command::new("npm")
        .args(["ci", "--ignore-scripts", "--no-audit", "--no-fund"])
        .current_dir(&test))?;
    run(&mut cargo_for(TARGET, ENGINE)?)?;

    let page = target_dir()?.join(PAGE);
    empty_folder(&page)?;
    for file in fs::read_dir(root().join("web"))? {
        let file = file?.path();
        let extension = file.extension().and_then(|extension| extension.to_str());
        if let (Some(name), Some(extension)) = (file.file_name(), extension)
            && SERVED.contains(&extension)
        {
            fs::copy(&file, page.join(name))?;
        }
    }
    let module = page.join(SERVED_MODULE);
    let built = target_dir()?.join(TARGET).join("web").join(MODULE);
    run(Command::new(test.join("node_modules/.bin/wasm-opt"))
        .arg("-Oz")
        .args(WASM_FEATURES)
        .arg(built)
        .arg("-o")
        .arg(&module))?;
    let size = fs::metadata(&module).context("wasm-opt wrote no module")?.len();
    println!("{SERVED_MODULE}: {size} bytes");
    Ok(page)
}

/// Tests the modules in Node.js, and the page in this folder in headless Chromium.
///
/// # Errors
///
/// If a program is missing and cannot be installed, or a test fails.
pub(crate) fn test_page(page: &Path) -> Result<()> {
    apt::require(&[("chromium", "chromium")])?;
    run(Command::new("node")
        .args(["--test", "--test-reporter=spec", "unit.test.mjs", "page.test.mjs"])
        .current_dir(folder("test"))
        .env("ARMWIRE_PAGE", page)
        .env("ARMWIRE_SCREENSHOTS", screenshots()?))
}

/// Tests the page with the shipped image on the virtual board, over WebSerial.
fn test_serial(page: &Path) -> Result<()> {
    let image = image::build(image::Options::of(Board::default()))?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let demo = demo::build()?;
    output(Command::new("unshare").args(UNSHARE).arg("true"))
        .context("no mount namespace: WebSerial cannot be tested")?;
    run(Command::new("unshare")
        .args(UNSHARE)
        .args(["node", "--test", "--test-reporter=spec", "serial.test.mjs"])
        .current_dir(folder("test"))
        .env("ARMWIRE_PAGE", page)
        .env("ARMWIRE_IMAGE", image.path)
        .env("ARMWIRE_DEMO", demo)
        .env("ARMWIRE_COMMAND", target_dir()?.join("debug/armwire")))
}

/// The folder of the pictures that the tests of the page take.
fn screenshots() -> Result<PathBuf> {
    Ok(target_dir()?.join("web-screenshots"))
}

fn folder(name: &str) -> PathBuf {
    root().join("web").join(name)
}
