//! The named actions of a virtual Alpha1.
//!
//! They belong to this simulation, not to the real robot. Servos 1 to 3 are one arm and 4 to 6 the other. Servos 7 to
//! 11 are one leg and 12 to 16 the other. Standing is the middle position of all servos.

use armwire::alpha1::Angle;
use armwire::time::Duration;

use super::SERVOS;

/// The servos' target angles, and the timing of the motion to them.
#[derive(Debug)]
pub(super) struct Pose {
    pub(super) angles: [Angle; SERVOS],
    /// Duration of the motion.
    pub(super) duration: Duration,
    /// Time from the start of this pose to the start of the next, or to the end of the action.
    pub(super) interval: Duration,
}

/// A sequence of poses with a name.
#[derive(Debug)]
pub(super) struct NamedAction {
    pub(super) name: &'static str,
    pub(super) poses: &'static [Pose],
}

impl NamedAction {
    pub(super) fn find(name: &[u8]) -> Option<&'static Self> {
        ACTIONS.iter().find(|action| action.name.as_bytes() == name)
    }
}

pub(super) const ACTIONS: &[NamedAction] = &[
    NamedAction {
        name: "stand",
        poses: &[pose(&[], 1_000, 1_000)],
    },
    NamedAction {
        name: "wave",
        poses: &[
            pose(&[(1, 180)], 600, 600),
            pose(&[(1, 180), (2, 120)], 300, 300),
            pose(&[(1, 180), (2, 60)], 300, 300),
            pose(&[(1, 180), (2, 120)], 300, 300),
            pose(&[], 600, 800),
        ],
    },
    NamedAction {
        name: "dance",
        poses: &[
            pose(&[(1, 150), (4, 30), (8, 110), (13, 110)], 400, 400),
            pose(&[(1, 30), (4, 150), (8, 70), (13, 70)], 400, 400),
            pose(&[(2, 150), (5, 30), (9, 110), (14, 70)], 400, 600),
            pose(&[(2, 30), (5, 150), (9, 70), (14, 110)], 400, 600),
            pose(&[], 1_000, 1_000),
        ],
    },
];

/// Returns the standing pose with changed servos: number from 1, angle in degrees. Times are in milliseconds.
const fn pose(changes: &[(usize, u8)], duration: u64, interval: u64) -> Pose {
    let mut angles = STANDING;
    let mut i = 0;
    while i < changes.len() {
        let (servo, degrees) = changes[i];
        angles[servo - 1] = angle(degrees);
        i += 1;
    }
    Pose {
        angles,
        duration: Duration::from_millis(duration),
        interval: Duration::from_millis(interval),
    }
}

pub(super) const STANDING: [Angle; SERVOS] = [angle(90); SERVOS];

const fn angle(degrees: u8) -> Angle {
    match Angle::new(degrees) {
        Ok(angle) => angle,
        Err(_) => panic!("angle out of range"),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn actions_end_standing_without_shortened_poses() {
        for action in ACTIONS {
            assert_eq!(action.poses.last().unwrap().angles, STANDING, "{}", action.name);
            for pose in action.poses {
                assert!(pose.duration <= pose.interval && pose.angles.iter().all(|angle| angle.raw() <= 180));
            }
        }
    }
}
