//! `armwire info`: what arm is on a port, and how it is.

mod alpha1;
mod ling;
mod xarm;

use std::fmt::Display;
use std::io::{Write, stdout};

use crate::link::Link;
use crate::problem::Problem;
use crate::{ArmKind, Place, older};

pub(crate) fn run(place: &Place) -> Result<(), Problem> {
    let dropped = match place.arm {
        ArmKind::Ling => {
            let mut link = older::open(&place.port, place.baud.baud)?;
            ling::run(&mut link)?;
            link.dropped()
        }
        // Here a byte that is part of no frame ends it.
        ArmKind::Xarm => return xarm::run(&mut Link::connect(&place.host()?)?),
        ArmKind::Alpha1 => {
            let mut link = Link::open(&place.port, place.baud.baud)?;
            alpha1::run(&mut link)?;
            link.dropped()
        }
    };
    match dropped {
        0 => show("line", "clean"),
        dropped => show("line", format_args!("{dropped} bytes were no part of a frame")),
    }
}

/// Prints one thing there is to know.
fn show(name: &str, value: impl Display) -> Result<(), Problem> {
    writeln!(stdout(), "{name:<13}{value}").map_err(Problem::Output)
}
