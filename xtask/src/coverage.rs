//! `cargo xtask coverage`: coverage of the protocol and bridge crates by the fuzz corpus alone.
//!
//! cargo-llvm-cov is not used: its single report for all targets omits functions whose code differs between the programs.
//! It reports 93.2 % of the protocol crate instead of 95.7 %.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::{Value, from_str, from_value};

use crate::fuzz;
use crate::installation::with_lock;
use crate::parallel::for_each;
use crate::process::{self, output};
use crate::workspace::root;

#[derive(Args, Default)]
pub(crate) struct Options {
    /// List the uncovered lines
    #[arg(long)]
    list: bool,
}

/// The crates whose coverage counts.
const CRATES: [&str; 2] = ["protocol/src", "bridge/src"];

/// Minimum coverage of their regions, in percent.
const LEAST: f64 = 93.0;

/// True for each region of the source that ran. The key is the file, with first and last line and column.
type Regions = BTreeMap<(String, [u64; 4]), bool>;

/// Prints the coverage of each file, and the uncovered lines if `list` is set.
///
/// # Errors
///
/// If the coverage of a crate is too low.
pub(crate) fn run(options: &Options) -> Result<()> {
    fuzz::build()?;
    let programs = fuzz::programs()?;
    let tools = [llvm("llvm-profdata")?, llvm("llvm-cov")?];
    let measure = |target: String| reached(&programs, &target, &tools).context(target);
    let mut all = Regions::new();
    for (region, ran) in for_each(fuzz::targets()?, measure)?.into_iter().flatten() {
        *all.entry(region).or_default() |= ran;
    }
    report(&all, options.list)
}

/// Coverage by the corpus of one target.
fn reached(programs: &Path, target: &str, [profdata, cov]: &[PathBuf; 2]) -> Result<Regions> {
    let program = programs.join(target);
    let (raw, profile) = (program.with_extension("profraw"), program.with_extension("profdata"));
    // Each committed input once, and no others.
    let mut all = Command::new(&program);
    output(
        all.arg("-runs=0")
            .arg(fuzz::committed(target))
            .env("LLVM_PROFILE_FILE", &raw),
    )?;
    let mut merge = Command::new(profdata);
    output(merge.args(["merge", "-sparse", "-o"]).args([&profile, &raw]))?;
    let mut export = Command::new(cov);
    export.arg("export").arg(&program).arg("-instr-profile").arg(&profile);
    export.args(CRATES.map(|sources| root().join(sources)));
    regions(from_str(&output(&mut export)?)?)
}

/// The regions of all functions. A region of a generic function ran if that of any instance did.
fn regions(mut export: Value) -> Result<Regions> {
    let mut all = Regions::new();
    for mut function in from_value::<Vec<Value>>(export["data"][0]["functions"].take())? {
        let files: Vec<String> = from_value(function["filenames"].take())?;
        let regions: Vec<[u64; 8]> = from_value(function["regions"].take())?;
        for [line, column, end_line, end_column, count, file, _, kind] in regions {
            // The other kinds are not code.
            if let (0, Some(name)) = (kind, ours(&files[file as usize])) {
                let place = [line, column, end_line, end_column];
                *all.entry((name, place)).or_default() |= count > 0;
            }
        }
    }
    Ok(all)
}

/// The path in the project of a file whose coverage counts.
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
                println!("    uncovered regions start at lines {missed:?}");
            }
        }
        let percent = print_row(folder, &files.into_values().flatten().collect::<Vec<_>>());
        if percent < LEAST {
            short.push(format!("{folder}: {percent:.2} % of regions, minimum {LEAST} %"));
        }
    }
    ensure!(short.is_empty(), "{}", short.join("; "));
    Ok(())
}

/// Prints the number of these regions that ran, and returns their share in percent.
fn print_row(name: &str, regions: &[(u64, bool)]) -> f64 {
    let (all, ran) = (regions.len(), regions.iter().filter(|(_, ran)| *ran).count());
    let percent = 100.0 * ran as f64 / all.max(1) as f64;
    println!("{name:<40}{:>12} regions{percent:>8.2} %", format!("{ran}/{all}"));
    percent
}

/// An LLVM tool of the compiler's own version: others cannot read its files.
fn llvm(name: &str) -> Result<PathBuf> {
    let libraries = output(Command::new("rustc").args(["--print", "target-libdir"]))?;
    let path = Path::new(libraries.trim()).with_file_name("bin").join(name);
    if !fs::exists(&path)? {
        println!("{name} is missing");
        with_lock(|| process::run(Command::new("rustup").args(["component", "add", "llvm-tools"])))?;
    }
    Ok(path)
}
