//! What a monitor knows: it takes what was learnt and when, and has no clock and no line of its own.

use std::collections::VecDeque;

use armwire_bridge::control::{Latencies, Stamp};
use armwire_bridge::{Duration, Instant};
use serde_json::{Map, Value};

use super::reading::LineErrors;
use crate::describe::Fact;

/// For how long answers count for the rate.
const WINDOW: Duration = Duration::from_millis(2_000);
/// How long a notice stays while readings come.
const NOTICE: Duration = Duration::from_millis(5_000);
/// Of how many calls the median is.
const CALLS: usize = 1_000;
/// What one point of a sparkline stands for, and how many are kept.
const STEP: Duration = Duration::from_millis(100);
const POINTS: usize = 512;

/// All that a monitor knows.
#[derive(Debug, Default)]
pub(super) struct Model {
    /// What the user calls the port, and which arm it is.
    pub(super) port: String,
    pub(super) arm: &'static str,
    /// How many readings a second there should be; `None` if it is not for us to say.
    pub(super) rate: Option<u32>,
    /// How many temperatures it may have.
    pub(super) servos: usize,
    /// The newest reading.
    pub(super) latest: Option<Latest>,
    /// Temperatures, as the arm told them last, in °C.
    pub(super) celsius: Vec<u8>,
    /// How often it was asked, answered, and did not.
    pub(super) asked: u64,
    pub(super) answered: u64,
    pub(super) timed_out: u64,
    /// How often its port was gone.
    pub(super) reconnects: u64,
    pub(super) line_errors: LineErrors,
    pub(super) adapter: Option<Adapter>,
    /// The last thing that the user should know.
    pub(super) notice: Option<String>,
    noticed: Instant,
    /// When the answers of the last time came.
    answers: VecDeque<Instant>,
    calls: Calls,
    /// The past of each quantity, the newest last, and when that point began.
    history: Vec<VecDeque<Option<f64>>>,
    point: Option<Instant>,
}

/// A reading, and what is known of its time.
#[derive(Clone, Debug)]
pub(super) struct Latest {
    pub(super) facts: Vec<Fact>,
    /// On the monitor's clock.
    pub(super) at: Instant,
    /// On the adapter's clock, if it stamped it.
    pub(super) stamp: Option<Stamp>,
    /// How long the call took, if there was one.
    pub(super) latency: Option<Duration>,
}

/// What an adapter told of itself.
#[derive(Clone, Debug)]
pub(super) struct Adapter {
    pub(super) name: String,
    pub(super) told: Result<(Map<String, Value>, Latencies), String>,
}

/// How long calls took.
#[derive(Debug, Default)]
struct Calls {
    last: VecDeque<Duration>,
    range: Option<(Duration, Duration)>,
}

/// How long calls took: the shortest and the longest of all, and the median of the last ones.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct CallTimes {
    pub(super) min: Duration,
    pub(super) median: Duration,
    pub(super) worst: Duration,
}

impl Model {
    pub(super) fn new(port: &str) -> Self {
        let port = port.to_owned();
        Self {
            port,
            ..Self::default()
        }
    }

    /// What is watched from now on.
    pub(super) fn watch(&mut self, arm: &'static str, servos: usize, rate: Option<u32>) {
        // Without its article.
        self.arm = arm.split_once(' ').map_or(arm, |(_, name)| name);
        self.servos = servos;
        self.rate = rate;
    }

    /// A reading came.
    pub(super) fn read(&mut self, latest: Latest) {
        let at = latest.at;
        self.answered += 1;
        self.answers.push_back(at);
        self.forget(at);
        if at.since(self.noticed) >= NOTICE {
            self.notice = None;
        }
        if let Some(latency) = latest.latency {
            self.calls.add(latency);
        }
        self.remember(at, &latest.facts);
        self.latest = Some(latest);
    }

    /// The arm did not answer.
    pub(super) fn time_out(&mut self, now: Instant, why: String) {
        self.timed_out += 1;
        self.notify(now, why);
        self.forget(now);
    }

    /// Something is worth telling, until others have been read for a while.
    pub(super) fn notify(&mut self, now: Instant, text: String) {
        self.notice = Some(text);
        self.noticed = now;
    }

    /// Readings per second of late.
    pub(super) fn achieved(&self, now: Instant) -> f64 {
        let mut recent = self.answers.iter().filter(|&&at| now.since(at) < WINDOW);
        let (Some(&first), Some(&last)) = (recent.next(), self.answers.back()) else {
            return 0.0;
        };
        let pauses = recent.count() as u64;
        let (span, quiet) = (last.since(first).as_micros(), now.since(last).as_micros());
        // What has not come yet is missing only after twice the usual pause.
        let is_late = quiet * pauses > 2 * span;
        let span = if is_late { span + quiet } else { span };
        if span == 0 {
            0.0
        } else {
            pauses as f64 * 1e6 / span as f64
        }
    }

    /// How long calls took, once there was one.
    pub(super) fn call_times(&self) -> Option<CallTimes> {
        let (min, worst) = self.calls.range?;
        let mut last: Vec<_> = self.calls.last.iter().copied().collect();
        last.sort_unstable();
        let median = *last.get(last.len() / 2)?;
        Some(CallTimes { min, median, worst })
    }

    /// What was learnt in all, on one line.
    pub(super) fn summary(&self, now: Instant) -> String {
        let LineErrors { noise_bytes, checksums } = self.line_errors;
        let latency = self.call_times().map_or(String::new(), |times| {
            let [least, median, worst] = [times.min, times.median, times.worst].map(millis);
            format!(", latency {least} to {worst}, median {median}")
        });
        format!(
            "{} ({}), {:.1} s: readings {}, unanswered {}, wrong checksums {checksums}, noise bytes {noise_bytes}, port lost \
             {}{latency}",
            self.port,
            self.arm,
            now.as_micros() as f64 / 1e6,
            self.answered,
            self.timed_out,
            self.reconnects
        )
    }

    /// The past of a quantity, the newest last; `None` where there was no value.
    pub(super) fn history(&self, quantity: usize) -> impl DoubleEndedIterator<Item = Option<f64>> + ExactSizeIterator {
        const NONE: &VecDeque<Option<f64>> = &VecDeque::new();
        self.history.get(quantity).unwrap_or(NONE).iter().copied()
    }

    fn forget(&mut self, now: Instant) {
        while self.answers.front().is_some_and(|&at| now.since(at) >= WINDOW) {
            self.answers.pop_front();
        }
    }

    /// Takes a reading into the sparklines: a point is the last reading of its step, and empty where there was none.
    fn remember(&mut self, at: Instant, facts: &[Fact]) {
        let values: Vec<_> = facts
            .iter()
            .flat_map(|fact| &fact.items)
            .map(|item| item.value.as_f64())
            .collect();
        self.history.resize_with(values.len(), VecDeque::new);
        let steps = match self.point {
            Some(point) => (at.since(point).as_micros() / STEP.as_micros()).min(POINTS as u64),
            None => 1,
        };
        if steps > 0 {
            self.point = Some(Instant::from_micros(
                at.as_micros() / STEP.as_micros() * STEP.as_micros(),
            ));
        }
        for (history, value) in self.history.iter_mut().zip(values) {
            for _ in 0..steps {
                history.push_back(None);
            }
            while history.len() > POINTS {
                history.pop_front();
            }
            if let Some(point) = history.back_mut() {
                *point = value;
            }
        }
    }
}

/// A duration in words.
pub(super) fn millis(time: Duration) -> String {
    format!("{:.2} ms", time.as_micros() as f64 / 1e3)
}

impl Calls {
    fn add(&mut self, latency: Duration) {
        let (min, worst) = self.range.unwrap_or((latency, latency));
        self.range = Some((min.min(latency), worst.max(latency)));
        if self.last.len() == CALLS {
            self.last.pop_front();
        }
        self.last.push_back(latency);
    }
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::describe::number;

    /// Joints at these angles at a time in milliseconds, after a call of so many microseconds.
    pub(in super::super) fn latest(millis: u64, micros: u64, joints: &[Option<f32>]) -> Latest {
        let values = joints.iter().map(|radians| match radians {
            Some(radians) => (number(f64::from(*radians)), format!("{radians} rad")),
            None => (Value::Null, "?".to_owned()),
        });
        Latest {
            facts: vec![
                Fact::each(("joints", "joint"), "rad", "", values),
                Fact::words("status", "locked"),
            ],
            at: Instant::from_millis(millis),
            stamp: None,
            latency: Some(Duration::from_micros(micros)),
        }
    }

    #[test]
    fn rate_is_recent_and_falls_to_zero() {
        let mut model = Model::default();
        let at = Instant::from_millis;
        assert_eq!(model.achieved(at(0)), 0.0);
        for n in 0..=10 {
            model.read(latest(n * 50, 900, &[]));
        }
        assert_eq!(model.achieved(at(500)), 20.0);
        for n in 11..=100 {
            model.read(latest(n * 50, 900, &[]));
        }
        assert_eq!(model.achieved(at(5_040)), 20.0);
        assert!(
            (9.0..=10.0).contains(&model.achieved(at(6_000))),
            "{}",
            model.achieved(at(6_000))
        );
        assert_eq!(model.achieved(at(7_000)), 0.0);
        assert_eq!((model.answered, model.timed_out), (101, 0));
    }

    #[test]
    fn call_times_have_extremes_and_recent_median() {
        let mut model = Model::default();
        assert_eq!(model.call_times(), None);
        model.read(latest(0, 100, &[]));
        for _ in 0..3 * CALLS {
            model.read(latest(0, 900, &[]));
        }
        model.read(latest(0, 5_000, &[]));
        let times = model.call_times().unwrap();
        assert_eq!(
            [times.min, times.median, times.worst],
            [100, 900, 5_000].map(Duration::from_micros)
        );
        assert_eq!(model.calls.last.len(), CALLS);
    }

    #[test]
    fn history_keeps_the_last_reading_of_each_step() {
        let mut model = Model::default();
        for (millis, radians) in [(0, 0.0), (50, 0.1), (100, 0.2), (130, 0.3), (420, 0.4)] {
            model.read(latest(millis, 900, &[Some(radians), None]));
        }
        let past = |quantity| {
            model
                .history(quantity)
                .map(|value| value.map(|value| value as f32))
                .collect::<Vec<_>>()
        };
        assert_eq!(past(0), [Some(0.1), Some(0.3), None, None, Some(0.4)]);
        assert_eq!(past(1), [None; 5]);
        assert_eq!(model.history(3).len(), 0);
        model.read(latest(3_600_000, 900, &[Some(0.5), None]));
        assert_eq!(model.history(0).len(), POINTS);
    }

    #[test]
    fn timeouts_are_counted_and_keep_the_reading() {
        let mut model = Model::new("COM3");
        model.asked += 1;
        model.read(latest(0, 900, &[Some(1.0)]));
        model.asked += 1;
        model.time_out(Instant::from_millis(300), "no answer".to_owned());
        assert_eq!((model.asked, model.answered, model.timed_out), (2, 1, 1));
        assert_eq!(model.notice.as_deref(), Some("no answer"));
        assert!(model.latest.is_some());
        model.read(latest(5_200, 900, &[Some(1.0)]));
        assert!(model.notice.is_some());
        model.read(latest(5_300, 900, &[Some(1.0)]));
        assert_eq!(model.notice, None);
    }
}
