//! CAN software: python-can, can-isotp and cantools.

use std::fs;

use crate::Result;
use crate::demo;
use crate::process::run;
use crate::vendor::DRIVE;
use crate::vendor::background::Background;
use crate::vendor::python::Python;
use crate::vendor::served::{BOOT, END, ServedBoard};

/// The node id that an adapter has from the factory.
const NODE: &str = "0";

/// cantools reads `docs/armwire.dbc`.
///
/// # Errors
///
/// If it finds a fault in the file.
pub(crate) fn check_dbc() -> Result {
    run(&mut python()?.script("dbc.py"))
}

/// All three drive a virtual Ling arm behind the virtual board, over its CAN bus.
///
/// # Errors
///
/// If they read anything but what they must, or take too long.
pub(crate) fn drive() -> Result {
    let python = python()?;
    let board = ServedBoard::start(&python.dir)?;
    let mut session = python.script("can_session.py");
    let driven = Background::start(session.arg(board.can()).arg(NODE))?.succeed_within(DRIVE);
    driven.and(board.end())
}

/// python-can exchanges CAN FD frames between two SLCAN adapters on a virtual bus.
///
/// # Errors
///
/// If a frame does not arrive as it was sent, or arrives though it must not, or it takes too long.
pub(crate) fn exchange_fd() -> Result {
    let python = python()?;
    println!("building the virtual CAN bus");
    run(&mut demo::virtual_board("build", "can-bus"))?;
    let links = ["fd-bus-0", "fd-bus-1"].map(|name| python.dir.join(name));
    for link in &links {
        // A link left behind by a bus that was killed may lead to somebody's terminal by now.
        let _ = fs::remove_file(link);
    }
    let mut serve = demo::virtual_board("run", "can-bus");
    let mut bus = Background::start(serve.args(["--quiet", "--"]).args(&links))?;
    for link in &links {
        bus.wait_for_file(link, BOOT)?;
    }
    let mut session = python.script("can_fd_session.py");
    Background::start(session.args(&links))?.succeed_within(DRIVE)?;
    bus.interrupt()?;
    bus.succeed_within(END)
}

fn python() -> Result<Python> {
    Python::with("can", "requirements-can.txt")
}
