//! The units of ROS and of a Ling arm: radians and metres, ticks and thousandths of the gripper's stroke.

use std::f64::consts::TAU;
use std::time::Duration;

use armwire::OutOfRange;
use armwire::ling::{self, JOINTS, Position, Speed, Stroke, TICKS_PER_TURN};
use armwire_host::{AXES, Axes, Tolerance};

use crate::messages::{Header, JointState, Time};
use crate::trajectory::Joint;

/// The default names of joints and gripper.
pub(crate) const DEFAULT_NAMES: [&str; AXES] = ["joint1", "joint2", "joint3", "joint4", "joint5", "joint6", "gripper"];

/// The distance from the last point, by default, at which a joint has reached its goal, in rad.
const GOAL_TOLERANCE: f64 = 0.05;

/// Joints with these names and the ranges of the protocol. The arm reports the gripper's range.
pub(crate) fn joints(names: &[String]) -> Vec<Joint> {
    let min = Position::new(0).unwrap_or(Position::CENTRE).radians().into();
    let joint = |(nth, name): (usize, &String)| Joint {
        name: name.clone(),
        min: if nth < JOINTS { min } else { 0.0 },
        max: if nth < JOINTS {
            Position::MAX.radians().into()
        } else {
            0.0
        },
        max_speed: (nth < JOINTS).then(|| Speed::MAX.radians_per_second().into()),
        path: None,
        // A gripper at an object does not reach its goal.
        goal: (nth < JOINTS).then_some(GOAL_TOLERANCE),
    };
    names.iter().enumerate().map(joint).collect()
}

/// The units of an arm with this gripper.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Units(pub(crate) Stroke);

impl Units {
    /// A tick in rad, or a thousandth of the gripper's stroke in m.
    pub(crate) fn of(self, axis: usize) -> f64 {
        match axis < JOINTS {
            true => TAU / f64::from(TICKS_PER_TURN),
            false => f64::from(self.0.millimetres()) / 1_000_000.0,
        }
    }

    /// A pose in the arm's units.
    pub(crate) fn axes(self, positions: &[f64]) -> Axes {
        std::array::from_fn(|axis| positions[axis] / self.of(axis) + zero(axis))
    }

    /// A pose in rad and m.
    pub(crate) fn positions(self, axes: &Axes) -> Vec<f64> {
        let position = |axis| (axes[axis] - zero(axis)) * self.of(axis);
        (0..AXES).map(position).collect()
    }

    /// Distances in the arm's units.
    pub(crate) fn tolerance(self, distances: &[Option<f64>]) -> Tolerance {
        std::array::from_fn(|axis| distances[axis].map(|distance| distance / self.of(axis)))
    }
}

/// 0 rad or m in the arm's units.
fn zero(axis: usize) -> f64 {
    match axis < JOINTS {
        true => Position::CENTRE.ticks().into(),
        false => 0.0,
    }
}

/// One reading of an arm.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Reading {
    /// System time, in nanoseconds since 1970.
    pub(crate) at: i64,
    pub(crate) state: ling::JointState,
    /// Joints in rad, and the gripper's opening in m.
    pub(crate) positions: Vec<f64>,
}

impl Reading {
    /// A reading of an arm with this gripper.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a joint or gripper position outside the protocol's range.
    pub(crate) fn new(at: i64, state: &ling::JointState, stroke: Stroke) -> Result<Self, OutOfRange> {
        let mut positions: Vec<f64> = state
            .positions()?
            .iter()
            .map(|position| position.radians().into())
            .collect();
        positions.push(f64::from(state.opening()?.millimetres(stroke)) / 1_000.0);
        Ok(Self {
            at,
            state: *state,
            positions,
        })
    }

    /// True if a reading between the two is missing, or if this one was received long after its stamp, at `received` in
    /// nanoseconds since 1970.
    pub(crate) fn is_late_after(&self, previous: &Self, received: i64, period: Duration) -> bool {
        let is_long = |from: i64, to: i64| {
            let passed = u64::try_from(to - from).unwrap_or(0);
            Duration::from_nanos(passed) > 2 * period
        };
        is_long(previous.at, self.at) || is_long(self.at, received)
    }

    pub(crate) fn to_message(&self, joints: &[Joint]) -> JointState {
        JointState {
            header: Header {
                stamp: Time::from_nanos(self.at),
                frame_id: String::new(),
            },
            name: joints.iter().map(|joint| joint.name.clone()).collect(),
            position: self.positions.clone(),
            velocity: Vec::new(),
            effort: Vec::new(),
        }
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;

    use super::*;

    fn state(ticks: u16, gripper: u16) -> ling::JointState {
        ling::JointState {
            joints: [ticks; JOINTS],
            gripper,
            status: MotionStatus::Locked,
        }
    }

    #[test]
    fn ticks_become_radians_and_per_mille_metres() {
        let reading = Reading::new(0, &state(3072, 500), Stroke::Mm50).unwrap();
        assert!(
            (reading.positions[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-6,
            "{reading:?}"
        );
        assert!((reading.positions[JOINTS] - 0.025).abs() < 1e-9, "{reading:?}");
    }

    #[test]
    fn positions_out_of_range_are_an_error() {
        assert!(Reading::new(0, &state(4096, 0), Stroke::Mm50).is_err());
        assert!(Reading::new(0, &state(0, 1001), Stroke::Mm50).is_err());
    }

    #[test]
    fn reading_of_another_robot_is_an_error() {
        let bessica = ling::JointState {
            status: MotionStatus::of_answer(0x01, 33),
            ..state(2_048, 500)
        };
        let error = Reading::new(0, &bessica, Stroke::Mm50).unwrap_err();
        assert!(
            error.to_string().contains("a Bessica-D: its answer is 33 data bytes"),
            "{error}"
        );
    }

    #[test]
    fn reading_is_late_after_two_periods() {
        let reading = |at| Reading::new(at, &state(0, 0), Stroke::Mm50).unwrap();
        let is_late = |at| reading(at).is_late_after(&reading(1_000), at, Duration::from_nanos(500));
        assert_eq!([0, 1_500, 2_000, 2_001].map(is_late), [false, false, false, true]);
    }

    #[test]
    fn reading_received_long_after_its_stamp_is_late() {
        let reading = |at| Reading::new(at, &state(0, 0), Stroke::Mm50).unwrap();
        let is_late = |received| reading(1_500).is_late_after(&reading(1_000), received, Duration::from_nanos(500));
        assert_eq!([1_500, 2_500, 2_501].map(is_late), [false, false, true]);
    }

    #[test]
    fn every_tick_survives_conversion_to_a_setpoint() {
        for ticks in 0..=4095 {
            let reading = Reading::new(0, &state(ticks, 1000), Stroke::Mm100).unwrap();
            let axes = Units(Stroke::Mm100).axes(&reading.positions);
            let expected = [ticks, ticks, ticks, ticks, ticks, ticks, 1000].map(f64::from);
            assert!(
                axes.iter().zip(expected).all(|(axis, to)| (axis - to).abs() < 0.01),
                "{axes:?}"
            );
        }
    }
}
