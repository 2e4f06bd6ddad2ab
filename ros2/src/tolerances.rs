//! Tolerated distances of joints from their setpoints: those of a goal, or the defaults of its arm.

use std::time::Duration;

use armwire_host::joints_file::{Joint, MAX_GOAL_TIME};

use crate::messages::{FollowGoal, JointTolerance, Time};
use crate::trajectory::Refusal;

/// The tolerances of each joint, in its unit. `None` allows any distance.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Tolerances {
    /// The distance from the setpoint until the last point.
    pub(crate) path: Vec<Option<f64>>,
    /// The distance from the last point after it.
    pub(crate) goal: Vec<Option<f64>>,
    /// Time after the last point until the joints must be at it.
    pub(crate) goal_time: Duration,
}

impl Tolerances {
    /// The tolerances of a goal: 0 is the arm's default, and -1 allows any distance.
    ///
    /// # Errors
    ///
    /// Another negative tolerance, an unknown joint, a time beyond [`MAX_GOAL_TIME`], and the tolerance of a velocity or
    /// of an acceleration, which the arm does not measure.
    pub(crate) fn of(goal: &FollowGoal, joints: &[Joint], goal_time: Duration) -> Result<Self, Refusal> {
        let paths = joints.iter().map(|joint| joint.path).collect();
        let goals = joints.iter().map(|joint| joint.goal).collect();
        Ok(Self {
            path: stated(paths, joints, &goal.path_tolerance)?,
            goal: stated(goals, joints, &goal.goal_tolerance)?,
            goal_time: match goal.goal_time_tolerance {
                Time { sec: 0, nanosec: 0 } => goal_time,
                time => duration(time).ok_or(Refusal::GoalTime)?,
            },
        })
    }
}

/// The defaults, with the stated tolerances in their place.
fn stated(mut all: Vec<Option<f64>>, joints: &[Joint], stated: &[JointTolerance]) -> Result<Vec<Option<f64>>, Refusal> {
    for tolerance in stated {
        let nth = joints.iter().position(|joint| joint.name == tolerance.name);
        let nth = nth.ok_or_else(|| Refusal::unknown(&tolerance.name))?;
        let wrong = |field, value| Refusal::Tolerance {
            joint: tolerance.name.clone(),
            field,
            value,
        };
        for (field, value) in [
            ("velocity", tolerance.velocity),
            ("acceleration", tolerance.acceleration),
        ] {
            if value != 0.0 && value != -1.0 {
                return Err(wrong(field, value));
            }
        }
        match tolerance.position {
            0.0 => {}
            -1.0 => all[nth] = None,
            value if value > 0.0 && value.is_finite() => all[nth] = Some(value),
            value => return Err(wrong("position", value)),
        }
    }
    Ok(all)
}

fn duration(time: Time) -> Option<Duration> {
    let seconds = u64::try_from(time.sec).ok()?;
    let duration = Duration::from_secs(seconds) + Duration::from_nanos(time.nanosec.into());
    (time.nanosec < 1_000_000_000 && duration <= MAX_GOAL_TIME).then_some(duration)
}

#[cfg(test)]
mod tests {
    use armwire_host::joints_file::Scale;

    use super::*;

    const DEFAULT_GOAL_TIME: Duration = Duration::from_secs(1);

    fn joints() -> Vec<Joint> {
        ["a", "b"]
            .map(|name| Joint {
                name: name.to_owned(),
                scale: Scale::ARM,
                min: -3.0,
                max: 3.0,
                max_speed: Some(2.0),
                path: None,
                goal: Some(0.05),
            })
            .to_vec()
    }

    fn of(name: &str, position: f64, velocity: f64) -> Result<Tolerances, String> {
        let tolerance = JointTolerance {
            name: name.to_owned(),
            position,
            velocity,
            acceleration: 0.0,
        };
        let goal = FollowGoal {
            path_tolerance: vec![tolerance.clone()],
            goal_tolerance: vec![tolerance],
            ..Default::default()
        };
        Tolerances::of(&goal, &joints(), DEFAULT_GOAL_TIME).map_err(|refusal| refusal.to_string())
    }

    #[test]
    fn stated_tolerances_replace_defaults() {
        let tolerances = |position| of("b", position, 0.0).unwrap();
        assert_eq!(tolerances(0.2).path, [None, Some(0.2)]);
        assert_eq!(tolerances(0.2).goal, [Some(0.05), Some(0.2)]);
        assert_eq!(tolerances(0.0).goal, [Some(0.05), Some(0.05)]);
        assert_eq!(tolerances(-1.0).goal, [Some(0.05), None]);
    }

    #[test]
    fn tolerances_that_cannot_be_kept_are_refused() {
        for (wrong, error) in [
            (of("c", 0.1, 0.0), "joint \"c\" is unknown"),
            (of("a", -0.5, 0.0), "the position tolerance of \"a\" is -0.5"),
            (of("a", f64::NAN, 0.0), "the position tolerance of \"a\" is NaN"),
            (of("a", 0.1, 0.3), "the velocity tolerance of \"a\" is 0.3"),
        ] {
            assert!(wrong.clone().unwrap_err().starts_with(error), "{wrong:?}");
        }
    }

    #[test]
    fn goal_time_is_within_a_minute() {
        let of = |sec, nanosec| {
            let goal = FollowGoal {
                goal_time_tolerance: Time { sec, nanosec },
                ..Default::default()
            };
            Tolerances::of(&goal, &joints(), DEFAULT_GOAL_TIME).map(|tolerances| tolerances.goal_time)
        };
        assert_eq!(of(0, 0), Ok(DEFAULT_GOAL_TIME));
        assert_eq!(of(0, 500_000_000), Ok(Duration::from_millis(500)));
        assert_eq!(of(60, 0), Ok(MAX_GOAL_TIME));
        assert_eq!(
            [of(60, 1), of(-1, 0), of(0, 1_000_000_000)],
            [(); 3].map(|()| Err(Refusal::GoalTime))
        );
    }
}
