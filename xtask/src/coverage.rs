//! `cargo xtask coverage`: how much of the protocol and bridge crates the fuzz corpus reaches, all by itself.
//!
//! Not by cargo-llvm-cov: it shows all targets in one report, and LLVM leaves out of such a report what it finds in
//! several programs in different forms. It reports 93.2 % of the protocol crate where 95.7 % are reached.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, ensure};
use clap::Args;
use serde_json::{Value, from_str, from_value};

use crate::cargo::target_dir;
use crate::fuzz::{cargo_fuzz, committed, for_each, targets};
use crate::process::{self, output};
use crate::workspace::root;

#[derive(Args, Default)]
pub(crate) struct Options {
    /// List the lines that are not reached
    #[arg(long)]
    list: bool,
}

/// The crates whose coverage counts.
const CRATES: [&str; 2] = ["protocol/src", "bridge/src"];

/// The least share of their regions that must be reached, in percent.
const LEAST: f64 = 95.0;

/// Parts of the source that run as a whole, and whether they ran: by file, and where they begin and end as line and column.
type Regions = BTreeMap<(String, [u64; 4]), bool>;

/// Prints the coverage of each file, and the lines that are not reached if `list` is set.
///
/// # Errors
///
/// If a crate is covered less than it must be.
pub(crate) fn run(options: &Options) -> Result<()> {
    process::run(cargo_fuzz("build", "coverage")?.env("RUSTFLAGS", "-Cinstrument-coverage"))?;
    let host = output(Command::new("rustc").args(["--print", "host-tuple"]))?;
    let programs = target_dir()?.join("coverage").join(host.trim()).join("release");
    let tools = [llvm("llvm-profdata")?, llvm("llvm-cov")?];
    let mut all = Regions::new();
    for regions in for_each(&targets()?, |target| reached(&programs, target, &tools))? {
        for (region, ran) in regions {
            *all.entry(region).or_default() |= ran;
        }
    }
    report(&all, options.list)
}

/// Code that the corpus of one target reaches.
fn reached(programs: &Path, target: &str, [profdata, cov]: &[PathBuf; 2]) -> Result<Regions> {
    let program = programs.join(target);
    let (raw, profile) = (program.with_extension("profraw"), program.with_extension("profdata"));
    // Each input once, and no other.
    let mut all = Command::new(&program);
    output(all.arg("-runs=0").arg(committed(target)).env("LLVM_PROFILE_FILE", &raw))?;
    let mut merge = Command::new(profdata);
    output(merge.args(["merge", "-sparse", "-o"]).args([&profile, &raw]))?;
    let mut export = Command::new(cov);
    export.arg("export").arg(&program).arg("-instr-profile").arg(&profile);
    export.args(CRATES.map(|sources| root().join(sources)));
    regions(from_str(&output(&mut export)?)?)
}

/// The regions of all functions. One that is generic is compiled often; its regions ran if any of these did.
fn regions(mut export: Value) -> Result<Regions> {
    let mut all = Regions::new();
    for mut function in from_value::<Vec<Value>>(export["data"][0]["functions"].take())? {
        let files: Vec<String> = from_value(function["filenames"].take())?;
        let regions: Vec<[u64; 8]> = from_value(function["regions"].take())?;
        for [line, column, end_line, end_column, count, file, _, kind] in regions {
            // Other kinds are what is left out, or between.
            if let (0, Some(name)) = (kind, ours(&files[file as usize])) {
                let place = [line, column, end_line, end_column];
                *all.entry((name, place)).or_default() |= count > 0;
            }
        }
    }
    Ok(all)
}

/// A file of the crates that count, as it is called in the project.
fn ours(file: &str) -> Option<String> {
    let path = Path::new(file).strip_prefix(root()).ok()?;
    let name = path.to_string_lossy().replace('\\', "/");
    CRATES.iter().any(|folder| name.starts_with(folder)).then_some(name)
}

fn report(all: &Regions, list: bool) -> Result<()> {
    let mut short = Vec::new();
    for folder in CRATES {
        let mut files = BTreeMap::<_, Vec<_>>::new();
        for ((name, [line, ..]), ran) in all.iter().filter(|((name, _), _)| name.starts_with(folder)) {
            files.entry(name).or_default().push((*line, *ran));
        }
        for (name, regions) in &files {
            print_row(name, regions);
            let missed: BTreeSet<_> = regions.iter().filter(|(_, ran)| !ran).map(|(line, _)| line).collect();
            if list && !missed.is_empty() {
                println!("    not reached from line {missed:?}");
            }
        }
        let percent = print_row(folder, &files.into_values().flatten().collect::<Vec<_>>());
        if percent < LEAST {
            short.push(format!("{folder}: {percent:.2} % of regions, must be {LEAST} %"));
        }
    }
    ensure!(short.is_empty(), "{}", short.join("; "));
    Ok(())
}

/// Prints how many of these regions ran, and returns their share in percent.
fn print_row(name: &str, regions: &[(u64, bool)]) -> f64 {
    let (all, ran) = (regions.len(), regions.iter().filter(|(_, ran)| *ran).count());
    let percent = 100.0 * ran as f64 / all.max(1) as f64;
    println!("{name:<40}{:>12} regions{percent:>8.2} %", format!("{ran}/{all}"));
    percent
}

/// A tool of LLVM, of the compiler's own version: others cannot read what it writes.
fn llvm(name: &str) -> Result<PathBuf> {
    let libraries = output(Command::new("rustc").args(["--print", "target-libdir"]))?;
    let path = Path::new(libraries.trim()).with_file_name("bin").join(name);
    if !fs::exists(&path)? {
        println!("{name} is missing: running `rustup component add llvm-tools`");
        process::run(Command::new("rustup").args(["component", "add", "llvm-tools"]))?;
    }
    Ok(path)
}
