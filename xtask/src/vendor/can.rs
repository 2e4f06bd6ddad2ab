//! CAN software: python-can, can-isotp and cantools.

use std::fs;
use std::path::Path;

use anyhow::Result;

use super::background::Background;
use super::python::Python;
use super::served::{BOOT, END, ServedBoard};
use crate::cargo::cargo;
use crate::process::run;

/// The node id that an adapter has from the factory.
const NODE: &str = "0";

/// cantools reads `docs/armwire.dbc`.
///
/// # Errors
///
/// If it finds a fault in the file.
pub(crate) fn check_dbc() -> Result<()> {
    python()?.run("dbc.py", &[])
}

/// All three drive a virtual Ling arm behind the virtual board, over its CAN bus.
///
/// # Errors
///
/// If they read anything but what they must, or take too long.
pub(crate) fn drive() -> Result<()> {
    let python = python()?;
    let board = ServedBoard::start(&python.dir)?;
    let driven = python.run("can_session.py", &[board.can(), Path::new(NODE)]);
    driven.and(board.end())
}

/// python-can exchanges CAN FD frames between two SLCAN adapters on a virtual bus.
///
/// # Errors
///
/// If a frame does not arrive as it was sent, or arrives though it must not, or it takes too long.
pub(crate) fn exchange_fd() -> Result<()> {
    let python = python()?;
    println!("building the virtual CAN bus");
    run(&mut cargo("build --package armwire-virtual-board --bin can-bus"))?;
    let links = ["fd-bus-0", "fd-bus-1"].map(|name| python.dir.join(name));
    for link in &links {
        // A link left behind by a bus that was killed may lead to somebody's terminal by now.
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
