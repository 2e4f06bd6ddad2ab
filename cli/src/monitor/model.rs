//! The state of a monitor: readings, counts and history. It has no clock and no line.

use std::collections::VecDeque;

use armwire_bridge::control::{Latencies, Stamp};
use armwire_bridge::{Counters, Duration, Instant};
use armwire_host::LineErrors;
use armwire_host::describe::Fact;

/// Window of the measured rate.
const RATE_WINDOW: Duration = Duration::from_millis(2_000);
/// Time that a notice stays while readings arrive.
const NOTICE_TIME: Duration = Duration::from_millis(5_000);
/// Number of calls for the median.
const CALLS: usize = 1_000;
/// Duration of a sparkline's point, and maximum number of points.
const POINT_TIME: Duration = Duration::from_millis(100);
const POINTS: usize = 512;

/// The state of a monitor.
#[derive(Debug, Default)]
pub(super) struct Model {
    /// The port as typed by the user, and the name of the arm.
    pub(super) port: String,
    pub(super) arm: &'static str,
    /// The requested readings per second; `None` if the source has its own rate.
    pub(super) rate: Option<u32>,
    /// Maximum number of temperatures.
    pub(super) servos: usize,
    /// The newest reading.
    pub(super) latest: Option<Latest>,
    /// The last temperatures, in °C.
    pub(super) celsius: Vec<u8>,
    /// Numbers of requests, readings, and missing answers.
    pub(super) requests: u64,
    pub(super) answered: u64,
    pub(super) timed_out: u64,
    /// Number of times that the port was lost.
    pub(super) reconnects: u64,
    pub(super) line_errors: LineErrors,
    pub(super) adapter: Option<Adapter>,
    /// The last notice for the user.
    pub(super) notice: Option<String>,
    noticed: Instant,
    /// Times of the answers in the rate's window.
    answers: VecDeque<Instant>,
    /// The durations of the last calls, and the minimum and maximum of all.
    calls: VecDeque<Duration>,
    call_range: Option<(Duration, Duration)>,
    /// The history of each quantity, the newest point last, and the start of that point.
    history: Vec<VecDeque<Option<f64>>>,
    point: Option<Instant>,
}

/// A reading and its times.
#[derive(Clone, Debug)]
pub(super) struct Latest {
    pub(super) facts: Vec<Fact>,
    /// Time on the monitor's clock.
    pub(super) at: Instant,
    /// Time on the adapter's clock; `None` without a stamp.
    pub(super) stamp: Option<Stamp>,
    /// Duration of the call; `None` without a call.
    pub(super) latency: Option<Duration>,
}

/// An adapter and its counters.
#[derive(Clone, Debug)]
pub(super) struct Adapter {
    pub(super) name: String,
    pub(super) counts: Result<(Counters, Latencies), String>,
}

/// Durations of calls: minimum and maximum of all, and the median of the last ones.
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

    /// Sets the source of the next readings.
    pub(super) fn watch(&mut self, arm: &'static str, servos: usize, rate: Option<u32>) {
        // The name without its article.
        self.arm = arm.split_once(' ').map_or(arm, |(_, name)| name);
        self.servos = servos;
        self.rate = rate;
    }

    /// Takes a reading.
    pub(super) fn read(&mut self, latest: Latest) {
        let at = latest.at;
        self.answered += 1;
        self.answers.push_back(at);
        self.forget(at);
        if at.since(self.noticed) >= NOTICE_TIME {
            self.notice = None;
        }
        if let Some(latency) = latest.latency {
            self.add_call(latency);
        }
        self.remember(at, &latest.facts);
        self.latest = Some(latest);
    }

    fn add_call(&mut self, latency: Duration) {
        let (min, worst) = self.call_range.unwrap_or((latency, latency));
        self.call_range = Some((min.min(latency), worst.max(latency)));
        if self.calls.len() == CALLS {
            self.calls.pop_front();
        }
        self.calls.push_back(latency);
    }

    /// Counts a missing answer.
    pub(super) fn time_out(&mut self, now: Instant, why: String) {
        self.timed_out += 1;
        self.notify(now, why);
        self.forget(now);
    }

    /// Sets the notice. Readings remove it after [`NOTICE_TIME`].
    pub(super) fn notify(&mut self, now: Instant, text: String) {
        self.notice = Some(text);
        self.noticed = now;
    }

    /// Readings per second in the last [`RATE_WINDOW`].
    pub(super) fn achieved(&self, now: Instant) -> f64 {
        let mut recent = self.answers.iter().filter(|&&at| now.since(at) < RATE_WINDOW);
        let (Some(&first), Some(&last)) = (recent.next(), self.answers.back()) else {
            return 0.0;
        };
        let pauses = recent.count() as u64;
        let (span, quiet) = (last.since(first).as_micros(), now.since(last).as_micros());
        // A reading is late after twice the usual pause.
        let is_late = quiet * pauses > 2 * span;
        let span = if is_late { span + quiet } else { span };
        if span == 0 {
            0.0
        } else {
            pauses as f64 * 1e6 / span as f64
        }
    }

    /// Durations of calls; `None` before the first one.
    pub(super) fn call_times(&self) -> Option<CallTimes> {
        let (min, worst) = self.call_range?;
        let mut last: Vec<_> = self.calls.iter().copied().collect();
        last.sort_unstable();
        let median = *last.get(last.len() / 2)?;
        Some(CallTimes { min, median, worst })
    }

    /// The summary of a session, on one line.
    pub(super) fn summary(&self, now: Instant) -> String {
        let LineErrors {
            noise_bytes, checksums, ..
        } = self.line_errors;
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

    /// The history of a quantity, the newest point last; `None` for points without a value.
    pub(super) fn history(&self, quantity: usize) -> impl DoubleEndedIterator<Item = Option<f64>> + ExactSizeIterator {
        const NONE: &VecDeque<Option<f64>> = &VecDeque::new();
        self.history.get(quantity).unwrap_or(NONE).iter().copied()
    }

    fn forget(&mut self, now: Instant) {
        while self.answers.front().is_some_and(|&at| now.since(at) >= RATE_WINDOW) {
            self.answers.pop_front();
        }
    }

    /// Adds a reading to the history. A point is the last reading of its step, and empty without one.
    fn remember(&mut self, at: Instant, facts: &[Fact]) {
        let values: Vec<_> = facts
            .iter()
            .flat_map(|fact| &fact.items)
            .map(|item| item.value.as_f64())
            .collect();
        self.history.resize_with(values.len(), VecDeque::new);
        let step = POINT_TIME.as_micros();
        let steps = match self.point {
            Some(point) => (at.since(point).as_micros() / step).min(POINTS as u64),
            None => 1,
        };
        if steps > 0 {
            self.point = Some(Instant::from_micros(at.as_micros() / step * step));
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

#[cfg(test)]
pub(super) mod tests {
    use armwire_host::describe::number;
    use serde_json::Value;

    use super::*;

    /// Joints at these angles at `millis`, after a call of `micros`.
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
        assert_eq!(model.calls.len(), CALLS);
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
        model.requests += 1;
        model.read(latest(0, 900, &[Some(1.0)]));
        model.requests += 1;
        model.time_out(Instant::from_millis(300), "no answer".to_owned());
        assert_eq!((model.requests, model.answered, model.timed_out), (2, 1, 1));
        assert_eq!(model.notice.as_deref(), Some("no answer"));
        assert!(model.latest.is_some());
        model.read(latest(5_200, 900, &[Some(1.0)]));
        assert!(model.notice.is_some());
        model.read(latest(5_300, 900, &[Some(1.0)]));
        assert_eq!(model.notice, None);
    }
}
