//! `cargo xtask coverage`: how much of the protocol and bridge crates the fuzz corpus reaches, all by itself.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;
use serde_json::Value;

use crate::fuzz::{self, COUNTERS, committed, for_each, libfuzzer, targets};
use crate::process::{self, output};
use crate::workspace::root;

#[derive(Args)]
pub(crate) struct Options {
    /// List the lines that are not reached
    #[arg(long)]
    pub(crate) list: bool,
}

/// The crates whose coverage counts.
const CRATES: [&str; 2] = ["protocol/src", "bridge/src"];

/// The least share of their regions that must be reached, in percent.
const LEAST: f64 = 95.0;

/// A part of the source that runs as a whole: where it begins and ends, as line and column.
type Region = [u64; 4];

/// The regions of each file, and whether they ran.
type Files = BTreeMap<String, BTreeMap<Region, bool>>;

/// Prints the coverage of each file, and the lines that are not reached if `list` is set.
///
/// # Errors
///
/// If a crate is covered less than it must be.
pub(crate) fn run(options: &Options) -> Result<()> {
    let programs = fuzz::build(&format!("{COUNTERS} -Cinstrument-coverage"), "coverage")?;
    let tools = [tool("llvm-profdata")?, tool("llvm-cov")?];
    let mut files = Files::new();
    for reached in for_each(&targets()?, |target| reached(&programs, target, &tools))? {
        for (name, regions) in reached {
            let file = files.entry(name).or_default();
            for (region, ran) in regions {
                *file.entry(region).or_default() |= ran;
            }
        }
    }
    report(&files, options.list)
}

/// What the corpus of one target reaches. Each program is looked at alone: of what several have in common, LLVM would show
/// only what the first of them ran.
fn reached(programs: &Path, target: &str, [profdata, cov]: &[PathBuf; 2]) -> Result<Files> {
    let program = programs.join(target);
    let (raw, profile) = (program.with_extension("profraw"), program.with_extension("profdata"));
    let mut all = libfuzzer(programs, target);
    // Each input once, and no other.
    output(all.arg("-runs=0").arg(committed(target)).env("LLVM_PROFILE_FILE", &raw))?;
    output(
        Command::new(profdata)
            .args(["merge", "-sparse", "-o"])
            .args([&profile, &raw]),
    )?;
    let mut export = Command::new(cov);
    export.arg("export").arg(&program).arg("-instr-profile").arg(&profile);
    export.args(CRATES.map(|sources| root().join(sources)));
    regions(&serde_json::from_str(&output(&mut export)?)?)
}

/// The regions of each file, and whether any of the functions made of it ran them: what is generic is compiled often.
fn regions(export: &Value) -> Result<Files> {
    let mut files = Files::new();
    let functions = export["data"][0]["functions"]
        .as_array()
        .context("llvm-cov exports no functions")?;
    for function in functions {
        let regions = function["regions"].as_array().into_iter().flatten();
        for region in regions {
            let number = |i: usize| region[i].as_u64().unwrap_or(0);
            // The kind: 0 is code, the others are what is left out, or between.
            let (count, file, kind) = (number(4), number(5) as usize, number(7));
            let Some(name) = function["filenames"][file].as_str().and_then(ours) else {
                continue;
            };
            if kind == 0 {
                let ran = files
                    .entry(name)
                    .or_default()
                    .entry([0, 1, 2, 3].map(number))
                    .or_default();
                *ran |= count > 0;
            }
        }
    }
    Ok(files)
}

/// A file of the crates that count, as it is called in the project.
fn ours(file: &str) -> Option<String> {
    let path = Path::new(file).strip_prefix(root()).ok()?;
    let name = path.to_string_lossy().replace('\\', "/");
    CRATES.iter().any(|folder| name.starts_with(folder)).then_some(name)
}

fn report(files: &Files, list: bool) -> Result<()> {
    println!("{:<40}{:>9}{:>9}{:>10}{:>9}", "file", "lines", "", "regions", "");
    let mut short = Vec::new();
    for folder in CRATES {
        let (mut lines, mut regions) = (Share::default(), Share::default());
        for (name, all) in files.iter().filter(|(name, _)| name.starts_with(folder)) {
            let reached = Share::of(all.values().copied());
            let of_lines = lines_of(all);
            let shares = [Share::of(of_lines.values().copied()), reached];
            print_row(name, shares);
            lines = lines.and(shares[0]);
            regions = regions.and(reached);
            let missed: BTreeSet<u64> = all
                .iter()
                .filter(|(_, ran)| !**ran)
                .map(|(region, _)| region[0])
                .collect();
            if list && !missed.is_empty() {
                println!("    not reached from line {missed:?}");
            }
        }
        print_row(folder, [lines, regions]);
        if regions.percent() < LEAST {
            short.push(format!(
                "{folder}: {:.2} % of regions, must be {LEAST} %",
                regions.percent()
            ));
        }
    }
    ensure!(short.is_empty(), "{}", short.join("; "));
    Ok(())
}

fn print_row(name: &str, [lines, regions]: [Share; 2]) {
    let count = |share: Share| format!("{}/{}", share.reached, share.all);
    println!(
        "{name:<40}{:>9}{:>7.2} %{:>10}{:>7.2} %",
        count(lines),
        lines.percent(),
        count(regions),
        regions.percent()
    );
}

/// Each line in which a region begins, and whether all that begin there ran.
fn lines_of(regions: &BTreeMap<Region, bool>) -> BTreeMap<u64, bool> {
    let mut lines = BTreeMap::new();
    for (region, ran) in regions {
        *lines.entry(region[0]).or_insert(true) &= ran;
    }
    lines
}

/// How many of how many.
#[derive(Clone, Copy, Default)]
struct Share {
    reached: usize,
    all: usize,
}

impl Share {
    fn of(reached: impl Iterator<Item = bool>) -> Self {
        reached.fold(Self::default(), |share, reached| Self {
            reached: share.reached + usize::from(reached),
            all: share.all + 1,
        })
    }

    fn and(self, other: Self) -> Self {
        Self {
            reached: self.reached + other.reached,
            all: self.all + other.all,
        }
    }

    fn percent(self) -> f64 {
        100.0 * self.reached as f64 / self.all.max(1) as f64
    }
}

/// A tool of LLVM, of the compiler's own version: others cannot read what it writes.
fn tool(name: &str) -> Result<PathBuf> {
    let libraries = output(Command::new("rustc").args(["--print", "target-libdir"]))?;
    let path = Path::new(libraries.trim()).with_file_name("bin").join(name);
    if !fs::exists(&path)? {
        println!("{name} is missing: running `rustup component add llvm-tools`");
        process::run(Command::new("rustup").args(["component", "add", "llvm-tools"]))?;
    }
    Ok(path)
}
