//! The units of ROS and of a Ling arm: those of the joints file, ticks and thousandths of the gripper's stroke.

use std::f64::consts::TAU;
use std::time::Duration;

use armwire::OutOfRange;
use armwire::ling::{self, JOINTS, Position, Stroke, TICKS_PER_TURN};
use armwire_host::joints_file::{Joint, Scale};
use armwire_host::{AXES, Axes, Tolerance};

use crate::messages::{Header, JointState, Time};

/// The units of an arm with this gripper, and those of its joints in ROS.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Units {
    stroke: Stroke,
    scales: [Scale; AXES],
}

impl Units {
    /// The units of these joints, the gripper last.
    pub(crate) fn new(joints: &[Joint; AXES], stroke: Stroke) -> Self {
        Self {
            stroke,
            scales: joints.each_ref().map(|joint| joint.scale),
        }
    }

    /// A tick, or a thousandth of the gripper's stroke, as a distance in ROS.
    pub(crate) fn of(self, axis: usize) -> f64 {
        self.scales[axis].length(self.unit(axis))
    }

    /// A pose in the arm's units.
    pub(crate) fn axes(self, positions: &[f64]) -> Axes {
        std::array::from_fn(|axis| self.scales[axis].arm(positions[axis]) / self.unit(axis) + zero(axis))
    }

    /// A pose in the units of ROS.
    pub(crate) fn positions(self, axes: &Axes) -> Vec<f64> {
        let position = |axis: usize| self.scales[axis].value((axes[axis] - zero(axis)) * self.unit(axis));
        (0..AXES).map(position).collect()
    }

    /// Distances in the arm's units.
    pub(crate) fn tolerance(self, distances: &[Option<f64>]) -> Tolerance {
        std::array::from_fn(|axis| distances[axis].map(|distance| distance / self.of(axis)))
    }

    /// A tick in rad, or a thousandth of the gripper's stroke in m.
    fn unit(self, axis: usize) -> f64 {
        match axis < JOINTS {
            true => TAU / f64::from(TICKS_PER_TURN),
            false => f64::from(self.stroke.millimetres()) / 1_000_000.0,
        }
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
    /// The joints and the gripper, in the units of ROS.
    pub(crate) positions: Vec<f64>,
}

impl Reading {
    /// A reading of an arm with these units.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a joint or gripper position outside the protocol's range.
    pub(crate) fn new(at: i64, state: &ling::JointState, units: Units) -> Result<Self, OutOfRange> {
        let joints = state.positions()?.map(|position| f64::from(position.radians()));
        let opening = f64::from(state.opening()?.millimetres(units.stroke)) / 1_000.0;
        let arm = joints.into_iter().chain([opening]);
        Ok(Self {
            at,
            state: *state,
            positions: units
                .scales
                .iter()
                .zip(arm)
                .map(|(scale, arm)| scale.value(arm))
                .collect(),
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
    use armwire_host::joints_file::{self, Joints};

    use super::*;

    fn units(stroke: Stroke) -> Units {
        Units::new(&Joints::default().all, stroke)
    }

    fn state(ticks: u16, gripper: u16) -> ling::JointState {
        ling::JointState {
            joints: [ticks; JOINTS],
            gripper,
            status: MotionStatus::Locked,
        }
    }

    #[test]
    fn ticks_become_radians_and_per_mille_metres() {
        let reading = Reading::new(0, &state(3072, 500), units(Stroke::Mm50)).unwrap();
        assert!(
            (reading.positions[0] - std::f64::consts::FRAC_PI_2).abs() < 1e-6,
            "{reading:?}"
        );
        assert!((reading.positions[JOINTS] - 0.025).abs() < 1e-9, "{reading:?}");
    }

    #[test]
    fn positions_out_of_range_are_an_error() {
        assert!(Reading::new(0, &state(4096, 0), units(Stroke::Mm50)).is_err());
        assert!(Reading::new(0, &state(0, 1001), units(Stroke::Mm50)).is_err());
    }

    #[test]
    fn reading_of_another_robot_is_an_error() {
        let bessica = ling::JointState {
            status: MotionStatus::of_answer(0x01, 33),
            ..state(2_048, 500)
        };
        let error = Reading::new(0, &bessica, units(Stroke::Mm50)).unwrap_err();
        assert!(
            error.to_string().contains("a Bessica-D: its answer is 33 data bytes"),
            "{error}"
        );
    }

    #[test]
    fn reading_is_late_after_two_periods() {
        let reading = |at| Reading::new(at, &state(0, 0), units(Stroke::Mm50)).unwrap();
        let is_late = |at| reading(at).is_late_after(&reading(1_000), at, Duration::from_nanos(500));
        assert_eq!([0, 1_500, 2_000, 2_001].map(is_late), [false, false, false, true]);
    }

    #[test]
    fn reading_received_long_after_its_stamp_is_late() {
        let reading = |at| Reading::new(at, &state(0, 0), units(Stroke::Mm50)).unwrap();
        let is_late = |received| reading(1_500).is_late_after(&reading(1_000), received, Duration::from_nanos(500));
        assert_eq!([1_500, 2_500, 2_501].map(is_late), [false, false, true]);
    }

    #[test]
    fn every_tick_survives_conversion_to_a_setpoint() {
        let mut turned = Joints::default().all;
        for joint in &mut turned {
            joint.scale = Scale::new(-57.3, 180.0).unwrap();
        }
        let all = [units(Stroke::Mm100), Units::new(&turned, Stroke::Mm100)];
        for (ticks, units) in (0..=4095).flat_map(|ticks| all.map(|units| (ticks, units))) {
            let reading = Reading::new(0, &state(ticks, 1000), units).unwrap();
            let axes = units.axes(&reading.positions);
            let expected = [ticks, ticks, ticks, ticks, ticks, ticks, 1000].map(f64::from);
            assert!(
                axes.iter().zip(expected).all(|(axis, to)| (axis - to).abs() < 0.01),
                "{axes:?}"
            );
            let again = units.positions(&axes);
            assert!(
                again
                    .iter()
                    .zip(&reading.positions)
                    .all(|(one, other)| (one - other).abs() < 1e-3),
                "{again:?}"
            );
        }
    }

    #[test]
    fn reading_has_the_names_and_units_of_the_file() {
        let file = include_str!("../../examples/joints/alicia-d-moveit.toml");
        let joints = &joints_file::parse(file).unwrap()["alicia_d"].all;
        let units = Units::new(joints, Stroke::Mm50);
        for (gripper, finger) in [(0, -0.025), (500, -0.0125), (1_000, 0.0)] {
            let reading = Reading::new(0, &state(3_072, gripper), units).unwrap();
            let message = reading.to_message(joints);
            assert_eq!((&*message.name[0], &*message.name[JOINTS]), ("Joint1", "Gripper"));
            let [joint, at] = [
                message.position[0] - std::f64::consts::FRAC_PI_2,
                message.position[JOINTS] - finger,
            ];
            assert!(joint.abs() < 1e-6 && at.abs() < 1e-9, "{message:?}");
        }
    }
}
