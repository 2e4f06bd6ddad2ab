//! The limits of an arm's silence, one for each reaction.

use armwire::time::Duration;

/// A limit of the time without a reading, and the reaction after it. A reaction that costs more has a longer limit.
///
/// [`STALE`](Self::STALE) to [`REOPEN`](Self::REOPEN) are limits of readings at a rate. They are three periods at least: a
/// slow reader is not a silent arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilenceLimit(Duration);

impl SilenceLimit {
    /// A pose becomes stale, and is not given as the newest one. An answer takes 1 ms, and CAN adds tens: a reading
    /// that comes later was lost, and the reader has given it up.
    pub const STALE: Self = Self(Duration::from_millis(100));
    /// Teleoperation pauses: the follower is stopped, and follows again when both arms are read. It outlasts
    /// the loss of ten readings in a row, and a leader moved at 90°/s is 14° ahead by then.
    pub const PAUSE: Self = Self(Duration::from_millis(150));
    /// A motion in time fails, and its time is lost. It outlasts a hiccup of a busy computer: 164 ms
    /// were seen. A pause can be resumed, a failure cannot.
    pub const FAIL: Self = Self(Duration::from_millis(250));
    /// A port is opened again, which takes tenths of a second in which nothing is read. It is the adapter's
    /// default for a silent host.
    pub const REOPEN: Self = Self(Duration::from_millis(500));
    /// An arm that is waited for is given up: one in motion is asked to stop. The wait outlasts a call with its
    /// repeats and the late answer several times.
    pub const STOP: Self = Self(Duration::from_millis(2_000));

    /// The limit, without a period.
    pub const fn least(self) -> Duration {
        self.0
    }

    /// The limit for readings at this period.
    pub fn at(self, period: Duration) -> Duration {
        self.0.max(Duration::from_micros(period.as_micros().saturating_mul(3)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn slow_readings_are_no_silence() {
        let at = |millis| SilenceLimit::PAUSE.at(Duration::from_millis(millis)).as_micros() / 1_000;
        assert_eq!([10, 50, 51].map(at), [150, 150, 153]);
    }
}
