//! The adapter between this computer and the arm, and what it is told to be.

use armwire_bridge::config::{Can, Poll};

use super::show;
use crate::adapter::{describe, identify, line};
use crate::control::ControlLink;
use crate::error::Error;
use crate::{config, line_holder};

pub(super) fn run(control: &mut ControlLink) -> Result<(), Error> {
    show("adapter", describe(&identify(control)?))?;
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
    show(
        "configured",
        format_args!("arm {}, poll {poll}, silence {silence}", config.arm),
    )?;
    show("can", can(&config.can))?;
    match line(control)?.as_ref().and_then(line_holder::describe) {
        Some(told) => show("rate", told),
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
    format!(
        "node {}, {rate}, telemetry {telemetry}, commands {commands}",
        can.node.get()
    )
}
