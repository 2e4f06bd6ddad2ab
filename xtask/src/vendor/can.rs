//! CAN software: python-can, can-isotp and cantools.

use crate::Result;
use crate::process::run;
use crate::vendor::DRIVE;
use crate::vendor::background::Background;
use crate::vendor::python::Python;
use crate::vendor::served::ServedBoard;

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

fn python() -> Result<Python> {
    Python::with("can", "requirements-can.txt")
}
