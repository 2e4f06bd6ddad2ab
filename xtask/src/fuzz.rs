//! `cargo xtask fuzz`: the fuzz targets in `host-tests/fuzz`, each for a fixed time.
//!
//! A fuzz target is an ordinary program with libFuzzer in it, so no cargo-fuzz and no nightly compiler is needed: the
//! compiler's passes that count what runs are in the stable one. What they do not have is a sanitizer, and the crates that
//! are fuzzed have no `unsafe` for it to find something in.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::cargo::{cargo, target_dir};
use crate::process::{self, output};
use crate::workspace::root;

/// What libFuzzer needs to see, as cargo-fuzz has it.
pub(crate) const COUNTERS: &str = "--cfg fuzzing -Cpasses=sancov-module \
    -Cllvm-args=-sanitizer-coverage-level=4 \
    -Cllvm-args=-sanitizer-coverage-inline-8bit-counters \
    -Cllvm-args=-sanitizer-coverage-pc-table \
    -Cllvm-args=-sanitizer-coverage-trace-compares";

/// How long one input may take, in seconds: far longer than any does, also on a machine that stands still for a while.
const TIMEOUT: u32 = 60;

/// What the names of inputs begin with that are frames of the documents: `host-tests/tests/fuzz_corpus.rs` writes them.
const DOCUMENT: &str = "document-";

#[derive(Args)]
pub(crate) struct Options {
    /// How long each target runs
    #[arg(long, value_name = "N", default_value_t = 60)]
    seconds: u32,

    /// The seed of the inputs; without it each run tries others
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    seed: u32,

    /// Make the committed corpus anew instead: of the vectors in the protocol's
    /// sources, the committed inputs and those found since, as few as reach the
    /// same code
    #[arg(long)]
    minimise: bool,

    /// The targets; all without this argument
    targets: Vec<String>,
}

impl Options {
    /// Every target for so many seconds.
    pub(crate) fn new(seconds: u32, seed: u32) -> Self {
        Self {
            seconds,
            seed,
            minimise: false,
            targets: Vec::new(),
        }
    }
}

/// Runs the targets, as many at a time as there are cores, and prints a table of what came of it.
///
/// # Errors
///
/// If a target finds something; with where the input is that shows it.
pub(crate) fn run(options: &Options) -> Result<()> {
    let all = targets()?;
    let targets = match &*options.targets {
        [] => &all,
        some => some,
    };
    for target in targets {
        ensure!(
            all.contains(target),
            "no target `{target}`, there are {}",
            all.join(", ")
        );
    }
    let programs = build(COUNTERS, "fuzz")?;
    if options.minimise {
        let vectors = vectors()?;
        return for_each(targets, |target| minimise(&programs, target, &vectors)).map(drop);
    }
    let runs = for_each(targets, |target| fuzz(&programs, target, options))?;
    println!(
        "{:<16}{:>12}{:>10}{:>10}  result",
        "target", "executions", "features", "inputs"
    );
    for run in &runs {
        println!(
            "{:<16}{:>12}{:>10}{:>10}  {}",
            run.target,
            run.executions,
            run.features,
            run.inputs,
            run.result()
        );
    }
    let findings = runs.iter().filter(|run| run.finding.is_some()).count();
    ensure!(
        findings == 0,
        "{findings} of {} targets found something; docs/fuzzing.md says what to do",
        runs.len()
    );
    Ok(())
}

/// What came of one target.
struct Run {
    target: String,
    executions: String,
    /// What libFuzzer tells apart in the code, and in how many inputs.
    features: String,
    inputs: String,
    /// The input that shows something, or what was said in its place.
    finding: Option<String>,
}

impl Run {
    fn result(&self) -> &str {
        self.finding.as_deref().unwrap_or("nothing found")
    }
}

/// Runs a target for so many seconds, from this seed on.
fn fuzz(programs: &Path, target: &str, options: &Options) -> Result<Run> {
    let found = found(target)?;
    let artifacts = folder().join("artifacts").join(target);
    fs::create_dir_all(&artifacts)?;
    let mut fuzzer = libfuzzer(programs, target);
    fuzzer
        .arg(format!("-max_total_time={}", options.seconds))
        .arg(format!("-seed={}", options.seed))
        .arg(format!("-timeout={TIMEOUT}"))
        .arg("-print_final_stats=1")
        .arg(format!("-artifact_prefix={}/", artifacts.display()))
        .arg(found)
        .arg(committed(target));
    let ran = fuzzer.stdin(Stdio::null()).output()?;
    let said = String::from_utf8_lossy(&ran.stderr);
    let status = said
        .lines()
        .rev()
        .find(|line| line.contains(" ft: "))
        .unwrap_or_default();
    let word_after = |text: &str, what: &str| {
        let (_, rest) = text.split_once(what)?;
        rest.split_whitespace().next().map(str::to_owned)
    };
    let finding = (!ran.status.success()).then(|| {
        let panic = said.lines().skip_while(|line| !line.contains("panicked at")).take(4);
        let panic: Vec<_> = panic.collect();
        // Where the file is lost with the machine, the input is here.
        let input = said.lines().find(|line| line.starts_with("Base64: "));
        eprintln!("{target}: {}\n{}", panic.join("\n"), input.unwrap_or_default());
        word_after(&said, "Test unit written to ").unwrap_or_else(|| format!("{}: {}", ran.status, said.trim_end()))
    });
    let number = |text: &str, what: &str| word_after(text, what).unwrap_or_else(|| "?".to_owned());
    Ok(Run {
        target: target.to_owned(),
        executions: number(&said, "stat::number_of_executed_units:"),
        features: number(status, " ft: "),
        inputs: number(status, " corp: ")
            .split('/')
            .next()
            .unwrap_or_default()
            .to_owned(),
        finding,
    })
}

/// Makes the committed corpus of a target anew.
fn minimise(programs: &Path, target: &str, vectors: &BTreeSet<Vec<u8>>) -> Result<()> {
    let found = found(target)?;
    for (i, seed) in vectors.iter().flat_map(|vector| seeds(target, vector)).enumerate() {
        fs::write(found.join(format!("vector-{i}")), seed)?;
    }
    let fresh = found.with_extension("fresh");
    let _ = fs::remove_dir_all(&fresh);
    fs::create_dir_all(&fresh)?;
    // As few inputs as reach all edges of the code that is fuzzed; how often they do is no reason to keep one.
    let mut merge = libfuzzer(programs, target);
    merge.args(["-set_cover_merge=1", "-use_counters=0", "-max_len=4096"]);
    output(merge.arg(&fresh).arg(&found).arg(committed(target)))?;
    // The frames of the documents stay, also where others reach the same code.
    for file in fs::read_dir(committed(target))? {
        let file = file?;
        if !file.file_name().to_string_lossy().starts_with(DOCUMENT) {
            fs::remove_file(file.path())?;
        }
    }
    for file in fs::read_dir(&fresh)? {
        let file = file?;
        fs::copy(file.path(), committed(target).join(file.file_name()))?;
    }
    let (files, bytes) = size(&committed(target))?;
    println!("{target:<16}{files:>6} files {bytes:>8} bytes");
    Ok(())
}

fn size(folder: &Path) -> Result<(usize, u64)> {
    let (mut files, mut bytes) = (0, 0);
    for file in fs::read_dir(folder)? {
        files += 1;
        bytes += file?.metadata()?.len();
    }
    Ok((files, bytes))
}

/// Every sequence of four bytes or more that is written out in the protocols' sources: the documents' examples among them.
fn vectors() -> Result<BTreeSet<Vec<u8>>> {
    let mut vectors = BTreeSet::new();
    let mut folders = vec![root().join("protocol")];
    while let Some(folder) = folders.pop() {
        for entry in fs::read_dir(folder)? {
            let path = entry?.path();
            if path.is_dir() {
                folders.push(path);
            } else if path.extension().is_some_and(|extension| extension == "rs") {
                let source = fs::read_to_string(path)?;
                vectors.extend(source.split(['[', ']', '(', ')', ';']).filter_map(bytes_in));
            }
        }
    }
    Ok(vectors)
}

/// The bytes that a list is of, if it is one.
fn bytes_in(list: &str) -> Option<Vec<u8>> {
    let words = list.split(',').map(|word| word.trim().trim_start_matches("///").trim());
    let byte = |word: &str| match word.strip_prefix("0x") {
        Some(digits) => u8::from_str_radix(digits, 16).ok(),
        None => word.parse().ok(),
    };
    let bytes: Option<Vec<u8>> = words.filter(|word| !word.is_empty()).map(byte).collect();
    bytes.filter(|bytes| bytes.len() >= 4)
}

/// A vector as inputs to a target that takes bytes of a line; none for the others, which make messages of their own.
fn seeds(target: &str, vector: &[u8]) -> Vec<Vec<u8>> {
    let line = |start: &[u8], end: &[u8]| [start, vector, end].concat();
    // First the protocol, then what the reader expects, where there is a choice.
    let starts: [&[u8]; 6] = [&[0], &[1], &[2, 0], &[2, 1], &[3, 0], &[3, 1]];
    match target {
        "decode" => starts.iter().map(|start| line(start, &[])).collect(),
        // The last byte says how many cuts there are.
        "split" => starts.iter().map(|start| line(start, &[0])).collect(),
        "armwire_decode" => {
            let hex: String = vector.iter().map(|byte| format!("{byte:02X}")).collect();
            let text = |arm: u8, text: String| [&[arm], text.as_bytes()].concat();
            let frames = vector
                .chunks(7)
                .map(|part| part.iter().map(|byte| format!("{byte:02X}")).collect::<String>());
            let log: String = frames
                .enumerate()
                .map(|(i, data)| format!("(1.{i:06}) can0 603#07{data}\n"))
                .collect();
            let raw = (0..9).map(|kind| line(&[kind], &[]));
            raw.chain([text(0, hex), text(0, log.clone()), text(2, log)]).collect()
        }
        _ => Vec::new(),
    }
}

/// Builds the targets with these flags of the compiler, and returns the folder that they are in.
pub(crate) fn build(flags: &str, name: &str) -> Result<PathBuf> {
    let host = host()?;
    let target_dir = target_dir()?.join(name);
    process::run(
        // With a target named, the flags are not for build scripts and procedural macros.
        cargo(&format!("build --release --bins --target {host} --target-dir"))
            .arg(&target_dir)
            .env("RUSTFLAGS", flags)
            .current_dir(folder()),
    )?;
    Ok(target_dir.join(host).join("release"))
}

/// The kind of machine that this is.
fn host() -> Result<String> {
    Ok(output(Command::new("rustc").args(["--print", "host-tuple"]))?
        .trim()
        .to_owned())
}

/// A target, ready to be told what to do.
pub(crate) fn libfuzzer(programs: &Path, target: &str) -> Command {
    Command::new(programs.join(target))
}

/// The names of all targets.
pub(crate) fn targets() -> Result<Vec<String>> {
    let mut targets = Vec::new();
    for file in fs::read_dir(folder().join("fuzz_targets"))? {
        let path = file?.path();
        targets.extend(path.file_stem().map(|name| name.to_string_lossy().into_owned()));
    }
    targets.sort();
    Ok(targets)
}

fn folder() -> PathBuf {
    root().join("host-tests/fuzz")
}

/// The corpus of a target that is part of the project.
pub(crate) fn committed(target: &str) -> PathBuf {
    folder().join("corpus").join(target)
}

/// Where inputs of a target are kept that reached something new.
fn found(target: &str) -> Result<PathBuf> {
    let found = target_dir()?.join("fuzz/corpus").join(target);
    fs::create_dir_all(&found)?;
    fs::create_dir_all(committed(target))?;
    Ok(found)
}

/// Does something with each target, as many at a time as there are cores, and returns what came of each, in their order.
pub(crate) fn for_each<T: Send>(targets: &[String], act: impl Fn(&str) -> Result<T> + Sync) -> Result<Vec<T>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let rest = Mutex::new(targets.iter().enumerate());
    let done = Mutex::new(Vec::new());
    thread::scope(|scope| {
        for _ in 0..cores.min(targets.len()) {
            scope.spawn(|| {
                loop {
                    let next = rest.lock().expect("nobody panics with it").next();
                    let Some((place, target)) = next else { return };
                    let result = act(target).with_context(|| target.to_owned());
                    done.lock().expect("nobody panics with it").push((place, result));
                }
            });
        }
    });
    let mut done = done.into_inner().expect("nobody panicked with it");
    done.sort_by_key(|(place, _)| *place);
    done.into_iter().map(|(_, result)| result).collect()
}
