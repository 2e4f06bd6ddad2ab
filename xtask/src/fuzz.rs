//! `cargo xtask fuzz`: the fuzz targets in `host-tests/fuzz`, by cargo-fuzz.

use std::fs;
use std::path::PathBuf;
use std::process::{Command, Stdio};

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::cargo::{cargo, target_dir, tool};
use crate::parallel::for_each;
use crate::process::{self, output};
use crate::workspace::root;

/// Timeout of one input, in seconds: far more than any input needs on a busy machine.
const TIMEOUT: u32 = 60;

/// The targets' folder in the target directory: their flags would make cargo build the rest anew.
const FOLDER: &str = "fuzz";

/// Prefix of inputs with frames of the documents or files of every format, written by `host-tests/tests/fuzz_corpus.rs`.
const DOCUMENT: &str = "document-";

#[derive(Args)]
pub(crate) struct Options {
    /// Duration of each target, in seconds
    #[arg(long, value_name = "N", default_value_t = 60)]
    seconds: u32,

    /// Seed of the inputs, by default a different one in each run
    #[arg(long, value_name = "N", default_value_t = 0, hide_default_value = true)]
    seed: u32,

    /// Instead, reduce the committed and the new inputs to the fewest with the same coverage
    #[arg(long)]
    minimise: bool,

    /// The targets, by default all
    targets: Vec<String>,
}

impl Options {
    /// Every target for this many seconds.
    pub(crate) fn new(seconds: u32, seed: u32) -> Self {
        Self {
            seconds,
            seed,
            minimise: false,
            targets: Vec::new(),
        }
    }
}

/// Runs the targets, or reduces their corpus, one per core at a time.
///
/// # Errors
///
/// If a target fails, with its input; if there is no such target.
pub(crate) fn run(options: &Options) -> Result<()> {
    let all = targets()?;
    let targets = match &*options.targets {
        [] => &all,
        some => some,
    };
    for target in targets {
        ensure!(
            all.contains(target),
            "no target `{target}`; the targets are {}",
            all.join(", ")
        );
    }
    build()?;
    if options.minimise {
        return for_each(targets, |target| minimise(target).context(target.clone())).map(drop);
    }
    let passed = for_each(targets, |target| fuzz(target, options).context(target.clone()))?;
    let failures = passed.iter().filter(|passed| !**passed).count();
    ensure!(
        failures == 0,
        "{failures} of {} targets failed; docs/fuzzing.md has the next steps",
        targets.len()
    );
    Ok(())
}

/// Runs a target. Prints libFuzzer's last status, or its failure. Returns true if the target passed.
fn fuzz(target: &str, options: &Options) -> Result<bool> {
    let mut fuzz = cargo_fuzz("run")?;
    fuzz.arg(target).arg(found(target)?).arg(committed(target)).arg("--");
    fuzz.arg(format!("-max_total_time={}", options.seconds));
    fuzz.args([format!("-seed={}", options.seed), format!("-timeout={TIMEOUT}")]);
    let ran = fuzz.arg("-print_funcs=0").stdin(Stdio::null()).output()?;
    let text = String::from_utf8_lossy(&ran.stderr);
    let (status, rest): (Vec<_>, Vec<_>) = text.lines().partition(|line| line.starts_with('#'));
    match ran.status.success() {
        true => println!(
            "{target:<16}{}",
            status.iter().find(|line| line.contains("DONE")).unwrap_or(&"")
        ),
        false => eprintln!("{target}: {}", rest.join("\n")),
    }
    Ok(ran.status.success())
}

/// Replaces the committed corpus of a target by the reduced one.
fn minimise(target: &str) -> Result<()> {
    let (found, committed) = (found(target)?, committed(target));
    let fresh = found.with_extension("fresh");
    let _ = fs::remove_dir_all(&fresh);
    fs::create_dir_all(&fresh)?;
    // The smallest set of inputs with the same edge coverage, regardless of hit counts.
    let mut merge = cargo_fuzz("run")?;
    merge.arg(target).args([&fresh, &found, &committed]);
    output(merge.args(["--", "-set_cover_merge=1", "-use_counters=0", "-max_len=4096"]))?;
    // The frames of the documents stay.
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

/// Builds all targets.
pub(crate) fn build() -> Result<()> {
    process::run(&mut cargo_fuzz("build")?)
}

/// Clippy on all targets. It uses the macros and build scripts of [`build`].
pub(crate) fn clippy() -> Result<Command> {
    let mut clippy = cargo("clippy --all-targets --release --target host-tuple --target-dir");
    clippy.arg(target_dir()?.join(FOLDER)).args(["--", "-D", "warnings"]);
    clippy.current_dir(project());
    Ok(clippy)
}

/// `cargo fuzz <subcommand>`. It uses no sanitizer: stable compilers have none, and the fuzzed crates have no `unsafe`.
/// Every build measures coverage, so that `cargo xtask coverage` needs none of its own. The targets are nearly as fast.
fn cargo_fuzz(subcommand: &str) -> Result<Command> {
    let mut fuzz = tool(&format!("fuzz {subcommand} --sanitizer none --target-dir"))?;
    fuzz.arg(target_dir()?.join(FOLDER)).current_dir(project());
    fuzz.env("RUSTFLAGS", "-Cinstrument-coverage")
        .env("LLVM_PROFILE_FILE", "/dev/null");
    Ok(fuzz)
}

/// The folder of the built targets.
pub(crate) fn programs() -> Result<PathBuf> {
    let host = output(Command::new("rustc").args(["--print", "host-tuple"]))?;
    Ok(target_dir()?.join(FOLDER).join(host.trim()).join("release"))
}

/// The names of all targets.
pub(crate) fn targets() -> Result<Vec<String>> {
    let list = output(tool("fuzz list")?.current_dir(project()))?;
    Ok(list.lines().map(str::to_owned).collect())
}

/// The committed corpus of a target.
pub(crate) fn committed(target: &str) -> PathBuf {
    project().join("corpus").join(target)
}

fn project() -> PathBuf {
    root().join("host-tests/fuzz")
}

/// Folder of new inputs of a target, which reached new code.
fn found(target: &str) -> Result<PathBuf> {
    let found = target_dir()?.join(FOLDER).join("corpus").join(target);
    fs::create_dir_all(&found)?;
    Ok(found)
}
