//! The commanded motion of one axis, in exact integer arithmetic.
//!
//! Speed in ticks per second times time in microseconds is a whole number of millionths of a tick. Positions are stored
//! in millionths: nothing is rounded, and the result does not depend on the number of time steps.

use armwire::time::Duration;

/// Millionths of a tick in a tick.
const MICRO: i64 = 1_000_000;

/// A point that moves to its target at constant speed and stays there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Trajectory {
    /// In millionths of a tick.
    position: i64,
    /// In millionths of a tick.
    target: i64,
    /// In ticks per second, which are millionths of a tick per microsecond.
    speed: u16,
}

impl Trajectory {
    /// Creates a trajectory at rest.
    pub(super) fn at(ticks: u16) -> Self {
        Self::at_micro(i64::from(ticks) * MICRO)
    }

    fn at_micro(position: i64) -> Self {
        Self {
            position,
            target: position,
            speed: 0,
        }
    }

    /// Creates a trajectory at rest at a position between two ticks.
    pub(super) fn at_exactly(ticks: f64) -> Self {
        Self::at_micro((ticks * MICRO as f64).round() as i64)
    }

    pub(super) fn go(&mut self, ticks: u16, speed: u16) {
        self.target = i64::from(ticks) * MICRO;
        self.speed = speed;
    }

    pub(super) fn stop(&mut self) {
        self.target = self.position;
        self.speed = 0;
    }

    /// Advances time and returns the distance travelled, in millionths of a tick.
    pub(super) fn advance(&mut self, span: Duration) -> u64 {
        let reach = i64::try_from(span.as_micros())
            .unwrap_or(i64::MAX)
            .saturating_mul(i64::from(self.speed));
        let travel = (self.target - self.position).clamp(-reach, reach);
        self.position += travel;
        travel.unsigned_abs()
    }

    /// Returns the position in ticks, not rounded.
    pub(super) fn exact_ticks(&self) -> f64 {
        self.position as f64 / MICRO as f64
    }

    /// Returns the position, rounded to the nearest tick.
    pub(super) fn ticks(&self) -> u16 {
        let nearest = (self.position + MICRO / 2) / MICRO;
        u16::try_from(nearest).unwrap_or(u16::MAX)
    }

    /// Returns the speed in ticks per second, without direction.
    pub(super) fn velocity(&self) -> u16 {
        if self.position == self.target { 0 } else { self.speed }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn position_is_independent_of_polling() {
        let (mut once, mut often) = (Trajectory::at(2048), Trajectory::at(2048));
        once.go(4095, 777);
        often.go(4095, 777);
        let travelled = (0..1_000_000)
            .map(|_| often.advance(Duration::from_micros(1)))
            .sum::<u64>();
        assert_eq!(once.advance(Duration::from_micros(1_000_000)), travelled);
        assert_eq!(once, often);
        assert_eq!(once.ticks(), 2048 + 777);
    }

    #[test]
    fn repeatedly_commanded_slow_motion_still_arrives() {
        let mut point = Trajectory::at(2048);
        for _ in 0..1_000 {
            point.go(2000, 1);
            point.advance(Duration::from_millis(1));
        }
        assert_eq!(point.ticks(), 2047);
    }

    #[test]
    fn it_stops_exactly_at_the_target() {
        let mut point = Trajectory::at(0);
        point.go(4095, 5000);
        assert_eq!(point.velocity(), 5000);
        point.advance(Duration::from_micros(u64::MAX));
        assert_eq!((point.ticks(), point.velocity()), (4095, 0));
    }

    #[test]
    fn at_speed_zero_it_does_not_move() {
        let mut point = Trajectory::at(100);
        point.go(200, 0);
        point.advance(Duration::from_micros(u64::MAX));
        assert_eq!((point.ticks(), point.velocity()), (100, 0));
    }
}
