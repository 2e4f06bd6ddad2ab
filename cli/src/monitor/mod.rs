//! `armwire monitor`: how an arm is, as it changes.
//!
//! A [source](reading::Source) asks the arm, or hears of it from the adapter; the [model](model::Model) keeps what was
//! learnt; an [output](output::Output) shows it. A [session](session::Session) drives the three, and what is here opens
//! the source, again when its port comes back.

mod adapter;
mod asked;
mod legacy;
mod model;
mod output;
mod reading;
mod session;
mod table;
mod view;
mod xarm;

use std::sync::atomic::AtomicBool;

use armwire::alpha1::Alpha1;
use armwire::ling::legacy::Legacy;
use clap::Args;

use crate::adapter::identify;
use crate::args::{ArmKind, Place};
use crate::error::Error;
use crate::legacy as generation;
use crate::link::Link;

use asked::Asked;
use output::Form;
use reading::Source;
use session::{Session, Watched};

/// The arguments of `armwire monitor`.
#[derive(Args)]
pub(crate) struct Monitor {
    #[command(flatten)]
    place: Place,
    /// Readings per second.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Stop after this many readings.
    #[arg(long)]
    count: Option<u64>,
    /// Comma-separated values with a line of names, units included, in front; nothing where a value is missing.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// A JSON object a line, with the units in the names; null where a value is missing.
    #[arg(long)]
    json: bool,
    /// Ask the arm nothing: show each reading that the adapter hears, as it polls or others ask, with the adapter's own
    /// time. The arm's port stays free for another program.
    #[arg(long, conflicts_with_all = ["rate", "arm"])]
    from_adapter: bool,
}

impl Monitor {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let form = Form::new(self.csv, self.json);
        let mut session = Session::new(&self.place.port, form, self.count, stop);
        let mut is_legacy = false;
        let end = loop {
            let watched = match self.open(form, is_legacy) {
                Ok(mut watched) => session.watch(&mut watched, self.rate),
                Err(error) => Err(error),
            };
            match watched {
                Err(Error::Legacy { name, legacy }) if !is_legacy => {
                    session.tell(format!("{name}: this is {legacy}"))?;
                    is_legacy = true;
                }
                Err(error) if session.may_come_back(&error) => {
                    if session.has_enough_while_waiting(&error)? {
                        break Ok(());
                    }
                }
                end => break end,
            }
        };
        session.close()?;
        end
    }

    /// Opens what there is to watch.
    fn open(&self, form: Form, is_legacy: bool) -> Result<Watched, Error> {
        if self.from_adapter {
            let control = self.place.control(&self.place.connect()?)?;
            return Ok(Watched::alone(adapter::open(control)?));
        }
        if matches!(self.place.arm, ArmKind::Xarm) {
            let link = Link::connect(&self.place.host()?)?;
            return Ok(Watched::alone(Box::new(xarm::Asked::new(link))));
        }
        let connection = self.place.connect()?;
        let source: Box<dyn Source> = match self.place.arm {
            ArmKind::Alpha1 => Box::new(Asked(connection.arm::<Alpha1>()?)),
            _ if is_legacy => Box::new(legacy::Listener::new(connection.arm::<Legacy>()?)),
            _ => Box::new(Asked(generation::open(&connection)?)),
        };
        let adapter = match self.place.control(&connection) {
            // Whoever names a control port is to have it, with an adapter that answers there.
            control if self.place.control.is_some() => {
                let mut control = control?;
                identify(&mut control)?;
                Some(Ok(control))
            }
            _ if form != Form::Screen => None,
            Err(Error::NoControl { .. }) => None,
            control => Some(control),
        };
        Ok(Watched { source, adapter })
    }
}
