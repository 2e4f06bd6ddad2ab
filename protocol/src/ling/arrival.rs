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
    /// Axes move, or may still begin to. The axes away from the target, if there are any.
    NotYet(Option<Away>),
    /// The joints stand although the move has not ended at its target: it may be lost. Send it once more, unless the arm
    /// was stopped or sent elsewhere meanwhile. The arrival goes on either way.
    Resend,
    /// The end: all axes are at rest at the target, with these deviations.
    AtTarget(Deviations),
    /// The end: the joints are at rest at the target, and the gripper stands still away from it. It may hold something.
    GripperStandsStill(Away),
    /// The end: the joints are at rest away from the target. Something may be in the way.
    Elsewhere(Away),
}

/// The arrival at the target of a move: a state machine without I/O. Readings go in, at most [`Rest::LARGEST_GAP`] apart.
///
/// An arm has arrived when it is at rest within the tolerances, and not before the joints can have travelled their
/// distance at their speeds. A joint does not stop exactly at its target: a servo holds a load by its error.
///
/// ```
/// use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
/// use armwire::ling::{GripperSpeed, JointState, MotionStatus, Move, Opening, Position, Speed};
/// use armwire::time::Instant;
///
/// let target = Move {
///     joints: [(Position::CENTRE, Speed::new(500)?); 6],
///     gripper: (Opening::CLOSED, GripperSpeed(1000)),
/// };
/// let mut arrival = Arrival::new(target, Tolerances::MOVE);
/// // Joint 2 rests 10 ticks below its goal.
/// let state = JointState { joints: [2048, 2038, 2048, 2048, 2048, 2048], gripper: 0, status: MotionStatus::Locked };
/// let mut arrived = Vec::new();
/// for millis in (0..).step_by(20) {
///     match arrival.on_joints(Instant::from_millis(millis), &state) {
///         Arrived::NotYet(_) => {}
///         Arrived::AtTarget(deviations) => {
///             assert_eq!(deviations.to_string(), "joint 2 rests 0.88° below its goal");
///             break;
///         }
///         other => arrived.push(other),
///     }
/// }
/// // It has not moved at all.
/// assert_eq!(arrived, [Arrived::Resend]);
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Arrival {
    target: Move,
    tolerances: Tolerances,
    /// The first reading.
    start: Option<[u16; JOINTS]>,
    /// The time at which the joints can be at the target.
    due: Instant,
    has_resent: bool,
    rest: Rest,
    /// The gripper's reading, and the time since which it is the same.
    still: Option<(Instant, u16)>,
}

impl Tolerances {
    /// Those of a move, as in the vendor's software: 0.1 rad (5.7°) a joint, and 0.5 % of the gripper's stroke.
    pub const MOVE: Self = Self::within(Self::JOINT);
    /// That of a joint in a [move](Self::MOVE), in ticks.
    pub const JOINT: u16 = 65;
    /// That of the gripper in a [move](Self::MOVE), in thousandths of the stroke.
    pub const GRIPPER: u16 = 5;

    /// This tolerance of each joint, in ticks, and the gripper's of a [move](Self::MOVE).
    pub const fn within(ticks: u16) -> Self {
        Self {
            joints: [Some(ticks); JOINTS],
            gripper: Some(Self::GRIPPER),
        }
    }
}

impl Move {
    /// The time that the joints need from this reading at their speeds, if nothing holds them up.
    pub fn time_from(&self, state: &JointState) -> Duration {
        let axes = self.joints.iter().zip(state.joints);
        let times = axes.map(|((target, speed), at)| {
            let speed = speed.ticks_per_second().max(1);
            u64::from(target.ticks().abs_diff(at)) * 1_000_000 / u64::from(speed)
        });
        Duration::from_micros(times.max().unwrap_or(0))
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

    /// The arrival at this target of a move that was just sent.
    pub const fn new(target: Move, tolerances: Tolerances) -> Self {
        Self {
            target,
            tolerances,
            start: None,
            due: Instant::ZERO,
            has_resent: false,
            rest: Rest::new(),
            still: None,
        }
    }

    /// The target.
    pub const fn target(&self) -> &Move {
        &self.target
    }

    /// The axes of this reading that are away from the target.
    pub fn away(&self, state: &JointState) -> Option<Away> {
        self.target.away(state, &self.tolerances)
    }

    /// Takes a reading of the joints that arrived at `now`.
    pub fn on_joints(&mut self, now: Instant, state: &JointState) -> Arrived {
        if self.start.is_none() {
            self.due = now + self.target.time_from(state);
        }
        let start = *self.start.get_or_insert(state.joints);
        let gripper_since = match self.still {
            Some((since, before)) if before == state.gripper => since,
            _ => now,
        };
        self.still = Some((gripper_since, state.gripper));
        let rest = self.rest.on_joints(now, &state.joints).unwrap_or(Duration::ZERO);
        let away = self.away(state);
        if rest < Rest::TIME {
            return Arrived::NotYet(away);
        }
        let deviations = self.target.deviations(state);
        let mut axes = start.iter().zip(state.joints);
        let has_moved = axes.any(|(start, at)| start.abs_diff(at) > Rest::TOLERANCE);
        let is_short = away.is_some_and(|away| !away.is_gripper_only());
        if !self.has_resent && (is_short || !has_moved && !deviations.are_small()) {
            self.has_resent = true;
            self.due = now + self.target.time_from(state);
            self.rest = Rest::new();
            return Arrived::Resend;
        }
        match away {
            _ if now < self.due => Arrived::NotYet(away),
            None => Arrived::AtTarget(deviations),
            Some(away) if !away.is_gripper_only() => Arrived::Elsewhere(away),
            Some(away) if now.since(gripper_since) >= Self::STANDSTILL => Arrived::GripperStandsStill(away),
            Some(_) => Arrived::NotYet(away),
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

    /// The arrival with these readings of joint 2, one every 10 ms, at 1,000 ticks per second. The last one stays.
    fn arrive(joint: impl Fn(u64) -> u16, gripper: impl Fn(u64) -> u16) -> std::vec::Vec<(u64, Arrived)> {
        let mut target = target();
        target.joints = [(Position::CENTRE, Speed::new(1_000).unwrap()); 6];
        let mut arrival = Arrival::new(target, Tolerances::MOVE);
        let mut arrived = std::vec::Vec::new();
        for millis in (0..10_000).step_by(10) {
            let mut state = state([2048; 6], gripper(millis));
            state.joints[1] = joint(millis);
            match arrival.on_joints(Instant::from_millis(millis), &state) {
                Arrived::NotYet(_) => {}
                Arrived::Resend => arrived.push((millis, Arrived::Resend)),
                end => {
                    arrived.push((millis, end));
                    break;
                }
            }
        }
        arrived
    }

    fn deviating(ticks: i32) -> Arrived {
        Arrived::AtTarget(Deviations([0, ticks, 0, 0, 0, 0]))
    }

    fn elsewhere(ticks: u16) -> Arrived {
        let mut away = Away::NOWHERE;
        away.joints[1] = Some(ticks);
        Arrived::Elsewhere(away)
    }

    #[test]
    fn axes_away_from_the_target_are_named() {
        let away = |joints, gripper| target().away(&state(joints, gripper), &Tolerances::MOVE);
        assert_eq!(away([2048, 2113, 1983, 2048, 2048, 2048], 495), None);
        let off = away([2048, 2114, 1983, 2048, 2048, 1024], 494).unwrap();
        assert_eq!(
            off.to_string(),
            "joint 2 is 5.80° off, joint 6 is 90.00° off, gripper is 0.6 % off"
        );
        let joints = Tolerances {
            gripper: None,
            ..Tolerances::MOVE
        };
        assert_eq!(target().away(&state([2048; 6], 0), &joints), None);
    }

    #[test]
    fn sagging_joint_arrives_with_its_deviation() {
        // 500 ticks in 0.5 s, and 26 ticks of sag.
        let joint = |millis: u64| (1_500 + millis).min(2_022) as u16;
        assert_eq!(arrive(joint, |_| 500), [(720, deviating(-26))]);
        assert_eq!(
            Deviations([0, -26, 4, 3, 0, 0]).to_string(),
            "joint 2 rests 2.29° below its goal, joint 3 rests 0.35° above its goal"
        );
    }

    #[test]
    fn slow_joint_that_passes_near_the_target_has_not_arrived() {
        // Five ticks per second, from 40 ticks below: at rest by its readings, but not before its time.
        let mut target = target();
        target.joints = [(Position::CENTRE, Speed::new(5).unwrap()); 6];
        let mut arrival = Arrival::new(target, Tolerances::MOVE);
        let end = (0..20_000).step_by(10).find(|millis| {
            let joint = (2_008 + millis / 200).min(2_048) as u16;
            let state = state([2048, joint, 2048, 2048, 2048, 2048], 500);
            let arrived = arrival.on_joints(Instant::from_millis(*millis), &state);
            arrived == deviating(0)
        });
        assert_eq!(end, Some(8_000));
    }

    #[test]
    fn lost_move_is_sent_once_more() {
        // The second one starts the joint.
        let joint = |millis: u64| (1_500 + millis.saturating_sub(210)).min(2_048) as u16;
        assert_eq!(arrive(joint, |_| 500), [(200, Arrived::Resend), (960, deviating(0))]);
        // A short one is within the tolerance from the beginning.
        let joint = |millis: u64| (2_000 + millis.saturating_sub(210)).min(2_048) as u16;
        assert_eq!(arrive(joint, |_| 500), [(200, Arrived::Resend), (460, deviating(0))]);
    }

    #[test]
    fn joint_at_rest_elsewhere_is_named_at_once() {
        let joint = |millis: u64| (1_500 + millis).min(1_900) as u16;
        assert_eq!(arrive(joint, |_| 500), [(600, Arrived::Resend), (810, elsewhere(148))]);
    }

    #[test]
    fn gripper_that_stands_still_holds_something() {
        let mut away = Away::NOWHERE;
        away.gripper = Some(200);
        let held = Arrived::GripperStandsStill(away);
        let gripper = |millis: u64| (1_000 - millis.min(300)) as u16;
        assert_eq!(arrive(|_| 2_048, gripper), [(1_300, held)]);
    }
}
