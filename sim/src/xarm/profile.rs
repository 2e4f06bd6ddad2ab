//! A trapezoidal velocity profile.

use armwire::time::Duration;

/// Motion from rest to rest over a distance, with given acceleration and maximum speed.
///
/// It is a function of time: the position does not depend on the polling rate.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Profile {
    distance: f64,
    /// Highest speed reached.
    peak: f64,
    acceleration: f64,
}

impl Profile {
    /// Computes a profile. All values are positive and finite, but the distance may be zero, and the acceleration
    /// infinite.
    pub(super) fn new(distance: f64, speed: f64, acceleration: f64) -> Self {
        Self {
            distance,
            // An infinite acceleration over no distance is no number: `min` takes the speed.
            peak: speed.min((distance * acceleration).sqrt()),
            acceleration,
        }
    }

    pub(super) fn duration(&self) -> Duration {
        if self.peak > 0.0 {
            Duration::from_micros((self.seconds() * 1e6).ceil() as u64)
        } else {
            Duration::ZERO
        }
    }

    fn seconds(&self) -> f64 {
        self.distance / self.peak + self.peak / self.acceleration
    }

    /// Returns the fraction of the distance covered, and its rate, per second.
    pub(super) fn at(&self, time: Duration) -> (f64, f64) {
        if time >= self.duration() {
            return (1.0, 0.0);
        }
        let time = time.as_micros() as f64 / 1e6;
        let left = (self.seconds() - time).max(0.0);
        let ramp = self.peak / self.acceleration;
        let (gone, speed) = if time < ramp {
            (self.acceleration * time * time / 2.0, self.acceleration * time)
        } else if left < ramp {
            (
                self.distance - self.acceleration * left * left / 2.0,
                self.acceleration * left,
            )
        } else {
            (self.peak * (time - ramp / 2.0), self.peak)
        };
        (gone / self.distance, speed / self.distance)
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    #[test]
    fn only_a_long_way_has_a_cruise() {
        // 1 s up, 9 s at 1/s, 1 s down.
        let long = Profile::new(10.0, 1.0, 1.0);
        assert_eq!(long.duration(), Duration::from_millis(11_000));
        assert_eq!(long.at(Duration::from_millis(500)), (0.0125, 0.05));
        assert_eq!(long.at(Duration::from_millis(5_500)), (0.5, 0.1));
        assert_eq!(long.at(Duration::from_millis(10_500)), (0.9875, 0.05));

        // 1 s up, 1 s down.
        let short = Profile::new(1.0, 5.0, 1.0);
        assert_eq!(short.duration(), Duration::from_millis(2_000));
        assert_eq!(short.at(Duration::from_millis(1_000)), (0.5, 1.0));
    }

    #[test]
    fn zero_distance_takes_no_time() {
        for acceleration in [1.0, f64::INFINITY] {
            let none = Profile::new(0.0, 1.0, acceleration);
            assert_eq!(none.duration(), Duration::ZERO);
            assert_eq!(none.at(Duration::ZERO), (1.0, 0.0));
        }
    }

    #[test]
    fn infinite_acceleration_is_a_constant_speed() {
        let profile = Profile::new(2.0, 4.0, f64::INFINITY);
        assert_eq!(profile.duration(), Duration::from_millis(500));
        assert_eq!(profile.at(Duration::ZERO), (0.0, 2.0));
        assert_eq!(profile.at(Duration::from_millis(125)), (0.25, 2.0));
        assert_eq!(profile.at(Duration::from_millis(500)), (1.0, 0.0));
    }

    proptest! {
        #[test]
        fn profile_keeps_limits_and_ends_at_target(
            distance in 1e-3..10.0, speed in 1e-3..4.0, acceleration in 1e-2..20.0,
        ) {
            let profile = Profile::new(distance, speed, acceleration);
            let steps = 1_000;
            let step = (profile.duration().as_micros() / steps).max(1);
            let mut before = (0.0, 0.0);
            for i in 1..=steps {
                let (gone, rate) = profile.at(Duration::from_micros(i * step));
                prop_assert!(gone >= before.0 && gone <= 1.0 + 1e-9);
                prop_assert!(rate * distance <= speed * (1.0 + 1e-9));
                let change = (rate - before.1).abs() * distance;
                prop_assert!(change <= acceleration * step as f64 / 1e6 * (1.0 + 1e-6) + acceleration * 2e-6);
                before = (gone, rate);
            }
            prop_assert!(profile.at(profile.duration()) == (1.0, 0.0));
        }
    }
}
