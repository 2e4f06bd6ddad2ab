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
#[cfg(feature = "recordings")]
mod recorder;
#[cfg(not(feature = "recordings"))]
#[path = "no_recorder.rs"]
mod recorder;
mod session;
mod table;
#[cfg(feature = "recordings")]
mod tap;
mod view;
mod xarm;

#[cfg(feature = "recordings")]
use std::path::PathBuf;
use std::sync::atomic::AtomicBool;

use armwire::alpha1::Alpha1;
use armwire::ling::Ling;
use armwire::ling::legacy::Legacy;
use armwire::xarm::XArm;
use clap::Args;

use crate::adapter::identify;
use crate::args::{ArmKind, Place};
use crate::describe::Arm;
use crate::error::Error;
use crate::legacy as generation;
use crate::tcp::Tcp;

use asked::Asked;
use output::Form;
use reading::Source;
use recorder::Recorder;
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
    /// Also record to an MCAP file: joint positions as ROS 2 messages, and every frame in both directions, for 'armwire
    /// decode'. An existing file is not replaced.
    #[cfg(feature = "recordings")]
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
}

impl Monitor {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let form = Form::new(self.csv, self.json);
        let mut session = Session::new(&self.place.port, form, self.count, stop);
        let mut recorder = self.recorder();
        let mut is_legacy = false;
        let end = loop {
            let watched = self.open(form, is_legacy, &recorder).and_then(|mut watched| {
                recorder.create()?;
                session.watch(&mut watched, self.rate, &mut recorder)
            });
            match watched {
                Err(Error::Legacy { name, legacy }) if !is_legacy => {
                    session.tell(format!("{name}: this is {legacy}"))?;
                    is_legacy = true;
                }
                Err(error) if session.may_come_back(&error) => {
                    match recorder.write().and_then(|()| session.has_enough_while_waiting(&error)) {
                        Ok(false) => {}
                        Ok(true) => break Ok(()),
                        Err(error) => break Err(error),
                    }
                }
                end => break end,
            }
        };
        let recorded = recorder.finish();
        session.close()?;
        end.and(recorded)
    }

    #[cfg(feature = "recordings")]
    fn recorder(&self) -> Recorder {
        Recorder::new(self.mcap.as_deref())
    }

    #[cfg(not(feature = "recordings"))]
    fn recorder(&self) -> Recorder {
        Recorder
    }

    /// Opens what there is to watch.
    fn open(&self, form: Form, is_legacy: bool, recorder: &Recorder) -> Result<Watched, Error> {
        if self.from_adapter {
            let control = self.place.control(&self.place.connect()?)?;
            return Ok(Watched::alone(adapter::open(control, recorder)?));
        }
        if matches!(self.place.arm, ArmKind::Xarm) {
            let line = Box::new(Tcp::connect_xarm(&self.place.host()?)?);
            let link = recorder.link(line, XArm::CONFIG);
            return Ok(Watched::alone(Box::new(xarm::Asked::new(link))));
        }
        let connection = self.place.connect()?;
        let source: Box<dyn Source> = match self.place.arm {
            ArmKind::Alpha1 => {
                let (line, config) = connection.line::<Alpha1>()?;
                Box::new(Asked::<Alpha1>(recorder.link(line, config)))
            }
            _ if is_legacy => {
                let (line, config) = connection.line::<Legacy>()?;
                Box::new(legacy::Listener::new(recorder.link(line, config)))
            }
            _ => {
                let (line, config) = generation::line(&connection)?;
                Box::new(Asked::<Ling>(recorder.link(line, config)))
            }
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
