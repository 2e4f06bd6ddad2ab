//! Hands the linker the board's memory map, so that a plain `cargo build --target …` links.

use std::path::Path;
use std::{env, fs};

fn main() {
    let here = env::var("CARGO_MANIFEST_DIR").expect("cargo sets CARGO_MANIFEST_DIR");
    let out = env::var("OUT_DIR").expect("cargo sets OUT_DIR");
    let memory = Path::new(&here).join("../memory.x");

    fs::copy(&memory, Path::new(&out).join("memory.x")).expect("memory.x stands in the workspace's root");
    println!("cargo:rerun-if-changed={}", memory.display());
    println!("cargo:rustc-link-search={out}");
    println!("cargo:rustc-link-arg-bins=--nmagic");
    println!("cargo:rustc-link-arg-bins=-Tlink.x");
    if env::var_os("CARGO_FEATURE_DEFMT").is_some() {
        println!("cargo:rustc-link-arg-bins=-Tdefmt.x");
    }
}
