//! Calls at a rate, and their durations.

use std::fmt::{self, Display};
use std::thread;
use std::time::{Duration, Instant};

use armwire_host::{self as host, Counts, Rate};

use crate::error::Error;
use crate::signals;

/// A call for the pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Call {
    /// A read, which waits for the arm.
    Read,
    /// The newest pose of a reader.
    Latest,
}

impl Display for Call {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Read => "read",
            Self::Latest => "latest",
        })
    }
}

/// The calls of one measurement.
#[derive(Debug)]
pub(super) struct Run {
    pub(super) call: Call,
    pub(super) rate: Rate,
    pub(super) is_loaded: bool,
    /// Durations of the calls.
    pub(super) calls: Durations,
    /// Ages of the poses at the end of the calls. Empty if they are unknown.
    pub(super) ages: Durations,
    /// Number of calls that were not begun in their period.
    pub(super) missed: u64,
    /// Number of calls without a pose.
    pub(super) failed: u64,
    /// Counts of the reader.
    pub(super) reader: Option<Counts>,
}

impl Run {
    /// The same, with or without load.
    pub(super) fn under(self, is_loaded: bool) -> Self {
        Self { is_loaded, ..self }
    }
}

/// Durations in ascending order.
#[derive(Debug, Default)]
pub(super) struct Durations(Vec<Duration>);

impl Durations {
    pub(super) fn new(mut durations: Vec<Duration>) -> Self {
        durations.sort_unstable();
        Self(durations)
    }

    /// The least duration that this share of them, in thousandths, does not exceed. `None` without any.
    pub(super) fn permille(&self, share: usize) -> Option<Duration> {
        let rank = (self.0.len() * share).div_ceil(1_000).max(1);
        self.0.get(rank - 1).copied()
    }

    pub(super) fn max(&self) -> Option<Duration> {
        self.0.last().copied()
    }

    pub(super) fn ascending(&self) -> &[Duration] {
        &self.0
    }
}

/// The times of calls, from the start of a measurement. A late call does not shift the next.
struct Grid {
    period: Duration,
    next: Duration,
}

impl Grid {
    const fn new(period: Duration) -> Self {
        Self {
            period,
            next: Duration::ZERO,
        }
    }

    /// The time of the next call, after one that ended at `now`. Calls whose periods have passed are left out.
    fn next(&mut self, now: Duration) -> Duration {
        while self.next + self.period <= now {
            self.next += self.period;
        }
        let next = self.next;
        self.next += self.period;
        next
    }
}

/// Makes a call in each period, for this time. The call returns the age of the pose, if it is known.
///
/// # Errors
///
/// Errors that a later call would have, too. The program is interrupted.
pub(super) fn measure(
    what: Call,
    rate: Rate,
    time: Duration,
    mut call: impl FnMut() -> Result<Option<Duration>, host::Error>,
) -> Result<Run, Error> {
    let (mut calls, mut ages, mut failed) = (Vec::new(), Vec::new(), 0);
    let mut grid = Grid::new(rate.period());
    let start = Instant::now();
    loop {
        let next = grid.next(start.elapsed());
        if next >= time {
            break;
        }
        signals::check().map_err(host::Error::Interrupted)?;
        thread::sleep(next.saturating_sub(start.elapsed()));
        let begun = Instant::now();
        let called = call();
        calls.push(begun.elapsed());
        match called {
            Ok(age) => ages.extend(age),
            Err(
                host::Error::NoAnswer { .. }
                | host::Error::NoPose { .. }
                | host::Error::Unacceptable { .. }
                | host::Error::ErrorFrame { .. },
            ) => failed += 1,
            Err(error) => return Err(error.into()),
        }
    }
    let periods = time.as_nanos().div_ceil(rate.period().as_nanos());
    let missed = periods.saturating_sub(calls.len() as u128);
    Ok(Run {
        call: what,
        rate,
        is_loaded: false,
        calls: Durations::new(calls),
        ages: Durations::new(ages),
        missed: missed.try_into().unwrap_or(u64::MAX),
        failed,
        reader: None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn percentile_is_the_least_that_its_share_holds() {
        let durations = Durations::new((1..=1_000).rev().map(Duration::from_micros).collect());
        let micros = [500, 990, 999, 1_000].map(|share| durations.permille(share).unwrap().as_micros());
        assert_eq!(micros, [500, 990, 999, 1_000]);
        assert_eq!(durations.max().unwrap().as_micros(), 1_000);
        let one = Durations::new(vec![Duration::from_micros(7)]);
        assert_eq!(one.permille(1), one.max());
        assert_eq!(Durations::default().permille(500), None);
    }

    #[test]
    fn passed_periods_are_not_made_up_for() {
        let mut grid = Grid::new(Duration::from_millis(10));
        let next = [0, 3, 12, 55, 56].map(|now| grid.next(Duration::from_millis(now)).as_millis());
        // The call at 20 ms took 35 ms: those at 30 and 40 ms are left out, and that at 50 ms is late.
        assert_eq!(next, [0, 10, 20, 50, 60]);
    }

    #[test]
    fn failed_calls_are_counted_and_fatal_ones_end() {
        let rate = Rate::new(1_000).unwrap();
        let mut calls = 0;
        let run = measure(Call::Read, rate, Duration::from_millis(3), || {
            calls += 1;
            let (name, reason) = ("fake".into(), host::NoPose::NotYet);
            Err(host::Error::NoPose { name, reason })
        });
        let run = run.unwrap();
        assert_eq!(run.failed, calls);
        assert_eq!(run.calls.ascending().len() as u64 + run.missed, 3);
        let lost = measure(Call::Read, rate, Duration::MAX, || {
            let name = "fake".into();
            Err(host::Error::Closed { name })
        });
        assert!(matches!(lost, Err(Error::Host(host::Error::Closed { .. }))));
    }
}
