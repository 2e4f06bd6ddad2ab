//! `armwire info`: what arm is on a port, and how it is, and of what adapter the port is.

use armwire_bridge::config::{Can, Poll};
use armwire_host::describe::{Arm, Fact, object};
use armwire_host::{Adapter, Error as Host, LineErrors, Link, NoControl, RECOVERY, XArm, line_reservation};
use clap::Args;

use crate::adapter;
use crate::args::{LiveArm, Place};
use crate::error::Error;
use crate::output::{print_json, print_line};
use crate::remedies::words;

/// Width of the column of names, with a gap after the longest: `servos that run` and `rotation radius`.
const LABELS: usize = 17;

/// The arguments of `armwire info`.
#[derive(Args)]
pub(crate) struct Info {
    #[command(flatten)]
    place: Place,
    /// Print all of it as one JSON object, with the units in the names.
    #[arg(long)]
    json: bool,
}

/// The facts so far. Text is printed at once, JSON as one object at the end.
struct Report {
    json: bool,
    known: Vec<Fact>,
}

impl Info {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let (json, known) = (self.json, Vec::new());
        let mut report = Report { json, known };
        report.collect(&self.place)?;
        match json {
            true => print_json(&object(&report.known).into()),
            false => Ok(()),
        }
    }
}

impl Report {
    fn add(&mut self, fact: Fact) -> Result<(), Error> {
        if !self.json {
            print_line(format_args!("{:<LABELS$}{}", fact.name, fact.text))?;
        }
        self.known.push(fact);
        Ok(())
    }

    fn collect(&mut self, place: &Place) -> Result<(), Error> {
        if place.arm == LiveArm::LingLegacy {
            let reason = "nothing is sent to an arm of the older generation, and info only asks: 'armwire monitor' shows its \
                          joints";
            return Err(Error::refused(&place.port, reason));
        }
        if matches!(place.arm, LiveArm::Xarm) {
            // A byte outside frames ends the connection.
            return self.arm(XArm::connect(&place.host()?)?.link()).map(drop);
        }
        let connection = place.connect()?;
        match connection.adapter() {
            Ok(mut control) => self.adapter(&mut control)?,
            // A control port on the command line must work.
            Err(error) if place.control.is_some() => return Err(error.into()),
            // There may be no adapter, or an arm that answers without it.
            Err(Host::NoControl {
                reason: NoControl::NoAdapter,
                ..
            }) => {}
            // Without adapters on USB, the port is hardly one of an adapter.
            Err(Host::NoControl {
                reason: NoControl::NotShown { candidates },
                ..
            }) if candidates.is_empty() => {}
            Err(error @ (Host::Usb { .. } | Host::NoControl { .. })) => {
                self.add(Fact::words("adapter", format_args!("unknown: {}", Error::from(error))))?;
            }
            Err(error) => return Err(error.into()),
        }
        if connection.is_control() {
            return Ok(());
        }
        let errors = match place.arm {
            LiveArm::Alpha1 => self.arm(connection.alpha1()?.link()),
            LiveArm::Ling | LiveArm::LingLegacy | LiveArm::Xarm => self.arm(connection.ling()?.link()),
        };
        let explain = |error| connection.explain(error);
        let LineErrors { noise_bytes, .. } = errors.map_err(|error| error.explained(explain))?;
        let text = match noise_bytes {
            0 => "clean".to_owned(),
            noise_bytes => format!("{noise_bytes} stray bytes"),
        };
        self.add(Fact::new("line", "noise_bytes", noise_bytes, text))
    }

    /// The facts in the arm's answers. The state comes with each answer: the last counts. Returns the line's errors.
    fn arm<P: Arm>(&mut self, link: &mut Link<P>) -> Result<LineErrors, Error> {
        let mut state = None;
        for request in P::info() {
            let facts = link.call(&request, |response| P::facts_after(&self.known, &response))?;
            for fact in facts.unwrap_or_default() {
                match fact.name.as_str() {
                    "state" => state = Some(fact),
                    _ => self.add(fact)?,
                }
            }
        }
        state.map_or(Ok(()), |state| self.add(state))?;
        Ok(link.line_errors())
    }

    /// The adapter between this computer and the arm, and its configuration.
    fn adapter(&mut self, control: &mut Adapter) -> Result<(), Error> {
        let identity = control.identify()?;
        self.add(adapter::identity(&identity))?;
        if control.is_in_recovery()? {
            self.add(Fact::words("recovery", RECOVERY))?;
        }
        let config = control.config()?;
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
        let text = format!("arm {}, poll {poll}, silence {silence}", config.arm);
        self.add(Fact::new(
            "configured",
            "config",
            armwire_host::settings::object(&config, &identity),
            text,
        ))?;
        if !identity.no_can {
            self.add(Fact::of("can", can(&config.can), []))?;
        }
        match control.line()?.as_ref().and_then(line_reservation::describe) {
            Some(rate) => self.add(Fact::words("rate", rate.with(words))),
            None => Ok(()),
        }
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
