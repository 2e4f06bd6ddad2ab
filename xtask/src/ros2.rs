//! `cargo xtask ros2`: a DDS peer of another make hears and moves virtual arms through `armwire-ros2`.
//!
//! It runs in a network namespace of its own: the discovery of DDS leaves the machine nowhere.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use anyhow::{Result, bail};

use crate::cargo::{cargo, target_dir};
use crate::process::{output, run, shown};
use crate::vendor::served::ServedBoard;
use crate::venv;
use crate::workspace::root;

/// Both programs, as the peer starts them.
const BUILD: &str = "build --package armwire-ros2 --package armwire-cli --bins";

/// Tests the node, and runs the peer's script.
///
/// # Errors
///
/// If a test or the script fails, or if a network namespace is refused.
pub(crate) fn check() -> Result<()> {
    check_privilege()?;
    for words in ["test --package armwire-ros2", BUILD] {
        let mut command = cargo(words);
        println!("running `{}`", shown(&command));
        run(&mut command)?;
    }
    let scripts = root().join("ros2/tests");
    let folder = target_dir()?.join("ros2");
    fs::create_dir_all(&folder)?;
    let python = environment(&folder)?;
    let board = ServedBoard::start(&folder)?;
    let mut peer = Command::new("unshare");
    peer.arg("--net")
        .arg(scripts.join("namespace.sh"))
        .arg(python)
        .arg("-B");
    peer.arg(scripts.join("check.py"))
        .arg(target_dir()?.join("debug"))
        .arg(&folder);
    run(&mut peer)?;
    board.end()
}

/// A network namespace may be made, with interfaces in it.
fn check_privilege() -> Result<()> {
    let mut probe = Command::new("unshare");
    probe.args(["--net", "ip", "link", "set", "lo", "up"]);
    if let Err(error) = output(&mut probe) {
        bail!("no network namespace, without which DDS would look for peers in the network: {error:#}");
    }
    Ok(())
}

/// The Python of an environment in the target directory, with the peer's packages.
fn environment(folder: &Path) -> Result<PathBuf> {
    let environment = folder.join("python");
    let python = environment.join("bin/python");
    venv::make(Path::new("python3"), &environment)?;
    let mut pip = Command::new(&python);
    pip.args([
        "-m",
        "pip",
        "install",
        "--quiet",
        "--disable-pip-version-check",
        "--no-deps",
        "--requirement",
    ]);
    run(pip.arg(root().join("ros2/tests/requirements.txt")))?;
    Ok(python)
}
