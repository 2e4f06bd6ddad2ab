//! A session of a monitor: it reads from its source, updates the model and shows it, also after a lost port.

use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::Duration;

use armwire_bridge::time;
use armwire_host::stopwatch::Stopwatch;
use armwire_host::{Connection, SilenceLimit};

use super::model::{Adapter, Latest, Model};
use super::output::{Form, Output, Step};
use super::reading::{News, Source};
use super::recorder::Recorder;
use crate::adapter::describe;
use crate::error::Error;
use crate::output::{print_error, print_line};
use crate::remedies::words;

/// Periods of requests for temperatures, for the gripper's stroke during a recording, and for the adapter's counters.
const CELSIUS_PERIOD: time::Duration = time::Duration::from_millis(5_000);
const STROKE_PERIOD: time::Duration = time::Duration::from_millis(5_000);
const ADAPTER_PERIOD: time::Duration = time::Duration::from_millis(1_000);
/// Period of attempts to open a lost port.
pub(crate) const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// A source, until its port is lost.
pub(super) struct Watched {
    pub(super) source: Box<dyn Source>,
    /// The adapter, unless it is the source, or the error of its port: a monitor works without it.
    pub(super) adapter: Option<Result<armwire_host::Adapter, armwire_host::Error>>,
    /// The arm's connection, which explains errors. `None` if the source is not on one.
    pub(super) connection: Option<Connection>,
}

/// A session of a monitor.
pub(super) struct Session<'a> {
    form: Form,
    count: Option<u64>,
    stop: &'a AtomicBool,
    clock: Stopwatch,
    /// The arm's connection, which explains missing answers.
    connection: Option<Connection>,
    model: Model,
    /// `None` before the first bytes or readings.
    output: Option<Box<dyn Output>>,
    celsius: Timer,
    stroke: Timer,
    adapter: Timer,
    /// True if any bytes arrived, noise included.
    has_received: bool,
    /// The reason of the port's loss, from then until the next reading.
    loss: Option<String>,
}

impl<'a> Session<'a> {
    /// A session that ends after `count` readings, or when `stop` is set.
    pub(super) fn new(port: &str, form: Form, count: Option<u64>, stop: &'a AtomicBool) -> Self {
        Self {
            form,
            count,
            stop,
            clock: Stopwatch::start(),
            connection: None,
            model: Model::new(port),
            output: None,
            celsius: Timer::new(CELSIUS_PERIOD),
            stroke: Timer::new(STROKE_PERIOD),
            adapter: Timer::new(ADAPTER_PERIOD),
            has_received: false,
            loss: None,
        }
    }

    /// Shows the readings of a source, at this rate if the source has none of its own, until the session ends.
    pub(super) fn watch(&mut self, watched: &mut Watched, rate: u32, recorder: &mut Recorder) -> Result<(), Error> {
        self.connection.clone_from(&watched.connection);
        let source = &mut *watched.source;
        let rate = source.is_paced().then_some(rate);
        self.model.watch(source.arm(), source.servos(), rate);
        // Counters from before the loss of the port are old.
        self.model.adapter = match &watched.adapter {
            Some(Err(error)) => Some(Adapter {
                name: "not reached".to_owned(),
                counts: Err(error.to_string()),
            }),
            _ => None,
        };
        let before = self.model.line_errors;
        while self.model.answered < self.count.unwrap_or(u64::MAX) && !self.is_stopped() {
            let step = self.step(source, recorder.is_on());
            recorder.write()?;
            let step = match step {
                // A stop may interrupt a call. Its error is no result.
                Err(_) if self.is_stopped() => break,
                step => step?,
            };
            if step == Step::Reading && self.loss.take().is_some() {
                self.notify(format!("{}: the port is back", self.model.port))?;
            }
            self.model.line_errors = before + source.line_errors();
            if self.output.is_none() && (self.has_received || rate.is_none()) {
                self.output = Some(self.form.open()?);
            }
            if self.form == Form::Screen && self.output.is_some() && self.adapter.is_due(self.clock.now()) {
                let other = watched.adapter.as_mut().and_then(|adapter| adapter.as_mut().ok());
                if let Some(control) = source.adapter().or(other) {
                    poll_adapter(control, &mut self.model);
                }
            }
            let wait = rate.map_or(Duration::ZERO, |rate| until_next(self.clock.now(), rate));
            if self.show(step, wait)? {
                break;
            }
        }
        Ok(())
    }

    /// Returns true if the port may come back after this error: it was lost after a reading, or it fails until its next
    /// reading.
    pub(super) fn may_come_back(&self, error: &Error) -> bool {
        match error {
            Error::Recording { .. } => false,
            Error::Host(armwire_host::Error::Lost { .. }) => self.loss.is_some() || self.model.answered > 0,
            _ => self.loss.is_some(),
        }
    }

    /// Shows that the port is lost, and waits for [`RETRY_PERIOD`]. Returns true if the user ends the monitor.
    pub(super) fn wait_for_port(&mut self, error: &Error) -> Result<bool, Error> {
        let text = error.to_string();
        let is_new = match &self.loss {
            None => {
                self.model.reconnects += 1;
                true
            }
            // Another arm on the port is news, or another program that has it. A port that is still missing is none.
            Some(before) => {
                use armwire_host::Error::{InUse, Lost};
                matches!(error, Error::Host(Lost { .. } | InUse { .. })) && *before != text
            }
        };
        if is_new {
            self.notify(format!("waiting for the port: {text}"))?;
            self.loss = Some(text);
        }
        Ok(self.show(Step::Nothing, RETRY_PERIOD)? || self.is_stopped())
    }

    /// Shows a notice.
    pub(super) fn notify(&mut self, text: String) -> Result<(), Error> {
        let now = self.clock.now();
        let Some(output) = &mut self.output else {
            print_error(&text);
            return Ok(());
        };
        self.model.notify(now, text);
        output.show(&self.model, now, Step::Notice)
    }

    /// Restores the terminal, and prints the summary in place of the screen.
    pub(super) fn close(&mut self) -> Result<(), Error> {
        match self.output.take() {
            Some(output) if self.form.has_sum() => {
                drop(output);
                print_line(self.model.summary(self.clock.now()))
            }
            _ => Ok(()),
        }
    }

    /// Shows the model after a step, and waits. Returns true if the user ends the monitor.
    fn show(&mut self, step: Step, wait: Duration) -> Result<bool, Error> {
        let now = self.clock.now();
        let Some(output) = &mut self.output else {
            thread::sleep(wait);
            return Ok(false);
        };
        output.show(&self.model, now, step)?;
        output.wait(wait)
    }

    /// Reads from the source, and after a reading the temperatures if they are due. During a recording the stroke is
    /// read before.
    fn step(&mut self, source: &mut dyn Source, is_recorded: bool) -> Result<Step, Error> {
        if is_recorded && self.stroke.is_due(self.clock.now()) {
            let news = source.read_stroke();
            self.take(news, None)?;
        }
        let begun = self.clock.now();
        self.model.requests += u64::from(source.is_polled());
        let step = self.take(source.read(), source.is_polled().then_some(begun))?;
        if step == Step::Reading && self.form.shows_celsius() && self.celsius.is_due(self.clock.now()) {
            let news = source.read_celsius();
            if self.take(news, None)? == Step::TimedOut {
                // Old ones would look like new ones.
                self.model.celsius.clear();
            }
        }
        Ok(step)
    }

    /// Updates the model with news. `begun` is the start of the call, if there was one.
    fn take(&mut self, news: Result<News, Error>, begun: Option<time::Instant>) -> Result<Step, Error> {
        let now = self.clock.now();
        let news = news.map_err(|error| match &self.connection {
            Some(connection) => error.explained(|error| connection.explain_by_system(error)),
            None => error,
        });
        match news {
            Ok(News::Reading(facts, stamp)) => {
                self.has_received = true;
                self.model.read(Latest {
                    facts,
                    at: now,
                    stamp,
                    latency: begun.map(|begun| now.since(begun)),
                });
                Ok(Step::Reading)
            }
            Ok(News::Celsius(celsius)) => {
                self.model.celsius = celsius;
                Ok(Step::Nothing)
            }
            Ok(News::Notice(text)) => {
                self.model.notify(now, text);
                Ok(Step::Notice)
            }
            Ok(News::Nothing) => Ok(Step::Nothing),
            // The line may be noisy, or the arm may be off for a while. At the beginning it is given up.
            Err(Error::Host(armwire_host::Error::NoAnswer {
                name,
                cause,
                hint,
                bytes,
                ..
            })) if bytes > 0 || self.has_received || now < time::Instant::ZERO + SilenceLimit::STOP.least() => {
                self.has_received |= bytes > 0;
                self.model
                    .time_out(now, format!("{name}: {cause}: {}", hint.with(words)));
                Ok(Step::TimedOut)
            }
            Err(error) => Err(error),
        }
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Reads the adapter's counters. After an error it is not polled again.
fn poll_adapter(control: &mut armwire_host::Adapter, model: &mut Model) {
    let name = match &model.adapter {
        Some(Adapter { counts: Err(_), .. }) => return,
        Some(adapter) => Ok(adapter.name.clone()),
        None => control.identify().map(|identity| describe(&identity).to_string()),
    };
    let counts = name.and_then(|name| Ok((name, control.counters()?, control.latencies()?)));
    model.adapter = Some(match counts {
        Ok((name, counters, latencies)) => Adapter {
            name,
            counts: Ok((counters, latencies)),
        },
        Err(error) => Adapter {
            name: "does not answer".to_owned(),
            counts: Err(error.to_string()),
        },
    });
}

/// Time until the next reading at this rate. Missed readings are skipped.
fn until_next(now: time::Instant, rate: u32) -> Duration {
    let period = 1_000_000 / u64::from(rate);
    Duration::from_micros(period - now.as_micros() % period)
}

/// A periodic action.
struct Timer {
    period: time::Duration,
    due: time::Instant,
}

impl Timer {
    fn new(period: time::Duration) -> Self {
        let due = time::Instant::ZERO;
        Self { period, due }
    }

    /// Returns true if the action is due. It is due again after its period.
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
    use std::time::Instant;

    use super::*;
    use armwire_host::LineErrors;
    use armwire_host::Missing;

    fn no_answer(bytes: usize) -> Error {
        armwire_host::Error::NoAnswer {
            name: "PORT".into(),
            cause: "no answer".into(),
            hint: "is it on?".into(),
            missing: Missing::Silent,
            bytes,
        }
        .into()
    }

    /// A session after the time for a first answer, on a line with these numbers of bytes instead of answers.
    fn without_answers(bytes: &[usize]) -> Result<(), Error> {
        let stop = AtomicBool::new(false);
        let mut session = Session::new("PORT", Form::Json, None, &stop);
        let before = Instant::now().checked_sub(2 * Duration::from(SilenceLimit::STOP.least()));
        session.clock = Stopwatch(before.unwrap());
        bytes
            .iter()
            .try_for_each(|&bytes| session.take(Err(no_answer(bytes)), None).map(drop))
    }

    /// An arm whose servos report a temperature once.
    struct Warm(Option<u8>);

    impl Source for Warm {
        fn arm(&self) -> &'static str {
            "an arm"
        }

        fn read(&mut self) -> Result<News, Error> {
            Ok(News::Reading(Vec::new(), None))
        }

        fn read_celsius(&mut self) -> Result<News, Error> {
            self.0
                .take()
                .map_or(Err(no_answer(0)), |celsius| Ok(News::Celsius(vec![celsius])))
        }

        fn line_errors(&self) -> LineErrors {
            LineErrors::default()
        }
    }

    #[test]
    fn temperatures_end_with_an_unanswered_request() {
        let stop = AtomicBool::new(false);
        let mut session = Session::new("PORT", Form::Json, None, &stop);
        let mut arm = Warm(Some(31));
        for expected in [&[31][..], &[]] {
            session.celsius = Timer::new(CELSIUS_PERIOD);
            session.step(&mut arm, false).unwrap();
            assert_eq!(session.model.celsius, expected);
        }
        assert_eq!(session.model.timed_out, 1);
    }

    #[test]
    fn silence_after_noise_does_not_end_it() {
        assert!(without_answers(&[8, 0, 0]).is_ok());
        assert!(without_answers(&[0]).is_err());
    }

    #[cfg(target_os = "linux")]
    #[test]
    fn missing_answer_names_another_user_of_the_port() {
        let pty = armwire_sim::pty::Pty::open(None).unwrap();
        let theirs = std::fs::File::open(pty.path()).unwrap();
        let mut thief = std::process::Command::new("sleep")
            .arg("600")
            .stdin(theirs)
            .spawn()
            .unwrap();
        let stop = AtomicBool::new(false);
        let mut session = Session::new("PORT", Form::Json, None, &stop);
        session.connection = Some(armwire_host::open(pty.path().to_str().unwrap()).unwrap());
        session.take(Err(no_answer(1)), None).unwrap();
        thief.kill().unwrap();
        thief.wait().unwrap();
        let notice = session.model.notice.unwrap();
        assert!(
            notice.contains("also open in another program, sleep (process"),
            "{notice}"
        );
    }

    #[test]
    fn missed_readings_are_not_made_up_for() {
        let wait = |micros| until_next(time::Instant::from_micros(micros), 20).as_micros();
        assert_eq!(
            [0, 1, 49_999, 50_000, 170_000].map(wait),
            [50_000, 49_999, 1, 50_000, 30_000]
        );
    }

    #[test]
    fn missed_timers_are_not_made_up_for() {
        let mut watched = Timer::new(time::Duration::from_micros(100));
        let due = [0, 99, 100, 350, 440, 450].map(|now| watched.is_due(time::Instant::from_micros(now)));
        assert_eq!(due, [true, false, true, true, false, true]);
    }
}
