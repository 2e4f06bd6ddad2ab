//! `cargo xtask fuzz`: the fuzz targets in `host-tests/fuzz`, by cargo-fuzz.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};
use std::sync::Mutex;
use std::thread;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::cargo::{target_dir, tool};
use crate::process::{self, output};
use crate::workspace::root;

/// Timeout of one input, in seconds: far longer than any takes, even on a machine that stalls for a while.
const TIMEOUT: u32 = 60;

/// Prefix of the inputs that are frames of the documents: `host-tests/tests/fuzz_corpus.rs` writes them.
const DOCUMENT: &str = "document-";

#[derive(Args)]
pub(crate) struct Options {
    /// Time that each target runs
    #[arg(long, value_name = "N", default_value_t = 60)]
    seconds: u32,

    /// The seed of the inputs; without it each run tries others
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    seed: u32,

    /// Reduce the corpus instead: of the committed inputs and those found since, keep as few as reach the same code
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

/// Runs the targets, or reduces their corpus, as many at a time as there are cores.
///
/// # Errors
///
/// If a target finds something, with the input that shows it; if there is no such target.
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
    process::run(&mut cargo_fuzz("build", "fuzz")?)?;
    if options.minimise {
        return for_each(targets, minimise).map(drop);
    }
    let clean = for_each(targets, |target| fuzz(target, options))?;
    let findings = clean.iter().filter(|clean| !**clean).count();
    ensure!(
        findings == 0,
        "{findings} of {} targets found something; docs/fuzzing.md says what to do",
        targets.len()
    );
    Ok(())
}

/// Runs a target for so many seconds, from this seed on. Prints libFuzzer's last status, or what it found; returns whether
/// it found nothing.
fn fuzz(target: &str, options: &Options) -> Result<bool> {
    let mut fuzz = cargo_fuzz("run", "fuzz")?;
    fuzz.arg(target).arg(found(target)?).arg(committed(target)).arg("--");
    fuzz.arg(format!("-max_total_time={}", options.seconds));
    fuzz.args([format!("-seed={}", options.seed), format!("-timeout={TIMEOUT}")]);
    let ran = fuzz.arg("-print_funcs=0").stdin(Stdio::null()).output()?;
    let said = String::from_utf8_lossy(&ran.stderr);
    let (status, rest): (Vec<_>, Vec<_>) = said.lines().partition(|line| line.starts_with('#'));
    match ran.status.success() {
        true => println!(
            "{target:<16}{}",
            status.iter().find(|line| line.contains("DONE")).unwrap_or(&"")
        ),
        false => eprintln!("{target}: {}", rest.join("\n")),
    }
    Ok(ran.status.success())
}

/// Makes the committed corpus of a target anew.
fn minimise(target: &str) -> Result<()> {
    let (found, committed) = (found(target)?, committed(target));
    let fresh = found.with_extension("fresh");
    let _ = fs::remove_dir_all(&fresh);
    fs::create_dir_all(&fresh)?;
    // The smallest set of inputs that reaches all edges of the fuzzed code, whatever the hit counts.
    let mut merge = cargo_fuzz("run", "fuzz")?;
    merge.arg(target).args([&fresh, &found, &committed]);
    output(merge.args(["--", "-set_cover_merge=1", "-use_counters=0", "-max_len=4096"]))?;
    // The frames of the documents stay, also where others reach the same code.
    for file in fs::read_dir(&committed)? {
        let file = file?;
        if !file.file_name().to_string_lossy().starts_with(DOCUMENT) {
            fs::remove_file(file.path())?;
        }
    }
    for file in fs::read_dir(&fresh)? {
        let file = file?;
        fs::copy(file.path(), committed.join(file.file_name()))?;
    }
    println!("{target:<16}{:>6} files", fs::read_dir(&committed)?.count());
    Ok(())
}

/// `cargo fuzz <subcommand>`, which builds into this folder of the target directory. Stable compilers have no sanitizer,
/// and the crates that are fuzzed have no `unsafe` for it to find something in.
pub(crate) fn cargo_fuzz(subcommand: &str, folder: &str) -> Result<Command> {
    let mut fuzz = tool(&format!("fuzz {subcommand} --sanitizer none --target-dir"))?;
    fuzz.arg(target_dir()?.join(folder)).current_dir(project());
    Ok(fuzz)
}

/// The names of all targets.
pub(crate) fn targets() -> Result<Vec<String>> {
    let list = output(tool("fuzz list")?.current_dir(project()))?;
    Ok(list.lines().map(str::to_owned).collect())
}

/// The corpus of a target that is part of the project.
pub(crate) fn committed(target: &str) -> PathBuf {
    project().join("corpus").join(target)
}

fn project() -> PathBuf {
    root().join("host-tests/fuzz")
}

/// Folder of a target's inputs that reached new code.
fn found(target: &str) -> Result<PathBuf> {
    let found = target_dir()?.join("fuzz/corpus").join(target);
    fs::create_dir_all(&found)?;
    Ok(found)
}

/// Does something with each target, as many at a time as there are cores, and returns what came of each.
pub(crate) fn for_each<T: Send>(targets: &[String], act: impl Fn(&str) -> Result<T> + Sync) -> Result<Vec<T>> {
    let cores = thread::available_parallelism().map_or(1, usize::from);
    let rest = Mutex::new(targets.iter());
    let next = || rest.lock().expect("nobody panics with it").next();
    let work = || -> Vec<Result<T>> {
        let results = std::iter::from_fn(next).map(|target| act(target).context(target.clone()));
        results.collect()
    };
    thread::scope(|scope| {
        let workers: Vec<_> = (0..cores).map(|_| scope.spawn(work)).collect();
        let results = workers
            .into_iter()
            .flat_map(|worker| worker.join().expect("no worker panics"));
        results.collect()
    })
}
