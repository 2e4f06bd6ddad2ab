//! Trajectories of ROS: checked before the first motion. No clock and no I/O.

use std::time::Duration;

use armwire::ling::Immovable;
use armwire_bridge::control::StopInForce;
use armwire_host::joints_file::{Joint, MAX_GOAL_TIME};

use crate::messages::{JointTrajectory, JointTrajectoryPoint, Time};

/// The age up to which `header.stamp` counts as now, for the latency of the network and the difference of clocks.
const MAX_AGE: Duration = Duration::from_millis(200);
/// Maximum time until a start, and maximum duration of a trajectory.
const MAX_LEAD: Duration = Duration::from_secs(10);
const MAX_LENGTH: Duration = Duration::from_secs(600);
/// Maximum distance between a joint and a first point at time 0, in rad.
const START_TOLERANCE: f64 = 0.05;

/// Maximum number of characters of an unknown name in a refusal.
const MAX_NAME: usize = 64;

/// The joints of an arm when a trajectory starts.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Pose {
    /// The positions, from which the named joints move.
    pub(crate) positions: Vec<f64>,
    /// The goals, which the other joints keep: that of a gripper is behind the object that it holds.
    pub(crate) goals: Vec<f64>,
}

/// The reason why a trajectory is refused. No part of it was executed.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub(crate) enum Refusal {
    #[error("the message cannot be decoded")]
    Undecodable,
    /// The first [`MAX_NAME`] characters of the name.
    #[error("joint {0:?} is unknown")]
    UnknownJoint(String),
    #[error("joint {0:?} is named twice")]
    RepeatedJoint(String),
    #[error("joint {0:?} is missing")]
    MissingJoint(String),
    #[error("point {point} has {got} {field} for {joints} joints")]
    Count {
        point: usize,
        field: &'static str,
        got: usize,
        joints: usize,
    },
    #[error("point {point} has effort, which the arm does not accept")]
    Effort { point: usize },
    #[error("point {point}: {field} of {joint:?} is {value}")]
    NotFinite {
        point: usize,
        field: &'static str,
        joint: String,
        value: f64,
    },
    #[error("point {point}: {joint:?} at {value} is out of range {min:.4} to {max:.4}")]
    Position {
        point: usize,
        joint: String,
        value: f64,
        min: f64,
        max: f64,
    },
    #[error("point {point}: {joint:?} would move by {speed:.3} per second, allowed {max:.3}")]
    Speed {
        point: usize,
        joint: String,
        speed: f64,
        max: f64,
    },
    #[error("point 0 at time 0 is {distance:.4} rad from {joint:?}, allowed {START_TOLERANCE}")]
    Start { joint: String, distance: f64 },
    #[error("point {point}: time_from_start is not a time from 0 to {} s", MAX_LENGTH.as_secs())]
    Time { point: usize },
    #[error("point {point}: time_from_start is not later than that of the point before")]
    Order { point: usize },
    #[error("header.stamp is not a time")]
    Stamp,
    #[error("header.stamp is {} ms in the past, allowed {}", .0.as_millis(), MAX_AGE.as_millis())]
    Past(Duration),
    #[error("header.stamp is {} s in the future, allowed {}", .0.as_secs(), MAX_LEAD.as_secs())]
    Future(Duration),
    #[error("the trajectory has no points")]
    NoPoint,
    #[error("the trajectory has no joints")]
    NoJoint,
    #[error("the arm has no joints of several degrees of freedom")]
    MultiDof,
    #[error("the {field} tolerance of {joint:?} is {value}, which the arm cannot keep")]
    Tolerance {
        joint: String,
        field: &'static str,
        value: f64,
    },
    #[error("goal_time_tolerance is not a time from 0 to {} s", MAX_GOAL_TIME.as_secs())]
    GoalTime,
    #[error("a goal with this identifier was accepted before")]
    RepeatedGoal,
    #[error("{0}")]
    Unplayable(armwire_host::trajectory::Refusal),
    #[error("the torque is off")]
    TorqueOff,
    #[error(transparent)]
    Immovable(Immovable),
    #[error("{0}")]
    Stopped(StopInForce),
    #[error("the arm does not answer")]
    NoArm,
}

impl Refusal {
    /// The refusal of a joint that the arm does not have.
    pub(crate) fn unknown(name: &str) -> Self {
        Self::UnknownJoint(name.chars().take(MAX_NAME).collect())
    }
}

/// A checked trajectory.
#[derive(Debug, PartialEq)]
pub(crate) struct Path {
    /// The pose at the start.
    pub(crate) start: Vec<f64>,
    pub(crate) knots: Vec<Knot>,
}

/// A point of a checked trajectory.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Knot {
    /// Its time since the start.
    pub(crate) at: Duration,
    pub(crate) positions: Vec<f64>,
}

/// Checks a trajectory for joints at `pose` when it starts.
///
/// The first `required` of `joints` must be named, in any order, or none of them. The others, such as the gripper, may be
/// omitted. An omitted joint keeps its goal.
///
/// # Errors
///
/// The first reason for a refusal.
pub(crate) fn check(
    joints: &[Joint],
    required: usize,
    trajectory: &JointTrajectory,
    pose: &Pose,
) -> Result<Path, Refusal> {
    let columns = columns(joints, required, &trajectory.joint_names)?;
    if trajectory.points.is_empty() {
        return Err(Refusal::NoPoint);
    }
    let starts = columns.iter().zip(&pose.positions).zip(&pose.goals);
    let starts = starts.map(|((column, &position), &goal)| if column.is_some() { position } else { goal });
    let start = Knot {
        at: Duration::ZERO,
        positions: starts.collect(),
    };
    let mut knots = Vec::new();
    for (nth, point) in trajectory.points.iter().enumerate() {
        let before = knots.last().unwrap_or(&start);
        let knot = Knot {
            at: time_from_start(nth, point.time_from_start)?,
            positions: positions(joints, &columns, nth, point, &before.positions)?,
        };
        let is_first = nth == 0;
        if is_first && knot.at.is_zero() {
            near(joints, &before.positions, &knot.positions)?;
        } else if knot.at <= before.at {
            return Err(Refusal::Order { point: nth });
        } else {
            speeds(joints, nth, before, &knot)?;
        }
        knots.push(knot);
    }
    let start = start.positions;
    Ok(Path { start, knots })
}

/// The column of each joint in a trajectory with these names; `None` for an omitted joint.
fn columns(joints: &[Joint], required: usize, names: &[String]) -> Result<Vec<Option<usize>>, Refusal> {
    for (nth, name) in names.iter().enumerate() {
        if !joints.iter().any(|joint| joint.name == *name) {
            return Err(Refusal::unknown(name));
        }
        if names[..nth].contains(name) {
            return Err(Refusal::RepeatedJoint(name.clone()));
        }
    }
    let columns: Vec<_> = joints
        .iter()
        .map(|joint| names.iter().position(|name| *name == joint.name))
        .collect();
    let required = &columns[..required];
    match required.iter().position(Option::is_none) {
        _ if names.is_empty() => Err(Refusal::NoJoint),
        Some(missing) if required.iter().any(Option::is_some) => {
            Err(Refusal::MissingJoint(joints[missing].name.clone()))
        }
        _ => Ok(columns),
    }
}

/// The time from now, in nanoseconds since 1970, to the start: zero for a stamp of 0 or just in the past.
///
/// # Errors
///
/// A stamp that is no time, too old or too far in the future.
pub(crate) fn lead(stamp: Time, now: i64) -> Result<Duration, Refusal> {
    if stamp.sec < 0 || stamp.nanosec >= 1_000_000_000 {
        return Err(Refusal::Stamp);
    }
    if stamp == Time::default() {
        return Ok(Duration::ZERO);
    }
    let lead = i64::from(stamp.sec) * 1_000_000_000 + i64::from(stamp.nanosec) - now;
    let span = Duration::from_nanos(lead.unsigned_abs());
    match lead {
        ..0 if span > MAX_AGE => Err(Refusal::Past(span)),
        ..0 => Ok(Duration::ZERO),
        _ if span > MAX_LEAD => Err(Refusal::Future(span)),
        _ => Ok(span),
    }
}

fn time_from_start(point: usize, time: Time) -> Result<Duration, Refusal> {
    let seconds = u64::try_from(time.sec).map_err(|_| Refusal::Time { point })?;
    let at = Duration::from_secs(seconds) + Duration::from_nanos(time.nanosec.into());
    match time.nanosec < 1_000_000_000 && at <= MAX_LENGTH {
        true => Ok(at),
        false => Err(Refusal::Time { point }),
    }
}

/// The positions of all joints at a point. An omitted joint keeps its previous position.
fn positions(
    joints: &[Joint],
    columns: &[Option<usize>],
    nth: usize,
    point: &JointTrajectoryPoint,
    before: &[f64],
) -> Result<Vec<f64>, Refusal> {
    let named = columns.iter().flatten().count();
    let fields = [
        ("positions", &point.positions, false),
        ("velocities", &point.velocities, true),
        ("accelerations", &point.accelerations, true),
    ];
    for (field, values, may_be_empty) in fields {
        if values.len() != named && !(may_be_empty && values.is_empty()) {
            return Err(Refusal::Count {
                point: nth,
                field,
                got: values.len(),
                joints: named,
            });
        }
        for (joint, column) in joints.iter().zip(columns) {
            let value = column.and_then(|column| values.get(column));
            if let Some(&value) = value.filter(|value| !value.is_finite()) {
                return Err(Refusal::NotFinite {
                    point: nth,
                    field,
                    joint: joint.name.clone(),
                    value,
                });
            }
        }
    }
    if !point.effort.is_empty() {
        return Err(Refusal::Effort { point: nth });
    }
    let mut positions = Vec::new();
    for ((joint, column), &stays) in joints.iter().zip(columns).zip(before) {
        let Some(column) = *column else {
            positions.push(stays);
            continue;
        };
        let value = point.positions[column];
        if !(joint.min..=joint.max).contains(&value) {
            let (min, max) = (joint.min, joint.max);
            return Err(Refusal::Position {
                point: nth,
                joint: joint.name.clone(),
                value,
                min,
                max,
            });
        }
        positions.push(value);
    }
    Ok(positions)
}

/// Checks that a first point at time 0 is near the arm's position.
fn near(joints: &[Joint], current: &[f64], first: &[f64]) -> Result<(), Refusal> {
    for ((joint, current), first) in joints.iter().zip(current).zip(first) {
        let distance = (first - current).abs() / joint.scale.length(1.0);
        if joint.max_speed.is_some() && distance > START_TOLERANCE {
            return Err(Refusal::Start {
                joint: joint.name.clone(),
                distance,
            });
        }
    }
    Ok(())
}

fn speeds(joints: &[Joint], nth: usize, from: &Knot, to: &Knot) -> Result<(), Refusal> {
    let length = (to.at - from.at).as_secs_f64();
    for ((joint, from), to) in joints.iter().zip(&from.positions).zip(&to.positions) {
        let speed = (to - from).abs() / length;
        if let Some(max) = joint.max_speed.filter(|max| speed > *max) {
            return Err(Refusal::Speed {
                point: nth,
                joint: joint.name.clone(),
                speed,
                max,
            });
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use armwire_host::joints_file::Scale;

    use super::*;

    const NOW: i64 = 1_700_000_000_000_000_000;

    fn joints() -> Vec<Joint> {
        let joint = |name: &str| Joint {
            name: name.to_owned(),
            scale: Scale::ARM,
            min: -3.0,
            max: 3.0,
            max_speed: Some(2.0),
            path: None,
            goal: None,
        };
        let gripper = Joint {
            max_speed: None,
            min: 0.0,
            max: 0.05,
            ..joint("gripper")
        };
        vec![joint("a"), joint("b"), gripper]
    }

    fn point(seconds: f64, positions: &[f64]) -> JointTrajectoryPoint {
        let time_from_start = Time {
            sec: seconds as i32,
            nanosec: (seconds.fract() * 1e9) as u32,
        };
        JointTrajectoryPoint {
            positions: positions.to_vec(),
            time_from_start,
            ..Default::default()
        }
    }

    fn trajectory(points: &[JointTrajectoryPoint]) -> JointTrajectory {
        let joint_names = ["a", "b"].map(str::to_owned).to_vec();
        JointTrajectory {
            joint_names,
            points: points.to_vec(),
            ..Default::default()
        }
    }

    fn checked(trajectory: &JointTrajectory) -> Result<Path, Refusal> {
        let pose = Pose {
            positions: vec![0.0, 0.0, 0.02],
            goals: vec![0.01, 0.01, 0.0],
        };
        check(&joints(), 2, trajectory, &pose)
    }

    /// The poses with their times in milliseconds, from the start on.
    fn knots(trajectory: &JointTrajectory) -> Vec<(u128, Vec<f64>)> {
        let Path { start, knots } = checked(trajectory).unwrap();
        let knots = knots.into_iter().map(|knot| (knot.at.as_millis(), knot.positions));
        [(0, start)].into_iter().chain(knots).collect()
    }

    fn refused(trajectory: &JointTrajectory) -> String {
        checked(trajectory).unwrap_err().to_string()
    }

    fn led(nanos: i64) -> Result<Duration, Refusal> {
        let stamp = Time {
            sec: (nanos / 1_000_000_000) as i32,
            nanosec: (nanos % 1_000_000_000) as u32,
        };
        lead(stamp, NOW)
    }

    #[test]
    fn trajectory_begins_at_the_arm() {
        let knots = knots(&trajectory(&[point(1.0, &[1.0, -1.0]), point(3.0, &[1.0, 1.0])]));
        let expected = [
            (0, vec![0.0, 0.0, 0.0]),
            (1_000, vec![1.0, -1.0, 0.0]),
            (3_000, vec![1.0, 1.0, 0.0]),
        ];
        assert_eq!(knots, expected);
    }

    #[test]
    fn joints_may_be_in_any_order() {
        let mut mixed = trajectory(&[point(1.0, &[0.01, 0.2, 0.1])]);
        mixed.joint_names = ["gripper", "b", "a"].map(str::to_owned).to_vec();
        assert_eq!(knots(&mixed)[1], (1_000, vec![0.1, 0.2, 0.01]));
    }

    #[test]
    fn omitted_joints_keep_their_goals() {
        let mut gripper = trajectory(&[point(1.0, &[0.05])]);
        gripper.joint_names = vec!["gripper".to_owned()];
        let expected = [(0, vec![0.01, 0.01, 0.02]), (1_000, vec![0.01, 0.01, 0.05])];
        assert_eq!(knots(&gripper), expected);
    }

    #[test]
    fn trajectory_without_joints_or_points_is_refused() {
        assert_eq!(refused(&trajectory(&[])), "the trajectory has no points");
        assert_eq!(refused(&JointTrajectory::default()), "the trajectory has no joints");
    }

    #[test]
    fn wrong_names_are_refused() {
        for (names, error) in [
            (&["a", "c"][..], "joint \"c\" is unknown"),
            (&["a", "a"], "joint \"a\" is named twice"),
            (&["a"], "joint \"b\" is missing"),
            (&["a", "\u{1b}[2J"], "joint \"\\u{1b}[2J\" is unknown"),
        ] {
            let mut wrong = trajectory(&[point(1.0, &[0.0, 0.0])]);
            wrong.joint_names = names.iter().map(|&name| name.to_owned()).collect();
            assert_eq!(refused(&wrong), error);
        }
    }

    #[test]
    fn refusal_has_the_start_of_a_long_name() {
        let mut wrong = trajectory(&[point(1.0, &[0.0, 0.0])]);
        wrong.joint_names[0] = "x".repeat(1_000_000);
        assert_eq!(refused(&wrong), format!("joint \"{}\" is unknown", "x".repeat(64)));
    }

    #[test]
    fn wrong_values_are_refused() {
        let good = point(1.0, &[0.0, 0.0]);
        for (wrong, error) in [
            (point(1.0, &[0.0]), "point 1 has 1 positions for 2 joints"),
            (
                point(9.0, &[3.1, 0.0]),
                "point 1: \"a\" at 3.1 is out of range -3.0000 to 3.0000",
            ),
            (point(9.0, &[0.0, f64::NAN]), "point 1: positions of \"b\" is NaN"),
            (point(9.0, &[f64::INFINITY, 0.0]), "point 1: positions of \"a\" is inf"),
            (
                point(2.0, &[0.0, 2.5]),
                "point 1: \"b\" would move by 2.500 per second, allowed 2.000",
            ),
            (
                point(1.0, &[0.0, 0.0]),
                "point 1: time_from_start is not later than that of the point before",
            ),
            (
                point(0.5, &[0.0, 0.0]),
                "point 1: time_from_start is not later than that of the point before",
            ),
            (
                point(601.0, &[0.0, 0.0]),
                "point 1: time_from_start is not a time from 0 to 600 s",
            ),
            (
                point(-1.0, &[0.0, 0.0]),
                "point 1: time_from_start is not a time from 0 to 600 s",
            ),
            (
                JointTrajectoryPoint {
                    velocities: vec![0.0, f64::NAN],
                    ..point(2.0, &[0.0, 0.0])
                },
                "point 1: velocities of \"b\" is NaN",
            ),
            (
                JointTrajectoryPoint {
                    effort: vec![0.0, 0.0],
                    ..point(2.0, &[0.0, 0.0])
                },
                "point 1 has effort, which the arm does not accept",
            ),
        ] {
            assert_eq!(refused(&trajectory(&[good.clone(), wrong])), error);
        }
    }

    #[test]
    fn first_point_at_time_0_is_near_arm() {
        assert!(checked(&trajectory(&[point(0.0, &[0.04, 0.0])])).is_ok());
        let far = trajectory(&[point(0.0, &[0.0, 0.06])]);
        assert_eq!(
            refused(&far),
            "point 0 at time 0 is 0.0600 rad from \"b\", allowed 0.05"
        );
    }

    #[test]
    fn start_of_a_joint_in_degrees_is_near_too() {
        let mut joints = joints();
        joints[1].scale = Scale::new(-57.3, 0.0).unwrap();
        let pose = Pose {
            positions: vec![0.0, 0.0, 0.02],
            goals: vec![0.0, 0.0, 0.02],
        };
        let checked = |degrees| check(&joints, 2, &trajectory(&[point(0.0, &[0.0, degrees])]), &pose);
        assert!(checked(2.8).is_ok());
        assert_eq!(
            checked(-2.9).unwrap_err().to_string(),
            "point 0 at time 0 is 0.0506 rad from \"b\", allowed 0.05"
        );
    }

    #[test]
    fn stamp_is_the_start() {
        assert_eq!(lead(Time::default(), NOW), Ok(Duration::ZERO));
        assert_eq!(led(NOW + 2_000_000_000), Ok(Duration::from_secs(2)));
        assert_eq!(led(NOW - 200_000_000), Ok(Duration::ZERO));
    }

    #[test]
    fn stale_and_far_stamps_are_refused() {
        let refused = |stamp| led(stamp).unwrap_err().to_string();
        assert_eq!(
            refused(NOW - 201_000_000),
            "header.stamp is 201 ms in the past, allowed 200"
        );
        assert_eq!(
            refused(NOW + 11_000_000_000),
            "header.stamp is 11 s in the future, allowed 10"
        );
    }
}
