//! `armwire info`: what arm is on a port, and how it is, and of what adapter the port is.

mod adapter;
mod alpha1;
mod ling;
mod xarm;

use std::fmt::Display;
use std::io::{Write, stdout};

use crate::args::{ArmKind, Place};
use crate::error::Error;
use crate::legacy;
use crate::link::Link;
use crate::printable::escaped;

pub(crate) fn run(place: &Place) -> Result<(), Error> {
    if matches!(place.arm, ArmKind::Xarm) {
        // Here a byte that is part of no frame ends it.
        return xarm::run(&mut Link::connect(&place.host()?)?);
    }
    let connection = place.connect()?;
    match place.control(&connection) {
        Ok(mut control) => adapter::run(&mut control)?,
        // Whoever names a control port is to have it.
        Err(problem) if place.control.is_some() => return Err(problem),
        // There may be no adapter, or an arm that can be asked without it.
        Err(Error::NoControl { .. }) => {}
        Err(problem @ Error::Usb { .. }) => show("adapter", format_args!("not told: {problem}"))?,
        Err(problem) => return Err(problem),
    }
    if connection.is_control() {
        return Ok(());
    }
    let dropped = match place.arm {
        ArmKind::Alpha1 => {
            let mut link = connection.arm()?;
            alpha1::run(&mut link)?;
            link.dropped()
        }
        ArmKind::Ling | ArmKind::Xarm => {
            let mut link = legacy::open(&connection)?;
            ling::run(&mut link)?;
            link.dropped()
        }
    };
    match dropped {
        0 => show("line", "clean"),
        dropped => show("line", format_args!("{dropped} bytes were no part of a frame")),
    }
}

/// Prints one thing there is to know.
fn show(name: &str, value: impl Display) -> Result<(), Error> {
    writeln!(stdout(), "{name:<13}{}", escaped(&value.to_string())).map_err(Error::Output)
}
