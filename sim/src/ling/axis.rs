//! One axis in motion, in exact integer arithmetic.
//!
//! Speed in ticks per second times time in microseconds is a whole number of millionths of a tick. Positions are stored
//! in millionths: nothing is rounded, and the result does not depend on the number of time steps.

use armwire::time::Duration;

/// Millionths of a tick in a tick.
const MICRO: i64 = 1_000_000;

/// A joint or the gripper: it moves to its target at constant speed and stays there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Axis {
    /// In millionths of a tick.
    position: i64,
    /// In millionths of a tick.
    target: i64,
    /// In ticks per second, which are millionths of a tick per microsecond.
    speed: u16,
}

impl Axis {
    /// Creates an axis at rest.
    pub(super) fn at(ticks: u16) -> Self {
        let position = i64::from(ticks) * MICRO;
        Self {
            position,
            target: position,
            speed: 0,
        }
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
        let (mut once, mut often) = (Axis::at(2048), Axis::at(2048));
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
        let mut axis = Axis::at(2048);
        for _ in 0..1_000 {
            axis.go(2000, 1);
            axis.advance(Duration::from_millis(1));
        }
        assert_eq!(axis.ticks(), 2047);
    }

    #[test]
    fn it_stops_exactly_at_the_target() {
        let mut axis = Axis::at(0);
        axis.go(4095, 5000);
        assert_eq!(axis.velocity(), 5000);
        axis.advance(Duration::from_micros(u64::MAX));
        assert_eq!((axis.ticks(), axis.velocity()), (4095, 0));
    }

    #[test]
    fn at_speed_zero_it_does_not_move() {
        let mut axis = Axis::at(100);
        axis.go(200, 0);
        axis.advance(Duration::from_micros(u64::MAX));
        assert_eq!((axis.ticks(), axis.velocity()), (100, 0));
    }
}
