//! `armwire info`: what arm is on a port, and how it is, and of what adapter the port is.

use armwire::alpha1::Alpha1;
use armwire_bridge::config::{Can, Poll};

use crate::adapter::{describe, identify, line};
use crate::args::{ArmKind, Place};
use crate::control::ControlLink;
use crate::describe::{Arm, Fact};
use crate::error::Error;
use crate::link::{Line, Link};
use crate::output::say;
use crate::{config, legacy, line_holder};

pub(crate) fn run(place: &Place) -> Result<(), Error> {
    if matches!(place.arm, ArmKind::Xarm) {
        // Here a byte that is part of no frame ends it.
        return arm(&mut Link::connect(&place.host()?)?);
    }
    let connection = place.connect()?;
    match place.control(&connection) {
        Ok(mut control) => adapter(&mut control)?,
        // Whoever names a control port is to have it.
        Err(error) if place.control.is_some() => return Err(error),
        // There may be no adapter, or an arm that can be asked without it.
        Err(Error::NoControl { .. }) => {}
        Err(error @ Error::Usb { .. }) => show(&Fact::words("adapter", format_args!("not told: {error}")))?,
        Err(error) => return Err(error),
    }
    if connection.is_control() {
        return Ok(());
    }
    let dropped = match place.arm {
        ArmKind::Alpha1 => {
            let mut link = connection.arm::<Alpha1>()?;
            arm(&mut link)?;
            link.dropped()
        }
        ArmKind::Ling | ArmKind::Xarm => {
            let mut link = legacy::open(&connection)?;
            arm(&mut link)?;
            link.dropped()
        }
    };
    show(&match dropped {
        0 => Fact::words("line", "clean"),
        dropped => Fact::words("line", format_args!("{dropped} bytes were no part of a frame")),
    })
}

/// Asks an arm for all there is to know, and shows each answer as it comes. Of what comes with each, the last is shown.
fn arm<P: Arm>(link: &mut Link<P, impl Line>) -> Result<(), Error> {
    let (mut known, mut state) = (Vec::new(), None);
    for request in P::info() {
        let facts = link.call(&request, |response| P::facts_after(&known, &response))?;
        for fact in facts.unwrap_or_default() {
            match fact.name.as_str() {
                "state" => state = Some(fact),
                _ => {
                    show(&fact)?;
                    known.push(fact);
                }
            }
        }
    }
    state.iter().try_for_each(show)
}

/// The adapter between this computer and the arm, and what it is told to be.
fn adapter(control: &mut ControlLink) -> Result<(), Error> {
    show(&Fact::words("adapter", describe(&identify(control)?)))?;
    let config = config::get(control)?;
    let poll = match config.poll {
        Poll::Off => "off".to_owned(),
        Poll::Fastest => "fastest".to_owned(),
        Poll::Hertz(hertz) => format!("{hertz} Hz"),
    };
    let silence = match config.host_timeout.after_ms {
        0 => "never".to_owned(),
        millis if config.host_timeout.torque_off => format!("after {millis} ms (torque off)"),
        millis => format!("after {millis} ms"),
    };
    let what = format!("arm {}, poll {poll}, silence {silence}", config.arm);
    show(&Fact::words("configured", what))?;
    show(&Fact::words("can", can(&config.can)))?;
    match line(control)?.as_ref().and_then(line_holder::describe) {
        Some(told) => show(&Fact::words("rate", told)),
        None => Ok(()),
    }
}

fn can(can: &Can) -> String {
    let rate = match can.data_bit_rate {
        None => format!("{} bit/s", can.bit_rate),
        Some(data) => format!("{} and {data} bit/s (CAN FD)", can.bit_rate),
    };
    let telemetry = match can.telemetry_hz {
        0 => "off".to_owned(),
        hertz => format!("{hertz} Hz"),
    };
    let commands = if can.commands { "on" } else { "off" };
    let node = can.node.get();
    format!("node {node}, {rate}, telemetry {telemetry}, commands {commands}")
}

/// Prints one thing there is to know.
fn show(fact: &Fact) -> Result<(), Error> {
    say(format_args!("{:<13}{}", fact.name, fact.text))
}
