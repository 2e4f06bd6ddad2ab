//! The trial of a release: its archives, used without Rust, those for other systems by an emulator.

use std::ffi::OsStr;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Context, Result, ensure};

use super::folder::archive_of;
use super::release::Release;
use super::system::{HERE, SYSTEMS, System};
use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::files::{empty_folder, only_entry};
use crate::platforms::emulator::Emulator;
use crate::platforms::python::Arm64Python;
use crate::platforms::{self, Platform};
use crate::process::run;
use crate::venv::Environment;
use crate::web;
use crate::workspace::root;

/// The search path of a machine without Rust.
const PATH: &str = "/usr/bin:/bin";
/// A program of the release that moves virtual arms.
const PROGRAM: &str = "without_hardware.py";
/// Test of the plugins for LeRobot, and the files of the repository that it needs. LeRobot takes 5 GB: its stand-in is one of
/// them.
const PLUGINS_TEST: &str = "test_lerobot.py";
const ITS_FILES: [&str; 7] = [
    "python/tests/test_lerobot.py",
    "python/tests/test_foreign.py",
    "python/tests/conftest.py",
    "python/tests/scripted.py",
    "python/tests/lerobot_stand_in",
    "protocol/tests/bessica.bin",
    "protocol/tests/effects.txt",
];
/// The packages of the wheels.
const PACKAGES: [&str; 3] = [
    "armwire",
    "lerobot_robot_alicia_d_armwire",
    "lerobot_teleoperator_alicia_d_leader_armwire",
];
/// A check that these packages have both licences.
const HAVE_LICENCES: &str = "\
import importlib.metadata, sys
for package in sys.argv[1:]:
    missing = {'LICENSE-APACHE', 'LICENSE-MIT'} - {file.name for file in importlib.metadata.files(package)}
    if missing:
        sys.exit(f'{package} lacks {missing}')
";

/// Unpacks each archive, checks its files, uses the command, links a program in C, and moves virtual arms with the wheel. On
/// this machine it also uses the plugins for LeRobot, and opens the page.
///
/// # Errors
///
/// The first of them that fails.
pub(super) fn run_all(release: &Release) -> Result<()> {
    apt::require(&platforms::TOOLS)?;
    // Each does as one that cargo builds.
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let platforms = platforms::all(&target_dir()?.join("platforms"))?;
    let trials = release.dist.join("trial");
    for system in SYSTEMS {
        let folder = trials.join(system.target);
        let unpacked = unpack(&archive_of(&release.folder(system)), &folder)?;
        if system.target == HERE.target {
            try_here(system, &unpacked, &folder)?;
            continue;
        }
        let platform = platforms.iter().find(|platform| platform.target == system.target);
        let platform = platform.with_context(|| format!("no emulator runs {}", system.target))?;
        try_emulated(system, platform, &unpacked, &folder)?;
    }
    Ok(())
}

/// Unpacks an archive into a folder of its own, and checks the files.
fn unpack(archive: &Path, folder: &Path) -> Result<PathBuf> {
    empty_folder(folder)?;
    run(Command::new("tar").arg("-xzf").arg(archive).arg("-C").arg(folder))?;
    let unpacked = only_entry(folder)?;
    let mut check = Command::new("sha256sum");
    check.args(["--check", "--quiet", "SHA256SUMS"]);
    run(check.current_dir(&unpacked))?;
    check_links(&unpacked)?;
    Ok(unpacked)
}

/// Uses the archive for this machine.
fn try_here(system: System, unpacked: &Path, folder: &Path) -> Result<()> {
    platforms::trial::run_all(&unpacked.join("bin").join(system.program()), &Emulator::none(), folder)?;
    try_library("cc", system, unpacked, folder)?;
    try_wheels(&unpacked.join("python"), folder)?;
    web::test_page(&unpacked.join("web"))
}

/// Uses the archive for another system.
fn try_emulated(system: System, platform: &Platform, unpacked: &Path, folder: &Path) -> Result<()> {
    let program = unpacked.join("bin").join(system.program());
    platforms::trial::run_all(&program, &platform.emulator, folder)?;
    if system.is_linux() {
        try_library(platform.gcc, system, unpacked, folder)?;
    }
    if system.has_wheel() {
        let (package, _) = wheels(&unpacked.join("python"))?;
        let mut pytest = Arm64Python::with_wheel(&package)?.command();
        pytest.args(["-m", "pytest", "-q", PROGRAM]);
        run(pytest.current_dir(unpacked.join("python/examples")))?;
    }
    Ok(())
}

/// Checks that README links to nothing that the release lacks.
fn check_links(release: &Path) -> Result<()> {
    let readme = fs::read_to_string(release.join("README.md"))?;
    let links = readme
        .split("](")
        .skip(1)
        .filter_map(|rest| rest.split([')', '#']).next());
    for link in links.filter(|link| !link.is_empty() && !link.contains("://")) {
        ensure!(release.join(link).exists(), "README.md: the release lacks {link}");
    }
    Ok(())
}

/// Links the example in C with the library for this system.
fn try_library(gcc: &str, system: System, unpacked: &Path, folder: &Path) -> Result<()> {
    let library = Path::new("c/lib").join(system.target).join("libarmwire_c.a");
    let mut link = Command::new(gcc);
    link.args(["-Ic/include", "examples/c/serial.c"]).arg(library);
    run(link.arg("-o").arg(folder.join("serial")).current_dir(unpacked))
}

fn try_wheels(python: &Path, folder: &Path) -> Result<()> {
    let (package, plugins) = wheels(python)?;
    let environment = Environment::new("python3", folder.join("env"))?;
    environment.install([package.as_os_str(), OsStr::new("pytest")])?;
    run(environment.tool("armwire").arg("--version").env("PATH", PATH))?;
    run(&mut pytest(&environment, &python.join("examples"), PROGRAM))?;

    // LeRobot, on which they depend, needs a newer Python than the package.
    let options = ["--no-deps", "--ignore-requires-python"].map(OsStr::new);
    let plugins = plugins.iter().map(|plugin| plugin.as_os_str());
    environment.install(options.into_iter().chain(plugins))?;
    run(environment.python().args(["-c", HAVE_LICENCES]).args(PACKAGES))?;
    // Beside the sources, Python would import them in place of the wheels.
    let copy = folder.join("tests");
    fs::create_dir(&copy)?;
    let mut cp = Command::new("cp");
    cp.args(["-r", "--parents"]).args(ITS_FILES).arg(&copy);
    run(cp.current_dir(root()))?;
    run(&mut pytest(&environment, &copy.join("python/tests"), PLUGINS_TEST))
}

/// pytest for a file in this folder, without Rust on its search path.
fn pytest(environment: &Environment, folder: &Path, file: &str) -> Command {
    let mut pytest = environment.python();
    pytest
        .args(["-m", "pytest", "-q", file])
        .env("PATH", PATH)
        .current_dir(folder);
    pytest
}

/// The wheel of the package in this folder, and those of its plugins.
fn wheels(folder: &Path) -> Result<(PathBuf, Vec<PathBuf>)> {
    let files = fs::read_dir(folder)?.map(|file| Ok(file?.path()));
    let mut wheels = files.collect::<Result<Vec<_>>>()?;
    wheels.retain(|file| file.extension().is_some_and(|extension| extension == "whl"));
    let is_package = |wheel: &PathBuf| {
        wheel
            .file_name()
            .is_some_and(|name| name.to_string_lossy().starts_with("armwire-"))
    };
    let (packages, plugins) = wheels.into_iter().partition::<Vec<_>, _>(is_package);
    let package = packages.into_iter().next();
    let package = package.with_context(|| format!("{} has no wheel of armwire", folder.display()))?;
    ensure!(
        plugins.len() == 2,
        "{} has wheels of {} plugins instead of 2",
        folder.display(),
        plugins.len()
    );
    Ok((package, plugins))
}
