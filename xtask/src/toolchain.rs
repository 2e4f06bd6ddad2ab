//! A compiler for microcontrollers, which is installed if missing.
//!
//! The `core` library of the targets is not part of a plain Rust installation. In this order: the active compiler has it;
//! rustup adds it; Debian's compiler, which builds it from source, is installed; apt-get installs that.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, bail};

use crate::apt;
use crate::cargo::{cargo, cargo_at, target_dir};
use crate::installation::with_lock;
use crate::process::output;

const DEBIAN_RUSTC: &str = "/usr/bin/rustc";
const DEBIAN_CARGO: &str = "/usr/bin/cargo";
const DEBIAN_LINKER: &str = "/usr/bin/rust-lld";
const DEBIAN_SOURCES: &str = "/usr/lib/rustlib/src/rust/library/core";
/// Debian's packages of these four.
const DEBIAN_PACKAGES: [&str; 5] = ["rustc-web", "cargo-web", "rust-web-src", "rust-web-llvm", "lld-22"];

/// A compiler for microcontrollers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Toolchain {
    /// The active compiler has the targets.
    Installed,
    /// Debian's compiler, which builds `core` from source.
    Debian,
}

impl Toolchain {
    /// A toolchain that has these targets.
    ///
    /// # Errors
    ///
    /// If there is none and none can be installed. The error has the command that installs one.
    pub(crate) fn find(targets: &[&str]) -> Result<Self> {
        if is_usable(targets) {
            return Ok(Self::Installed);
        }
        let missing = missing(targets);
        if !debian_is_complete() {
            apt::install(&DEBIAN_PACKAGES)?;
        }
        if !debian_is_complete() {
            bail!("no compiler for {}; run `{}`", missing.join(", "), remedy(&missing));
        }
        println!("using Debian's compiler, {DEBIAN_RUSTC}, for {}", missing.join(", "));
        Ok(Self::Debian)
    }

    /// Cargo with these words as arguments, for this target. More arguments can be added.
    pub(crate) fn cargo(self, words: &str, target: &str) -> Result<Command> {
        let mut command = match self {
            Self::Installed => cargo(words),
            Self::Debian => cargo_at(DEBIAN_CARGO, words),
        };
        command.args(["--target", target]);
        command.env("CARGO_TARGET_DIR", self.target_dir()?);
        if self == Self::Debian {
            command.arg("-Zbuild-std=core,alloc");
            command.arg("-Zbuild-std-features=compiler-builtins-mem");
            let linker = format!("CARGO_TARGET_{}_LINKER", target.to_uppercase().replace('-', "_"));
            command
                .env("RUSTC", DEBIAN_RUSTC)
                .env("RUSTC_BOOTSTRAP", "1")
                .env(linker, DEBIAN_LINKER);
            // `cargo run` set it to the libraries of the other compiler.
            command.env_remove("LD_LIBRARY_PATH");
        }
        Ok(command)
    }

    /// The target directory. Two compilers in one directory would overwrite each other's files.
    pub(crate) fn target_dir(self) -> Result<PathBuf> {
        let dir = target_dir()?;
        match self {
            Self::Installed => Ok(dir),
            Self::Debian => Ok(dir.join("thumb")),
        }
    }
}

/// The active compiler.
pub(crate) fn rustc() -> Command {
    Command::new(env::var_os("RUSTC").unwrap_or_else(|| "rustc".into()))
}

/// A line of `rustc -vV`, such as `host`.
///
/// # Errors
///
/// If there is no such line.
pub(crate) fn rustc_property(name: &str) -> Result<String> {
    let lines = output(rustc().arg("-vV"))?;
    let value = lines
        .lines()
        .find_map(|line| line.strip_prefix(name)?.strip_prefix(": "));
    value
        .map(Into::into)
        .with_context(|| format!("`rustc -vV` has no {name}"))
}

/// Returns true if the active compiler has these targets, or rustup has added them.
pub(crate) fn is_usable(targets: &[&str]) -> bool {
    let missing = missing(targets);
    missing.is_empty() || add_with_rustup(&missing)
}

fn missing<'a>(targets: &[&'a str]) -> Vec<&'a str> {
    targets.iter().copied().filter(|target| !is_installed(target)).collect()
}

fn is_installed(target: &str) -> bool {
    let libraries = output(rustc().args(["--print", "target-libdir", "--target", target]));
    let files = libraries.map(|folder| fs::read_dir(folder.trim()));
    let mut files = files.into_iter().flatten().flatten();
    files.any(|file| file.is_ok_and(|file| file.file_name().to_string_lossy().starts_with("libcore-")))
}

/// Returns true if rustup is installed and has added the targets.
fn add_with_rustup(targets: &[&str]) -> bool {
    println!("rustup adds {}", targets.join(", "));
    let added = with_lock(|| output(Command::new("rustup").args(["target", "add"]).args(targets)));
    if let Err(error) = &added {
        println!("rustup failed: {error:#}");
    }
    added.is_ok() && targets.iter().all(|target| is_installed(target))
}

fn debian_is_complete() -> bool {
    let files = [DEBIAN_CARGO, DEBIAN_LINKER, DEBIAN_SOURCES];
    files.iter().all(|file| Path::new(file).exists()) && debian_is_recent()
}

/// Returns true if Debian's compiler is installed and recent enough for this workspace.
fn debian_is_recent() -> bool {
    let mut rustc = Command::new(DEBIAN_RUSTC);
    rustc.arg("--version").env_remove("LD_LIBRARY_PATH");
    let version = |text: &str| -> Option<(u32, u32)> {
        let mut numbers = text.split('.').map_while(|number| number.parse().ok());
        Some((numbers.next()?, numbers.next()?))
    };
    output(&mut rustc)
        .is_ok_and(|text| text.split(' ').nth(1).and_then(version) >= version(env!("CARGO_PKG_RUST_VERSION")))
}

/// The command that installs a compiler for the targets.
fn remedy(targets: &[&str]) -> String {
    let in_debian = output(Command::new("apt-cache").args(["show", DEBIAN_PACKAGES[0]])).is_ok();
    if in_debian {
        return format!("sudo apt-get install {}", DEBIAN_PACKAGES.join(" "));
    }
    format!("rustup target add {}", targets.join(" "))
}
