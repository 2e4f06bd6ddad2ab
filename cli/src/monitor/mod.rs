//! `armwire monitor`: how an arm is, as it changes.
//!
//! A [source](reading::Source) asks the arm, or hears of it from the adapter; the [model](model::Model) keeps what was
//! learnt; an [output](output::Output) shows it. What is here drives the three.

mod adapter;
mod asked;
mod legacy;
mod model;
mod output;
mod reading;
mod table;
mod view;
mod xarm;

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use armwire::alpha1::Alpha1;
use armwire::ling::legacy::Legacy;
use armwire_bridge::time;
use clap::Args;

use crate::adapter::{counters, describe, identify, latencies};
use crate::args::{ArmKind, Place};
use crate::control::ControlLink;
use crate::error::Error;
use crate::legacy as generation;
use crate::link::Link;
use crate::output::complain;
use crate::port::Connection;

use asked::Asked;
use model::{Adapter, Latest, Model};
use output::{Form, Step};
use reading::{News, Source};

/// How often the temperatures are asked for, and the adapter for its counters.
const CELSIUS: time::Duration = time::Duration::from_millis(5_000);
const ADAPTER: time::Duration = time::Duration::from_millis(1_000);

/// The arguments of `armwire monitor`.
#[derive(Args)]
pub(crate) struct Monitor {
    #[command(flatten)]
    place: Place,
    /// Readings per second.
    #[arg(long, default_value_t = 20, value_parser = clap::value_parser!(u32).range(1..=1000))]
    rate: u32,
    /// Stop after so many readings.
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
        if self.from_adapter {
            let control = self.place.control(&self.place.connect()?)?;
            return self.watch(&mut *adapter::open(control)?, None, stop);
        }
        match self.place.arm {
            ArmKind::Ling => {
                let connection = self.place.connect()?;
                let watched = generation::open(&connection)
                    .and_then(|link| self.watch(&mut Asked(link), Some(&connection), stop));
                let Err(Error::Legacy { name, legacy }) = watched else {
                    return watched;
                };
                complain(&format_args!("{name}: this is {legacy}"));
                let link = connection.arm::<Legacy>()?;
                self.watch(&mut legacy::Heard::new(link), Some(&connection), stop)
            }
            ArmKind::Alpha1 => {
                let connection = self.place.connect()?;
                self.watch(&mut Asked(connection.arm::<Alpha1>()?), Some(&connection), stop)
            }
            ArmKind::Xarm => {
                let link = Link::connect(&self.place.host()?)?;
                self.watch(&mut xarm::Asked::new(link), None, stop)
            }
        }
    }

    /// Shows what comes from a source, and what the adapter there tells, if there is one, until somebody has enough.
    fn watch(&self, source: &mut dyn Source, connection: Option<&Connection>, stop: &AtomicBool) -> Result<(), Error> {
        let form = Form::new(self.csv, self.json);
        let start = Instant::now();
        let now = || time::Instant::from_micros(start.elapsed().as_micros().try_into().unwrap_or(u64::MAX));
        let rate = source.is_paced().then_some(self.rate);
        let mut model = Model::new(&self.place.port, source.arm(), source.servos(), rate);
        let mut celsius = Timer::new(CELSIUS);
        let mut told = Timer::new(ADAPTER);
        let mut control = match connection {
            Some(connection) if self.place.control.is_some() => Some(self.named(connection)?),
            _ => None,
        };
        // Not before there is something to show: an arm that does not answer at all is an error, and no screen.
        let mut output = None;
        let mut readings = 0;
        while readings < self.count.unwrap_or(u64::MAX) && !stop.load(Ordering::Relaxed) {
            let celsius = form.shows_celsius().then_some(&mut celsius);
            let step = match step(source, celsius, &mut model, &now) {
                // Who has asked us to end does not ask why there is no answer.
                Err(_) if stop.load(Ordering::Relaxed) => break,
                step => step?,
            };
            readings += u64::from(step == Step::Reading);
            model.line_errors = source.line_errors();
            if output.is_none() && (model.answered > 0 || rate.is_none()) {
                output = Some(form.open()?);
                control = control.or_else(|| {
                    let connection = connection.filter(|_| form == Form::Screen)?;
                    self.open(connection, &mut model)
                });
            }
            if form == Form::Screen
                && told.is_due(now())
                && let Some(control) = source.adapter().or(control.as_mut())
            {
                ask_adapter(control, &mut model);
            }
            let wait = rate.map_or(Duration::ZERO, |rate| until_next(now(), rate));
            let Some(output) = &mut output else {
                thread::sleep(wait);
                continue;
            };
            output.show(&model, now(), step)?;
            if output.wait(wait)? {
                break;
            }
        }
        Ok(())
    }

    /// The control port that the user named, with an adapter that answers there.
    fn named(&self, connection: &Connection) -> Result<ControlLink, Error> {
        let mut control = self.place.control(connection)?;
        identify(&mut control)?;
        Ok(control)
    }

    /// The control port of the adapter there, if there is one, and if it can be opened: a monitor can do without.
    fn open(&self, connection: &Connection, model: &mut Model) -> Option<ControlLink> {
        match self.place.control(connection) {
            Ok(control) => Some(control),
            Err(Error::NoControl { .. }) => None,
            Err(problem) => {
                let told = Err(problem.to_string());
                let name = "not reached".to_owned();
                model.adapter = Some(Adapter { name, told });
                None
            }
        }
    }
}

/// Takes what the source has to tell into the model: a reading, and after it the temperatures, if they are due.
fn step(
    source: &mut dyn Source,
    celsius: Option<&mut Timer>,
    model: &mut Model,
    now: &dyn Fn() -> time::Instant,
) -> Result<Step, Error> {
    let begun = now();
    model.asked += u64::from(source.is_asked());
    let step = take(source.read(), model, source.is_asked().then_some(begun), now())?;
    if step == Step::Reading && celsius.is_some_and(|timer| timer.is_due(now())) {
        let news = source.read_celsius();
        take(news, model, None, now())?;
    }
    Ok(step)
}

/// Takes news into the model. `begun` is when the call began, if there was one.
fn take(
    news: Result<News, Error>,
    model: &mut Model,
    begun: Option<time::Instant>,
    now: time::Instant,
) -> Result<Step, Error> {
    match news {
        Ok(News::Reading(facts, stamp)) => {
            model.read(Latest {
                facts,
                at: now,
                stamp,
                latency: begun.map(|begun| now.since(begun)),
            });
            Ok(Step::Reading)
        }
        Ok(News::Celsius(celsius)) => {
            model.celsius = celsius;
            Ok(Step::Nothing)
        }
        Ok(News::Notice(text)) => {
            model.notify(now, text);
            Ok(Step::Notice)
        }
        Ok(News::Nothing) => Ok(Step::Nothing),
        // Once it has answered, the arm may be switched off and on again.
        Err(problem @ Error::NoAnswer { .. }) if model.answered > 0 => {
            model.time_out(now, problem.to_string());
            Ok(Step::TimedOut)
        }
        Err(problem) => Err(problem),
    }
}

/// Asks an adapter for its counters; one that did not answer is not asked again.
fn ask_adapter(control: &mut ControlLink, model: &mut Model) {
    let name = match &model.adapter {
        Some(Adapter { told: Err(_), .. }) => return,
        Some(adapter) => Ok(adapter.name.clone()),
        None => identify(control).map(|identity| describe(&identity)),
    };
    let told = name.and_then(|name| Ok((name, counters(control)?, latencies(control)?)));
    model.adapter = Some(match told {
        Ok((name, counters, latencies)) => Adapter {
            name,
            told: Ok((counters, latencies)),
        },
        Err(problem) => Adapter {
            name: "does not answer".to_owned(),
            told: Err(problem.to_string()),
        },
    });
}

/// How long it is until the next reading of so many a second. After a pause in the line there is no catching up.
fn until_next(now: time::Instant, rate: u32) -> Duration {
    let period = 1_000_000 / u64::from(rate);
    Duration::from_micros(period - now.as_micros() % period)
}

/// Something that is done now and then.
struct Timer {
    period: time::Duration,
    due: time::Instant,
}

impl Timer {
    fn new(period: time::Duration) -> Self {
        let due = time::Instant::ZERO;
        Self { period, due }
    }

    /// Whether it is to be done now; then it is due again after its period.
    fn is_due(&mut self, now: time::Instant) -> bool {
        let is_due = self.due <= now;
        if is_due {
            self.due = now + self.period;
        }
        is_due
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_are_at_multiples_of_the_period_and_none_is_made_up_for() {
        let wait = |micros| until_next(time::Instant::from_micros(micros), 20).as_micros();
        assert_eq!(
            [0, 1, 49_999, 50_000, 170_000].map(wait),
            [50_000, 49_999, 1, 50_000, 30_000]
        );
    }

    #[test]
    fn what_is_done_now_and_then_is_not_made_up_for_either() {
        let mut watched = Timer::new(time::Duration::from_micros(100));
        let due = [0, 99, 100, 350, 440, 450].map(|now| watched.is_due(time::Instant::from_micros(now)));
        assert_eq!(due, [true, false, true, true, false, true]);
    }
}
