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

    /// Adds a reading, at the time of this pose.
    pub(super) fn add(&mut self, pose: &Ticks, reading: &JointState) {
        self.readings += 1;
        for (joint, ticks) in reading.joints.into_iter().enumerate() {
            let distance = (f64::from(ticks) - pose[joint]).abs();
            self.max[joint] = self.max[joint].max(distance);
            self.squares[joint] += distance * distance;
        }
    }
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
