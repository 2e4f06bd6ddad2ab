//! Counts of teleoperation.

use armwire::time::{Duration, Instant};

/// The longest lag that is told from longer ones, in milliseconds.
const MAX_LAG: usize = 1_000;
/// The time in which the rate is counted.
const RATE_TIME: Duration = Duration::from_millis(1_000);

/// Counts so far.
#[derive(Debug, Default)]
pub(super) struct Sums {
    moves: u64,
    /// Readings of each arm that did not come within their period.
    lost: [u64; 2],
    /// The number of readings of the follower with each lag, in milliseconds.
    lags: Vec<u64>,
    /// The start of the time in which the rate is counted, the moves before, and the last rate.
    rate_from: Instant,
    moves_before: u64,
    rate: f64,
}

impl Sums {
    /// Counts a move.
    pub(super) fn moved(&mut self) {
        self.moves += 1;
    }

    /// Counts the readings of the leader and of the follower in one period.
    pub(super) fn read(&mut self, leader: usize, follower: usize) {
        for (lost, came) in self.lost.iter_mut().zip([leader, follower]) {
            *lost += u64::from(came == 0);
        }
    }

    /// Counts a lag.
    pub(super) fn lag(&mut self, lag: Option<Duration>) {
        let Some(lag) = lag else { return };
        let millis = usize::try_from(lag.as_micros() / 1_000).unwrap_or(MAX_LAG).min(MAX_LAG);
        self.lags.resize(MAX_LAG + 1, 0);
        self.lags[millis] += 1;
    }

    /// The present rate, the lag and the losses, in words.
    pub(super) fn line(&mut self, now: Instant, lag: Option<Duration>) -> String {
        let span = now.since(self.rate_from);
        if span >= RATE_TIME {
            self.rate = (self.moves - self.moves_before) as f64 * 1e6 / span.as_micros() as f64;
            (self.rate_from, self.moves_before) = (now, self.moves);
        }
        let lag = lag.map_or("-".to_owned(), |lag| (lag.as_micros() / 1_000).to_string());
        let [leader, follower] = self.lost;
        format!(
            "{:.0} Hz  lag {lag} ms  lost readings: leader {leader}, follower {follower}",
            self.rate
        )
    }

    /// All, in words.
    pub(super) fn text(&self, now: Instant) -> String {
        let [leader, follower] = self.lost;
        let seconds = now.as_micros() as f64 / 1e6;
        let lag = match (self.percentile(50), self.percentile(99)) {
            (Some(median), Some(most)) => format!("lag {median} ms (median), {most} ms (p99), "),
            _ => String::new(),
        };
        format!(
            "{seconds:.1} s: moves {}, {lag}lost readings: leader {leader}, follower {follower}",
            self.moves
        )
    }

    /// The lag in milliseconds that so many of a hundred do not exceed. `None` without any.
    fn percentile(&self, percent: u64) -> Option<usize> {
        let all: u64 = self.lags.iter().sum();
        let mut below = 0;
        let counts = self.lags.iter().map(|count| {
            below += count;
            below
        });
        let mut counts = counts.enumerate();
        let found = counts.find(|(_, below)| *below > 0 && below * 100 >= all * percent);
        found.map(|(millis, _)| millis)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn lags_are_told_by_median_and_p99() {
        let mut sums = Sums::default();
        let now = Instant::from_millis(2_500);
        assert_eq!(sums.text(now), "2.5 s: moves 0, lost readings: leader 0, follower 0");
        for millis in 1..=100 {
            sums.lag(Some(Duration::from_millis(millis)));
        }
        sums.moved();
        sums.read(0, 2);
        let text = "2.5 s: moves 1, lag 50 ms (median), 99 ms (p99), lost readings: leader 1, follower 0";
        assert_eq!(sums.text(now), text);
    }

    #[test]
    fn rate_is_that_of_the_last_second() {
        let mut sums = Sums::default();
        for _ in 0..50 {
            sums.moved();
        }
        let line = sums.line(Instant::from_millis(1_000), Some(Duration::from_micros(17_900)));
        assert_eq!(line, "50 Hz  lag 17 ms  lost readings: leader 0, follower 0");
        let line = sums.line(Instant::from_millis(3_000), None);
        assert_eq!(line, "0 Hz  lag - ms  lost readings: leader 0, follower 0");
    }
}
