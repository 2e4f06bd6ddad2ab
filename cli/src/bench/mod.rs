//! `armwire bench`: how long a program waits for the pose of an arm, and how old the pose is.
//!
//! [`subject`] is the arm, [`measure`] calls it at a rate, [`load`] keeps the processors busy meanwhile. [`report`] prints,
//! and [`plot`] draws.

mod load;
mod measure;
mod plot;
mod report;
mod subject;

use std::io::Write;
use std::path::PathBuf;
use std::time::Duration;

use armwire_host::Rate;
use clap::Args;

use crate::args::{LiveArm, Place};
use crate::call::values::{made, seconds};
use crate::confirm::Confirm;
use crate::error::Error;
use crate::new_file;
use crate::output::print_json;
use crate::signals;
use crate::status::StatusArg;
use load::Load;
use measure::{Call, Run};
use report::System;
use subject::{LingArm, Subject, XArmArm};

/// The lowest rate, in hertz.
const MIN_RATE: u16 = 50;

/// The longest measurement.
const MAX_TIME: Duration = Duration::from_secs(3_600);

/// The arguments of `armwire bench`.
#[derive(Args)]
pub(crate) struct Bench {
    #[command(flatten)]
    place: Place,
    /// Calls per second, 50 to 1000. Several are measured one after the other.
    #[arg(long, value_name = "HZ", value_delimiter = ',', default_value = "50,200,500,1000", value_parser = rate)]
    rate: Vec<Rate>,
    /// Time of each measurement, up to an hour. Each rate has two: reads that wait, and the newest pose of a reader.
    #[arg(long, value_name = "SECONDS", default_value = "5", value_parser = span)]
    seconds: Duration,
    /// Send a move before each read: its goal is the pose at the start, throughout. The arm holds that pose. Ling only.
    #[arg(long)]
    hold: bool,
    /// Measure again with a process for each processor that keeps it busy, by the system's shell, sh.
    #[arg(long)]
    load: bool,
    /// Print JSON, with the system and the adapter.
    #[arg(long)]
    json: bool,
    /// Draw to this SVG file: the share of calls above a duration. An existing file is not replaced.
    #[arg(long, value_name = "FILE")]
    svg: Option<PathBuf>,
    #[command(flatten)]
    confirm: Confirm,
    #[command(flatten)]
    status: StatusArg,
}

/// A rate of the command line.
fn rate(text: &str) -> Result<Rate, String> {
    made(text, "a whole number", |hertz: u16| match hertz {
        ..MIN_RATE => Err(format!("the rate is {hertz} Hz, must be {MIN_RATE} to {}", Rate::MAX)),
        hertz => Rate::new(hertz).map_err(|error| error.to_string()),
    })
}

/// A time of the command line.
fn span(text: &str) -> Result<Duration, String> {
    match seconds(text)? {
        Duration::ZERO => Err("the time is 0 s, must be more".to_owned()),
        span if span > MAX_TIME => Err(format!("the time is {text} s, must be at most {}", MAX_TIME.as_secs())),
        span => Ok(span),
    }
}

impl Bench {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let question = match self.hold {
            true => Some(self.confirm.question(
                "The arm is sent its present pose as the goal throughout: it holds it, and a grip may loosen. Keep clear \
                 of it.",
            )?),
            false => None,
        };
        if self.hold && self.place.arm != LiveArm::Ling {
            return Err(Error::Usage("--hold applies to a ling arm only".to_owned()));
        }
        // A file that cannot be created is refused before the measurement.
        if let Some(path) = &self.svg {
            new_file::check(path)?;
        }
        signals::catch_first()?;
        let (system, runs) = match self.place.arm {
            LiveArm::Ling => {
                let mut arm = LingArm::open(&self.place)?;
                if let Some(question) = question {
                    question.ask()?;
                    arm.hold()?;
                }
                self.measure(arm)?
            }
            LiveArm::Xarm => self.measure(XArmArm::open(&self.place)?)?,
            LiveArm::Alpha1 | LiveArm::LingLegacy => {
                let reason = "this arm has no pose that can be read at a rate: bench measures ling and xarm";
                return Err(Error::Usage(reason.to_owned()));
            }
        };
        match self.json {
            true => print_json(&report::json(&system, &runs))?,
            false => report::print(&system, &runs)?,
        }
        if let Some(path) = &self.svg {
            let drawn = new_file::create(path)?.write_all(plot::svg(&runs).as_bytes());
            drawn.map_err(Error::Output)?;
        }
        Ok(())
    }

    /// Measures each rate, and again with load. An arm that holds its pose is stopped at the end, also after an error.
    fn measure(&self, mut arm: impl Subject) -> Result<(System, Vec<Run>), Error> {
        let system = System::of(arm.adapter());
        let mut runs = Vec::new();
        let calls = [Call::Read, Call::Latest];
        let mut status = self
            .status
            .bar((self.loads().len() * self.rate.len() * calls.len()) as u64);
        let measured = self.loads().iter().try_for_each(|&is_loaded| {
            let _load = is_loaded.then(Load::start).transpose()?;
            self.rate.iter().try_for_each(|&rate| {
                for call in calls {
                    // It is not drawn while calls are measured.
                    let text = format!("{} Hz, {call}{}", rate.hertz(), report::under(is_loaded));
                    status.begin(runs.len() as u64, text);
                    let run = arm.measure(call, rate, self.seconds)?;
                    if runs.is_empty() && run.failed == run.calls.ascending().len() as u64 {
                        return Err(Error::at(&self.place.port, "none of the calls was answered"));
                    }
                    runs.push(run.under(is_loaded));
                }
                Ok(())
            })
        });
        let ended = arm.end();
        measured.and(ended)?;
        Ok((system, runs))
    }

    /// The load of the measurements of a rate: true with busy processors.
    const fn loads(&self) -> &'static [bool] {
        if self.load { &[false, true] } else { &[false] }
    }
}
