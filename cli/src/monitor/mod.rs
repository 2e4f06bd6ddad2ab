//! `armwire monitor`: the state of an arm as it changes.
//!
//! A [source](reading::Source) reads from the arm, or from the events of the adapter. The [model](model::Model) keeps
//! the readings, an [output](output::Output) shows them, and a [recorder](recorder::Recorder) writes the frames to a
//! file. A [session](session::Session) drives them. This module opens the source, also after its port was lost.

mod adapter;
mod fields;
mod legacy;
mod model;
mod output;
mod polled;
mod reading;
mod recorder;
mod session;
mod table;
mod view;
mod xarm;

use std::path::{Path, PathBuf};
use std::sync::atomic::AtomicBool;

use armwire_host::{Error as Host, Known, Ling, XArm};
use clap::Args;

use crate::args::{LiveArm, Place};
use crate::call::values::whole;
use crate::error::Error;

pub(crate) use output::Form;
use polled::Polled;
use reading::Source;
pub(crate) use recorder::Recorder;
pub(crate) use session::RETRY_PERIOD;
use session::{Session, Watched};

/// The arguments of `armwire monitor`.
#[derive(Args)]
pub(crate) struct Monitor {
    #[command(flatten)]
    readings: Readings,
    /// Readings per second.
    #[arg(long, default_value_t = 20, value_parser = whole::<u32>(1..=1_000))]
    rate: u32,
    /// Print comma-separated values. The first line has names with units. Missing values are empty.
    #[arg(long, conflicts_with = "json")]
    csv: bool,
    /// Print a JSON object per line, with units in the names. Missing values are null.
    #[arg(long)]
    json: bool,
    /// Record to this MCAP file: joint positions as ROS 2 messages, and every frame in both directions, for 'armwire
    /// decode'. An existing file is not replaced.
    #[arg(long, value_name = "FILE")]
    mcap: Option<PathBuf>,
}

/// The readings that `armwire monitor` and `armwire record` take.
#[derive(Args)]
pub(crate) struct Readings {
    #[command(flatten)]
    place: Place,
    /// Stop after this many readings. Without it: q or Ctrl-C.
    #[arg(long, value_parser = whole::<u64>(1..=u64::MAX))]
    count: Option<u64>,
    /// End with an error when the port is lost. Without it: wait until the port is back.
    #[arg(long)]
    exit_on_loss: bool,
    /// Send nothing to the arm: take each reading that the adapter receives for its polls or for other hosts, with the
    /// adapter's stamps. The arm's port stays free for another program.
    #[arg(long, conflicts_with_all = ["rate", "arm"])]
    from_adapter: bool,
}

impl Monitor {
    pub(crate) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let form = Form::new(self.csv, self.json);
        self.readings.watch(self.rate, self.mcap.as_deref(), form, stop)
    }
}

impl Readings {
    /// Watches the arm until `stop` is set, or until the user or the number of readings ends it. The rate is in readings
    /// per second, unless the adapter is the source. The recording goes to the file `mcap`.
    pub(crate) fn watch(&self, rate: u32, mcap: Option<&Path>, form: Form, stop: &AtomicBool) -> Result<(), Error> {
        let mut session = Session::new(&self.place.port, form, self.count, stop);
        let mut recorder = Recorder::new(mcap);
        let mut is_legacy = self.place.arm == LiveArm::LingLegacy;
        let mut known = None;
        let end = loop {
            let watched = self
                .open(form, is_legacy, &mut known, &recorder)
                .and_then(|mut watched| {
                    recorder.create()?;
                    let shown = session.watch(&mut watched, rate, &mut recorder);
                    match &watched.connection {
                        Some(connection) => shown.map_err(|error| error.explained(|error| connection.explain(error))),
                        None => shown,
                    }
                });
            match watched {
                Err(Error::Host(Host::Legacy { name, legacy })) if !is_legacy && known.is_none() => {
                    session.notify(format!("{name}: this is {legacy}"))?;
                    is_legacy = true;
                }
                Err(error) if !self.exit_on_loss && session.may_come_back(&error) => {
                    match recorder.write().and_then(|()| session.wait_for_port(&error)) {
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

    /// Opens the source, and the adapter if there is one. A Ling arm must be the one of before.
    fn open(
        &self,
        form: Form,
        is_legacy: bool,
        known: &mut Option<Known>,
        recorder: &Recorder,
    ) -> Result<Watched, Error> {
        if self.from_adapter {
            let control = self.place.connect()?.adapter()?;
            let source = adapter::open(control, recorder)?;
            return Ok(Watched {
                source,
                adapter: None,
                connection: None,
            });
        }
        if matches!(self.place.arm, LiveArm::Xarm) {
            let link = recorder.tapped(XArm::connect(&self.place.host()?)?.into_link());
            let source = Box::new(xarm::PolledXArm::new(link));
            return Ok(Watched {
                source,
                adapter: None,
                connection: None,
            });
        }
        let connection = self.place.connect()?;
        let source: Box<dyn Source> = match self.place.arm {
            LiveArm::Alpha1 => Box::new(Polled(recorder.tapped(connection.alpha1()?.into_link()))),
            _ if is_legacy => Box::new(legacy::Listener::new(recorder.tapped(connection.legacy()?))),
            _ => {
                let mut arm = connection.ling()?;
                identify(&mut arm, known)?;
                Box::new(Polled(recorder.tapped(arm.into_link())))
            }
        };
        let adapter = match connection.adapter() {
            // A control port that the user names must have an adapter that answers.
            control if self.place.control.is_some() => {
                let mut control = control?;
                control.identify()?;
                Some(Ok(control))
            }
            _ if form != Form::Screen => None,
            Err(Host::NoControl { .. }) => None,
            control => Some(control),
        };
        Ok(Watched {
            source,
            adapter,
            connection: Some(connection),
        })
    }
}

/// Reads what the arm is known by, or compares it with the one before.
fn identify(arm: &mut Ling, known: &mut Option<Known>) -> Result<(), Host> {
    if let Some(known) = known {
        return arm.require_known(known);
    }
    match arm.read_info() {
        Ok(_) => {
            *known = Some(arm.known());
            Ok(())
        }
        Err(error @ (Host::Lost { .. } | Host::Legacy { .. })) => Err(error),
        // An arm that is off, or on a noisy line, is waited for.
        Err(_) => Ok(()),
    }
}
