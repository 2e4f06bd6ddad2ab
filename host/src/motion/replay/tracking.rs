//! The distances of an arm from the motion that it makes.

use armwire::ling::{JOINTS, JointState};

use crate::motion::axes::{Ticks, degrees};

/// The distances of readings from the motion at their times.
#[derive(Clone, Debug, Default)]
pub struct Tracking {
    readings: u64,
    /// In ticks.
    max: Ticks,
    /// The sums of the squares, in ticks².
    squares: Ticks,
    /// The distances from the last pose in the last reading, in ticks.
    end: Option<Ticks>,
}

impl Tracking {
    /// The number of readings.
    pub fn readings(&self) -> u64 {
        self.readings
    }

    /// The maximum of each joint, in degrees.
    pub fn max_degrees(&self) -> [f64; JOINTS] {
        self.max.map(degrees)
    }

    /// The root mean square of each joint, in degrees; 0 without readings.
    pub fn rms_degrees(&self) -> [f64; JOINTS] {
        let readings = self.readings.max(1) as f64;
        self.squares.map(|squares| degrees((squares / readings).sqrt()))
    }

    /// The distance of each joint from the last pose, in degrees; `None` until that was sent and a reading came.
    pub fn end_degrees(&self) -> Option<[f64; JOINTS]> {
        self.end.map(|end| end.map(degrees))
    }

    /// Takes a reading, at the last pose.
    pub(super) fn end(&mut self, pose: &Ticks, reading: &JointState) {
        self.end = Some(distances(pose, reading));
    }

    /// Adds a reading, at the time of this pose.
    pub(super) fn add(&mut self, pose: &Ticks, reading: &JointState) {
        self.readings += 1;
        for (joint, distance) in distances(pose, reading).into_iter().enumerate() {
            self.max[joint] = self.max[joint].max(distance);
            self.squares[joint] += distance * distance;
        }
    }
}

/// The distance of each joint from a pose, in ticks.
fn distances(pose: &Ticks, reading: &JointState) -> Ticks {
    std::array::from_fn(|joint| (f64::from(reading.joints[joint]) - pose[joint]).abs())
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;

    use super::*;

    #[test]
    fn maximum_and_mean_square_are_per_joint() {
        let mut tracking = Tracking::default();
        for ticks in [2_048, 2_059, 2_037] {
            let mut reading = JointState {
                joints: [2_048; JOINTS],
                gripper: 0,
                status: MotionStatus::Locked,
            };
            reading.joints[2] = ticks;
            tracking.add(&[2_048.0; JOINTS], &reading);
        }
        assert_eq!(tracking.readings(), 3);
        let [_, _, max, ..] = tracking.max_degrees();
        assert!((max - 0.967).abs() < 0.001, "{max}");
        let [first, _, rms, ..] = tracking.rms_degrees();
        assert!(first == 0.0 && (rms - 0.789).abs() < 0.001, "{rms}");
    }
}
