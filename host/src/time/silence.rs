//! How long an arm may be silent: the limits of all uses, in one place.

use armwire::time::Duration;

/// A limit of the time without a reading. It is three periods of the readings at least: a slow reader is not a silent arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SilenceLimit(Duration);

impl SilenceLimit {
    /// A pose counts as the newest one.
    pub const POSE: Self = Self(Duration::from_millis(100));
    /// Teleoperation goes on; after it the follower rests, and follows again when both arms are read.
    pub const PAUSE: Self = Self(Duration::from_millis(150));
    /// A motion in time goes on; after it the motion fails.
    pub const FAILURE: Self = Self(Duration::from_millis(250));
    /// A port counts as good; after it the port is opened again.
    pub const PORT: Self = Self(Duration::from_millis(500));
    /// An arm that was sent a motion is waited for; after it the arm is asked to stop.
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
