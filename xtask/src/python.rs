//! `cargo xtask python` and `cargo xtask lerobot`: the package for Python and its plugin for LeRobot.

use std::env;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::Args;

use crate::board::Board;
use crate::cargo::{cargo, forget_our_package, target_dir};
use crate::process::{output, run};
use crate::vendor::served::ServedBoard;
use crate::venv;
use crate::workspace::root;

/// Maximum size of the wheel, in bytes.
const MAX_WHEEL: u64 = 1_000_000;
/// The oldest system that the wheel is for: the one that Rust's own library asks for.
const MANYLINUX: &str = "manylinux_2_17";
/// The packages that the wheel's tests need, at the versions of `requirements-dev.txt`.
const TEST_PACKAGES: [&str; 3] = ["matplotlib", "numpy", "pytest"];
/// The vendor's SDK without its dependencies, which include all of PyTorch, but with what is needed of these.
const SDK: [&str; 2] = ["alicia_d_sdk==6.1.0", "pyserial==3.5"];
/// LeRobot, and the Python that it needs.
const LEROBOT: &str = "lerobot[dataset]==0.6.1";
const LEROBOT_PYTHON: &str = "python3.12";

#[derive(Args, Default)]
pub(crate) struct Options {
    /// Number of reads over lines with faults; 100000 take minutes
    #[arg(long, value_name = "N")]
    reads: Option<u32>,
}

/// Checks the sources, builds the wheel and the source distribution, tests the wheel in a clean environment, and compares it
/// with the vendor's SDK.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    let dir = target_dir()?.join("python-checks");
    fs::create_dir_all(&dir)?;
    let tools = Environment::with_requirements(&dir.join("tools"), &[])?;
    check_sources(&tools, &dir)?;
    let wheel = build_wheel(&tools, &dir)?;
    check_wheel(&tools, &wheel)?;
    check_sdist(&tools, &dir)?;
    let clean = Environment::with_requirements(&dir.join("clean"), &TEST_PACKAGES)?;
    clean.install(
        &["--no-deps", "--force-reinstall"],
        &[wheel.as_os_str().to_str().context("a path in UTF-8")?],
    )?;
    test(&clean, &dir, options)?;
    clean.install(&["--no-deps"], &SDK)?;
    let compare = python_dir().join("benchmarks/beside_sdk.py");
    let (armwire, scripts) = (clean.dir.join("bin/armwire"), root().join("host-tests/vendor"));
    run(clean.python().arg(compare).arg(armwire).arg(scripts).current_dir(&dir))
}

/// Installs LeRobot, runs the plugin's tests with it, and teleoperates and records with its programs.
///
/// # Errors
///
/// If Python 3.12 is missing, an installation fails, or a check does.
pub(crate) fn run_lerobot() -> Result<()> {
    let version = output(Command::new(LEROBOT_PYTHON).arg("--version"));
    let python = version
        .map(|_| PathBuf::from(LEROBOT_PYTHON))
        .or_else(|_| pyenv_python())?;
    let dir = target_dir()?.join("lerobot");
    fs::create_dir_all(&dir)?;
    println!("installing {LEROBOT}, which takes 5 GB");
    let environment = Environment::new(&python, &dir.join("python"))?;
    environment.install(&[], &[LEROBOT, "maturin>=1.9,<2", "pytest"])?;
    // The tests run beside the sources: the plugin is installed from a copy, where its build may write.
    let plugin = dir.join("plugin");
    if plugin.exists() {
        fs::remove_dir_all(&plugin)?;
    }
    run(Command::new("cp")
        .arg("-r")
        .arg(python_dir().join("lerobot_plugin"))
        .arg(&plugin))?;
    let package = python_dir();
    let [package, plugin] = [&package, &plugin].map(|path| path.to_string_lossy().into_owned());
    environment.install(&["--no-deps", "--force-reinstall"], &[&package, &plugin])?;
    run(environment.pytest(&dir).arg("tests/test_lerobot.py"))?;
    let mut record = environment.python();
    record
        .arg(python_dir().join("lerobot_plugin/checks/record.py"))
        .arg(&dir);
    run(record.env("HF_HOME", dir.join("home")).current_dir(&dir))
}

/// The Python 3.12 of pyenv, where its shims point to another one.
fn pyenv_python() -> Result<PathBuf> {
    let needed = "LeRobot needs Python 3.12 as `python3.12`, with `venv`, and PyPI";
    let versions = Path::new(&env::var_os("HOME").context(needed)?).join(".pyenv/versions");
    let mut pythons = fs::read_dir(versions)
        .context(needed)?
        .flatten()
        .map(|version| version.path());
    let python = pythons.find(|path| {
        path.file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with("3.12."))
    });
    Ok(python.context(needed)?.join("bin/python3"))
}

fn python_dir() -> PathBuf {
    root().join("python")
}

/// A virtual environment.
struct Environment {
    dir: PathBuf,
}

impl Environment {
    /// The environment in this folder, made if it is missing or not whole.
    fn new(python: &Path, dir: &Path) -> Result<Self> {
        venv::make(python, dir)?;
        Ok(Self { dir: dir.to_owned() })
    }

    /// One with these packages of `requirements-dev.txt`, or with all if none are named.
    fn with_requirements(dir: &Path, packages: &[&str]) -> Result<Self> {
        let environment = Self::new(Path::new("python3"), dir)?;
        let file = python_dir().join("requirements-dev.txt");
        if packages.is_empty() {
            environment.install(&["--requirement", &file.to_string_lossy()], &[])?;
            return Ok(environment);
        }
        let text = fs::read_to_string(file)?;
        let is_wanted = |line: &&str| line.split_once("==").is_some_and(|(name, _)| packages.contains(&name));
        let wanted: Vec<_> = text.lines().filter(is_wanted).collect();
        ensure!(
            wanted.len() == packages.len(),
            "requirements-dev.txt lacks one of {packages:?}"
        );
        environment.install(&[], &wanted)?;
        Ok(environment)
    }

    fn install(&self, options: &[&str], packages: &[&str]) -> Result<()> {
        let mut pip = self.python();
        pip.args(["-m", "pip", "install", "--quiet", "--disable-pip-version-check"]);
        run(pip.args(options).args(packages))
    }

    fn python(&self) -> Command {
        let mut python = Command::new(self.dir.join("bin/python"));
        forget_our_package(&mut python);
        // Nothing is to be written beside the sources.
        python.arg("-B");
        python
    }

    /// A tool of this environment, in the folder of the package, with the environment's others on its path.
    fn tool(&self, name: &str) -> Result<Command> {
        let bin = self.dir.join("bin");
        let mut tool = Command::new(bin.join(name));
        let path = env::var_os("PATH").unwrap_or_default();
        tool.env(
            "PATH",
            env::join_paths([bin].into_iter().chain(env::split_paths(&path)))?,
        );
        tool.env("VIRTUAL_ENV", &self.dir).current_dir(python_dir());
        forget_our_package(&mut tool);
        Ok(tool)
    }

    /// pytest, in the folder of the package but with nothing written there.
    fn pytest(&self, home: &Path) -> Command {
        let mut pytest = self.python();
        pytest.args(["-P", "-m", "pytest", "-p", "no:cacheprovider"]);
        pytest.env("HF_HOME", home.join("home")).current_dir(python_dir());
        pytest
    }
}

/// Builds the wheel as it is released.
fn build_wheel(tools: &Environment, dir: &Path) -> Result<PathBuf> {
    let wheels = dir.join("wheels");
    if wheels.exists() {
        fs::remove_dir_all(&wheels)?;
    }
    let mut build = tools.tool("maturin")?;
    build.args([
        "build",
        "--quiet",
        "--locked",
        "--zig",
        "--compatibility",
        MANYLINUX,
        "--compression-level",
        "9",
        "--out",
    ]);
    println!("building the wheel, which takes minutes the first time");
    run(build.arg(&wheels))?;
    let mut built = fs::read_dir(&wheels)?;
    let wheel = built.next().context("maturin built no wheel")??.path();
    Ok(wheel)
}

/// Linters and type checkers have nothing to say.
fn check_sources(tools: &Environment, dir: &Path) -> Result<()> {
    // The decoder for sigrok is checked here, too, with rules of its own.
    run(tools.tool("ruff")?.args(["check", "--no-cache", ".", "../tools"]))?;
    run(tools
        .tool("ruff")?
        .args(["format", "--no-cache", "--check", ".", "../tools"]))?;
    let cache = dir.join("mypy");
    let mypy = |paths: &str, words: &str| -> Result<()> {
        let mut mypy = tools.tool("mypy")?;
        mypy.env("MYPYPATH", paths)
            .arg("--cache-dir")
            .arg(&cache)
            .args(words.split(' '));
        run(&mut mypy)
    };
    let mut tests = Vec::new();
    for file in fs::read_dir(python_dir().join("tests"))? {
        let name = file?.file_name().to_string_lossy().into_owned();
        if name.ends_with(".py") {
            tests.push(format!("tests/{name}"));
        }
    }
    mypy(
        "python",
        &format!("python/armwire examples benchmarks {}", tests.join(" ")),
    )?;
    // LeRobot's own types need LeRobot.
    mypy(
        "python:tests/lerobot_stand_in:lerobot_plugin",
        "--python-version 3.12 -p lerobot_robot_alicia_d_armwire",
    )?;
    let python = tools.dir.join("bin/python");
    run(tools
        .tool("pyright")?
        .arg("--pythonpath")
        .arg(python)
        .arg("python/armwire"))
}

/// The wheel is small, and for old systems, too.
fn check_wheel(tools: &Environment, wheel: &Path) -> Result<()> {
    let size = fs::metadata(wheel)?.len();
    let name = wheel.file_name().unwrap_or_default().to_string_lossy();
    println!("{name}: {size} bytes of {MAX_WHEEL}");
    ensure!(size <= MAX_WHEEL, "the wheel is too big");
    let shown = output(tools.tool("auditwheel")?.arg("show").arg(wheel))?;
    println!("{}", shown.trim());
    ensure!(shown.contains(MANYLINUX), "the wheel is not for {MANYLINUX}");
    Ok(())
}

/// The source distribution has all that a build needs.
fn check_sdist(tools: &Environment, dir: &Path) -> Result<()> {
    let sources = dir.join("sdist");
    if sources.exists() {
        fs::remove_dir_all(&sources)?;
    }
    run(tools.tool("maturin")?.args(["sdist", "--out"]).arg(&sources))?;
    let archive = fs::read_dir(&sources)?
        .next()
        .context("maturin made no source distribution")??
        .path();
    run(Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(&sources))?;
    let mut folders = fs::read_dir(&sources)?.flatten().map(|entry| entry.path());
    let folder = folders
        .find(|path| path.is_dir())
        .context("an empty source distribution")?;
    let mut check = cargo("check --quiet --package armwire-python");
    // With the dependencies that are built there.
    run(check.current_dir(folder).env("CARGO_TARGET_DIR", target_dir()?))
}

/// Runs the tests, the examples among them, with virtual arms, and with the firmware images on virtual boards.
fn test(clean: &Environment, dir: &Path, options: &Options) -> Result<()> {
    let board = ServedBoard::start(dir)?;
    let mut pytest = clean.pytest(dir);
    pytest.arg("--durations=5").env("ARMWIRE_BOARD", dir);
    if let Some(reads) = options.reads {
        // The counts and times of the reads are printed.
        pytest.arg("-rP").env("ARMWIRE_READS", reads.to_string());
    }
    run(&mut pytest)?;
    board.end()?;
    let board = Board::Stm32g431;
    let served = ServedBoard::start_board(dir, board)?;
    let mut pytest = clean.pytest(dir);
    pytest
        .arg("tests/test_board.py")
        .env("ARMWIRE_BOARD", dir)
        .env("ARMWIRE_BOARD_NAME", board.name());
    run(&mut pytest)?;
    served.end()
}
