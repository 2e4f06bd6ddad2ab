//! `cargo xtask ros2`: a DDS peer of another vendor reads and moves virtual arms through `armwire-ros2`.
//!
//! It runs in its own network namespace: no DDS discovery message leaves the machine.

use std::fs;
use std::process::Command;

use anyhow::{Context, Result};

use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::process::{output, run};
use crate::vendor::served::ServedBoard;
use crate::venv::Environment;
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
    run(&mut cargo("test --package armwire-ros2"))?;
    run(&mut cargo(BUILD))?;
    let scripts = root().join("ros2/tests");
    let folder = target_dir()?.join("ros2");
    fs::create_dir_all(&folder)?;
    let environment = Environment::new("python3", folder.join("python"))?;
    environment.install_listed(&scripts.join("requirements.txt"))?;
    let board = ServedBoard::start(&folder, "typical")?;
    let mut peer = Command::new("unshare");
    peer.arg("--net")
        .arg(scripts.join("namespace.sh"))
        .arg(environment.path("python"))
        .arg("-B");
    peer.arg(scripts.join("check.py"))
        .arg(target_dir()?.join("debug"))
        .arg(&folder);
    run(&mut peer)?;
    board.end()
}

/// Checks that a network namespace with interfaces can be created.
fn check_privilege() -> Result<()> {
    apt::require(&[("unshare", "util-linux"), ("ip", "iproute2")])?;
    let mut probe = Command::new("unshare");
    probe.args(["--net", "ip", "link", "set", "lo", "up"]);
    output(&mut probe).context("no network namespace: DDS would search the network for peers")?;
    Ok(())
}
