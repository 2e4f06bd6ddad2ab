//! Goals of a streamed motion: how far each may be from the one before, and how fast the joints go there.

use armwire::OutOfRange;
use armwire::ling::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Speed, TICKS_PER_TURN};
use armwire::time::{Duration, Instant};

/// The gripper's speed, as in a stop.
pub(crate) const GRIPPER_SPEED: GripperSpeed = GripperSpeed(1000);
/// The speed on the way to a motion: 20°/s.
pub(crate) const APPROACH_SPEED: Speed = match Speed::for_move(228) {
    Ok(speed) => speed,
    Err(_) => Speed::SLOWEST,
};
/// The time in which a joint makes up for its distance from the goal before, in seconds.
const CATCH_UP_S: f64 = 0.05;
/// Distance of a joint from its goal, in ticks, that is a deviation: 10°.
const DEVIATION: u16 = 114;
/// The time after which a deviation counts.
const DEVIATION_TIME: Duration = Duration::from_millis(500);

/// The joints' positions in ticks, and parts of a tick.
pub(crate) type Ticks = [f64; JOINTS];

/// The limits of a streamed motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Maximum speed of a joint and of its goals.
    pub speed: Speed,
    /// Maximum distance between two goals of a joint, in ticks. It limits a program that was held up.
    pub step: u16,
}

impl Limits {
    /// 90°/s, and 5° a step.
    pub const FOLLOW: Self = Self {
        speed: match Speed::for_move(1_024) {
            Ok(speed) => speed,
            Err(_) => Speed::SLOWEST,
        },
        step: 56,
    };

    /// 180°/s, and 5° a step.
    pub const REPLAY: Self = Self {
        speed: match Speed::for_move(2_048) {
            Ok(speed) => speed,
            Err(_) => Speed::SLOWEST,
        },
        step: 56,
    };
}

/// Degrees of so many ticks.
pub(crate) fn degrees(ticks: f64) -> f64 {
    ticks * 360.0 / f64::from(TICKS_PER_TURN)
}

/// Positions in ticks.
pub(crate) fn ticks(positions: [Position; JOINTS]) -> Ticks {
    positions.map(|position| position.ticks().into())
}

/// The joint that is farthest from another pose, from 0, and the distance in ticks.
pub(crate) fn farthest(one: &Ticks, other: &Ticks) -> (usize, f64) {
    let distances = one.iter().zip(other).map(|(one, other)| (one - other).abs());
    let farther = |most: (usize, f64), next: (usize, f64)| if next.1 > most.1 { next } else { most };
    distances.enumerate().fold((0, 0.0), farther)
}

/// The goal of a streamed motion, which moves within its limits.
#[derive(Clone, Debug)]
pub(crate) struct Goal {
    ticks: Ticks,
    at: Instant,
    /// The time since which a joint deviates, and that joint with its distance in ticks.
    deviates: Option<(Instant, Deviation)>,
}

/// A joint that does not follow its goals.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Deviation {
    /// The joint, from 1.
    pub joint: u8,
    /// Its distance from the goal, in ticks.
    pub ticks: u16,
}

impl Goal {
    /// The pose of an arm, in a reading that arrived at `at`.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for a pose that no move can express.
    pub(crate) fn of(at: Instant, reading: &JointState) -> Result<Self, OutOfRange> {
        Ok(Self {
            ticks: ticks(reading.positions()?),
            at,
            deviates: None,
        })
    }

    pub(crate) fn ticks(&self) -> &Ticks {
        &self.ticks
    }

    /// Moves towards `target` with this speed at most. The move has speeds that bring an arm at `reading` to the new goal
    /// within a period.
    pub(crate) fn advance(
        &mut self,
        now: Instant,
        target: &Ticks,
        gripper: Opening,
        limits: &Limits,
        reading: &JointState,
        period: Duration,
    ) -> Move {
        let max: f64 = limits.speed.ticks_per_second().into();
        let step = (max * seconds(now.since(self.at))).min(limits.step.into());
        self.at = now;
        let joints = std::array::from_fn(|joint| {
            let before = self.ticks[joint];
            let way = target[joint] - before;
            let goal = match way.abs() <= step {
                true => target[joint],
                false => before + step.copysign(way),
            };
            self.ticks[joint] = goal;
            let late = (before - f64::from(reading.joints[joint])).abs();
            let speed = (goal - before).abs() / seconds(period) + late / CATCH_UP_S;
            (position(goal), speed_within(speed, limits.speed))
        });
        Move {
            joints,
            gripper: (gripper, GRIPPER_SPEED),
        }
    }

    /// Takes a reading. Returns a joint that has been away from its goal by 10° for 0.5 s.
    pub(crate) fn deviation(&mut self, at: Instant, reading: &JointState) -> Option<Deviation> {
        let (joint, distance) = farthest(&self.ticks, &reading.joints.map(f64::from));
        let deviation = Deviation {
            joint: joint as u8 + 1,
            ticks: distance as u16,
        };
        if deviation.ticks < DEVIATION {
            self.deviates = None;
            return None;
        }
        let (since, _) = *self.deviates.get_or_insert((at, deviation));
        (at.since(since) >= DEVIATION_TIME).then_some(deviation)
    }
}

pub(crate) fn seconds(span: Duration) -> f64 {
    span.as_micros() as f64 / 1e6
}

/// The position nearest to a goal, which is between positions.
fn position(ticks: f64) -> Position {
    Position::new((ticks + 0.5) as u16).unwrap_or(Position::MAX)
}

/// The speed of a joint that is to move, nearest to this one.
fn speed_within(ticks_per_second: f64, max: Speed) -> Speed {
    let slowest = Speed::SLOWEST.min(max);
    match Speed::for_move(ticks_per_second.round() as u16) {
        Ok(speed) => speed.clamp(slowest, max),
        Err(_) if ticks_per_second < slowest.ticks_per_second().into() => slowest,
        Err(_) => max,
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;

    use super::*;

    fn reading(ticks: u16) -> JointState {
        JointState {
            joints: [ticks; JOINTS],
            gripper: 0,
            status: MotionStatus::Locked,
        }
    }

    const PERIOD: Duration = Duration::from_millis(10);

    /// The first joint of the move after so many milliseconds without one.
    fn advanced(goal: &mut Goal, millis: u64, target: f64, at: u16) -> (u16, u16) {
        let now = goal.at + Duration::from_millis(millis);
        let limits = Limits::FOLLOW;
        let target = goal.advance(now, &[target; JOINTS], Opening::CLOSED, &limits, &reading(at), PERIOD);
        let (position, speed) = target.joints[0];
        (position.ticks(), speed.ticks_per_second())
    }

    #[test]
    fn steps_are_limited_by_speed_and_by_distance() {
        let mut goal = Goal::of(Instant::ZERO, &reading(2_000)).unwrap();
        assert_eq!(advanced(&mut goal, 10, 4_000.0, 2_000), (2_010, 1_024));
        assert_eq!(advanced(&mut goal, 500, 4_000.0, 2_010), (2_066, 1_024));
        assert_eq!(advanced(&mut goal, 10, 0.0, 2_066).0, 2_056);
    }

    #[test]
    fn speed_arrives_with_the_next_goal() {
        let mut goal = Goal::of(Instant::ZERO, &reading(2_000)).unwrap();
        assert_eq!(advanced(&mut goal, 10, 2_005.0, 2_000), (2_005, 500));
        // Four ticks late, which are made up for in 50 ms.
        assert_eq!(advanced(&mut goal, 10, 2_010.0, 2_001), (2_010, 580));
        assert_eq!(advanced(&mut goal, 10, 2_010.0, 2_010), (2_010, 50));
    }

    #[test]
    fn slow_goals_arrive_at_high_rates() {
        let mut goal = Goal::of(Instant::ZERO, &reading(2_000)).unwrap();
        let limits = Limits {
            speed: Speed::SLOWEST,
            ..Limits::FOLLOW
        };
        for millis in 1..=1_000 {
            let now = Instant::from_millis(millis);
            let target = [2_100.0; JOINTS];
            goal.advance(now, &target, Opening::CLOSED, &limits, &reading(2_000), PERIOD);
        }
        assert!((goal.ticks[0] - 2_050.0).abs() < 0.001, "{}", goal.ticks[0]);
    }

    #[test]
    fn deviation_counts_after_half_a_second() {
        let mut goal = Goal::of(Instant::ZERO, &reading(2_000)).unwrap();
        let at = Instant::from_millis;
        assert_eq!(goal.deviation(at(0), &reading(2_114)), None);
        assert_eq!(goal.deviation(at(499), &reading(2_120)), None);
        assert_eq!(goal.deviation(at(500), &reading(2_113)), None);
        assert_eq!(goal.deviation(at(600), &reading(1_800)), None);
        let deviation = Deviation { joint: 1, ticks: 200 };
        assert_eq!(goal.deviation(at(1_100), &reading(1_800)), Some(deviation));
    }
}
