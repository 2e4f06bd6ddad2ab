//! CAN software: python-can, can-isotp and cantools.

use std::fs;
use std::path::Path;

use anyhow::Result;

use super::background::Background;
use super::python::Python;
use super::served::{BOOT, END, ServedBoard};
use crate::apt;
use crate::cargo::{cargo, target_dir};
use crate::process::run;

/// The default node id of an adapter.
const NODE: &str = "0";
/// Programs that write logs, and their packages.
const LOG_TOOLS: [(&str, &str); 2] = [("log2asc", "can-utils"), ("tshark", "tshark")];

/// Checks `docs/armwire.dbc` with cantools.
///
/// # Errors
///
/// If the file has an error.
pub(crate) fn check_dbc() -> Result<()> {
    python()?.run("dbc.py", &[])
}

/// Compares the counts of `armwire decode` with those of python-can, can-utils and tshark, for logs that these write.
///
/// # Errors
///
/// If a count differs.
pub(crate) fn compare_logs() -> Result<()> {
    apt::require(&LOG_TOOLS)?;
    run(&mut cargo("build --quiet --package armwire-cli"))?;
    let python = python()?;
    let armwire = target_dir()?.join("debug/armwire");
    python.run("can_logs.py", &[&armwire, &python.dir])
}

/// Drives a virtual Ling arm behind the virtual board over CAN, with all three libraries.
///
/// # Errors
///
/// If a library reads a wrong value, or a timeout is exceeded.
pub(crate) fn drive() -> Result<()> {
    let python = python()?;
    let board = ServedBoard::start(&python.dir, "ideal")?;
    let driven = python.run("can_session.py", &[board.can(), Path::new(NODE)]);
    driven.and(board.end())
}

/// Exchanges CAN FD frames between two SLCAN adapters on a virtual bus, with python-can.
///
/// # Errors
///
/// If a frame arrives changed, not at all or unexpectedly, or a timeout is exceeded.
pub(crate) fn exchange_fd() -> Result<()> {
    let python = python()?;
    println!("building the virtual CAN bus");
    run(&mut cargo("build --package armwire-virtual-board --bin can-bus"))?;
    let links = ["fd-bus-0", "fd-bus-1"].map(|name| python.dir.join(name));
    for link in &links {
        // The old link of a killed bus may point to another program's terminal.
        let _ = fs::remove_file(link);
    }
    let mut serve = cargo("run --quiet --package armwire-virtual-board --bin can-bus --");
    let mut bus = Background::start(serve.args(&links))?;
    for link in &links {
        bus.wait_for_file(link, BOOT)?;
    }
    python.run("can_fd_session.py", &[&links[0], &links[1]])?;
    bus.interrupt()?;
    bus.succeed_within(END)
}

fn python() -> Result<Python> {
    Python::with("can", "requirements-can.txt")
}
