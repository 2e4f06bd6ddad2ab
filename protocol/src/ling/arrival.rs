//! The arrival of an arm at a target: one rule, and its tolerances.

use core::fmt;

use super::{JOINTS, JointState, Move, Rest, TICKS_PER_TURN};
use crate::time::{Duration, Instant};

/// The distances within which an axis has arrived. `None` allows any distance.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Tolerances {
    /// Those of the joints, in ticks.
    pub joints: [Option<u16>; JOINTS],
    /// That of the gripper, in thousandths of its stroke.
    pub gripper: Option<u16>,
}

/// The axes that have not arrived, with their distances. Its text names them.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Away {
    /// The joints' distances in ticks; `None` for one that has arrived.
    pub joints: [Option<u16>; JOINTS],
    /// The gripper's distance in thousandths of its stroke; `None` if it has arrived.
    pub gripper: Option<u16>,
}

/// The readings of the joints minus their goals, in ticks. A servo holds a load by its deviation.
///
/// Its text has the joints that deviate by more than [`Rest::TOLERANCE`]: `joint 2 rests 0.88° below its goal`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Deviations(pub [i32; JOINTS]);

/// The state of an arrival at a reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Arrived {
    /// Axes have not arrived yet.
    NotYet(Away),
    /// The end: all axes are at the target.
    AtTarget,
    /// The end: the joints are at the target, and the gripper stands still away from it. It may hold something.
    GripperStandsStill(Away),
}

/// The arrival at the target of a move: a state machine without I/O. Readings go in.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arrival {
    target: Move,
    tolerances: Tolerances,
    /// The gripper's reading, and the time since which it is the same.
    still: Option<(Instant, u16)>,
}

impl Tolerances {
    /// Those of a move: 0.26° a joint, and 0.5 % of the gripper's stroke.
    pub const MOVE: Self = Self {
        joints: [Some(Move::JOINT_TOLERANCE); JOINTS],
        gripper: Some(Move::GRIPPER_TOLERANCE),
    };
    /// Those of a move, for the joints alone.
    pub const JOINTS: Self = Self {
        gripper: None,
        ..Self::MOVE
    };
}

impl Move {
    /// The distance of a joint from its target, in ticks, within which it has arrived: 0.26°.
    pub const JOINT_TOLERANCE: u16 = 3;
    /// The distance of the gripper from its target, in thousandths of the stroke, within which it has arrived.
    pub const GRIPPER_TOLERANCE: u16 = 5;

    /// Returns true if the joints and the gripper have arrived, within the tolerances.
    ///
    /// A gripper that holds an object does not arrive: see [`are_joints_reached_by`](Self::are_joints_reached_by).
    ///
    /// ```
    /// use armwire::ling::{GripperSpeed, JointState, MotionStatus, Move, Opening, Position, Speed};
    ///
    /// let home = Move {
    ///     joints: [(Position::CENTRE, Speed::MAX); 6],
    ///     gripper: (Opening::CLOSED, GripperSpeed(1000)),
    /// };
    /// let mut state = JointState { joints: [2051; 6], gripper: 5, status: MotionStatus::Locked };
    /// assert!(home.is_reached_by(&state));
    /// state.gripper = 300;
    /// assert!(!home.is_reached_by(&state) && home.are_joints_reached_by(&state));
    /// ```
    pub fn is_reached_by(&self, state: &JointState) -> bool {
        self.away(state, &Tolerances::MOVE).is_none()
    }

    /// Returns true if all joints have arrived, within [`JOINT_TOLERANCE`](Self::JOINT_TOLERANCE).
    pub fn are_joints_reached_by(&self, state: &JointState) -> bool {
        self.away(state, &Tolerances::JOINTS).is_none()
    }

    /// The deviations of a reading from the target.
    pub fn deviations(&self, state: &JointState) -> Deviations {
        let mut deviations = [0; JOINTS];
        for (deviation, ((target, _), ticks)) in deviations.iter_mut().zip(self.joints.iter().zip(state.joints)) {
            *deviation = i32::from(ticks) - i32::from(target.ticks());
        }
        Deviations(deviations)
    }

    /// The axes of this reading that are not at the target.
    pub fn away(&self, state: &JointState, tolerances: &Tolerances) -> Option<Away> {
        let off = |target: u16, at: u16, tolerance: Option<u16>| {
            let distance = target.abs_diff(at);
            tolerance.filter(|tolerance| distance > *tolerance).map(|_| distance)
        };
        let mut away = Away::NOWHERE;
        let axes = self.joints.iter().zip(state.joints).zip(tolerances.joints);
        for (joint, (((target, _), ticks), tolerance)) in away.joints.iter_mut().zip(axes) {
            *joint = off(target.ticks(), ticks, tolerance);
        }
        away.gripper = off(self.gripper.0.per_mille(), state.gripper, tolerances.gripper);
        (away != Away::NOWHERE).then_some(away)
    }
}

impl Away {
    const NOWHERE: Self = Self {
        joints: [None; JOINTS],
        gripper: None,
    };

    /// True if only the gripper has not arrived.
    pub fn is_gripper_only(&self) -> bool {
        self.joints == [None; JOINTS]
    }
}

impl Deviations {
    /// True if no joint deviates by more than [`Rest::TOLERANCE`]. The text is empty.
    pub fn are_small(&self) -> bool {
        let Self(ticks) = self;
        ticks.iter().all(|ticks| ticks.unsigned_abs() <= Rest::TOLERANCE.into())
    }
}

impl Arrival {
    /// A gripper whose reading is the same for this long stands still.
    pub const STANDSTILL: Duration = Duration::from_millis(1_000);

    /// The arrival at this target.
    pub const fn new(target: Move, tolerances: Tolerances) -> Self {
        let still = None;
        Self {
            target,
            tolerances,
            still,
        }
    }

    /// Takes a reading of the joints that arrived at `now`.
    pub fn on_joints(&mut self, now: Instant, state: &JointState) -> Arrived {
        let since = match self.still {
            Some((since, before)) if before == state.gripper => since,
            _ => now,
        };
        self.still = Some((since, state.gripper));
        match self.target.away(state, &self.tolerances) {
            None => Arrived::AtTarget,
            Some(away) if away.is_gripper_only() && now.since(since) >= Self::STANDSTILL => {
                Arrived::GripperStandsStill(away)
            }
            Some(away) => Arrived::NotYet(away),
        }
    }
}

impl fmt::Display for Away {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let mut separator = "";
        for (n, ticks) in (1..).zip(self.joints) {
            let Some(ticks) = ticks else { continue };
            let degrees = f32::from(ticks) * 360.0 / f32::from(TICKS_PER_TURN);
            write!(f, "{separator}joint {n} is {degrees:.2}° off")?;
            separator = ", ";
        }
        match self.gripper {
            Some(off) => write!(f, "{separator}gripper is {:.1} % off", f32::from(off) / 10.0),
            None => Ok(()),
        }
    }
}

impl fmt::Display for Deviations {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self(ticks) = self;
        let mut separator = "";
        for (n, ticks) in (1..).zip(ticks) {
            if ticks.unsigned_abs() <= Rest::TOLERANCE.into() {
                continue;
            }
            let degrees = ticks.unsigned_abs() as f32 * 360.0 / f32::from(TICKS_PER_TURN);
            let side = if *ticks < 0 { "below" } else { "above" };
            write!(f, "{separator}joint {n} rests {degrees:.2}° {side} its goal")?;
            separator = ", ";
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::super::{GripperSpeed, MotionStatus, Opening, Position, Speed};
    use super::*;

    fn target() -> Move {
        Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1000)),
        }
    }

    fn state(joints: [u16; 6], gripper: u16) -> JointState {
        let status = MotionStatus::Locked;
        JointState {
            joints,
            gripper,
            status,
        }
    }

    #[test]
    fn axes_away_from_the_target_are_named() {
        let away = |joints, gripper| target().away(&state(joints, gripper), &Tolerances::MOVE);
        assert_eq!(away([2048, 2051, 2045, 2048, 2048, 2048], 495), None);
        let off = away([2048, 2052, 2045, 2048, 2048, 1024], 494).unwrap();
        assert_eq!(
            off.to_string(),
            "joint 2 is 0.35° off, joint 6 is 90.00° off, gripper is 0.6 % off"
        );
        assert_eq!(target().away(&state([2048; 6], 0), &Tolerances::JOINTS), None);
    }

    #[test]
    fn gripper_stands_still_while_its_reading_stays() {
        let mut arrival = Arrival::new(target(), Tolerances::MOVE);
        let mut ends = |millis, gripper| {
            let progress = arrival.on_joints(Instant::from_millis(millis), &state([2048; 6], gripper));
            !matches!(progress, Arrived::NotYet(_))
        };
        let readings = [
            (10, 0),
            (500, 0),
            (600, 1),
            (1_599, 1),
            (1_600, 1),
            (1_601, 0),
            (1_602, 500),
        ];
        assert_eq!(
            readings.map(|(millis, gripper)| ends(millis, gripper)),
            [false, false, false, false, true, false, true]
        );
    }
}
