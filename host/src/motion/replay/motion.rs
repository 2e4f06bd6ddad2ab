//! A recorded motion, and the checks before it is replayed.

use std::error;
use std::fmt;

use armwire::OutOfRange;
use armwire::ling::{JOINTS, Opening, Position, Speed};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{Ticks, between, degrees, farthest, part, seconds, ticks};
use crate::motion::goal::Limits;
use crate::time::rate::Rate;

/// The longest time between two points in which a joint may move by more than a step.
const GAP: Duration = Duration::from_millis(500);

/// A pose of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Point {
    /// Its time on any clock, after that of the point before. The first point of a motion is its start.
    pub at: Instant,
    /// The joints.
    pub joints: [Position; JOINTS],
    /// The gripper's opening; `None` if it was not recorded.
    pub gripper: Option<Opening>,
}

/// The part of a recording that is replayed, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Range {
    /// Time since the first point of the recording.
    pub from: Duration,
    /// Time since the first point of the recording; `None` for its end.
    pub to: Option<Duration>,
    /// Factor of its speed: finite, over 0, and with 1 µs between two poses at least.
    pub speed: f64,
}

impl Default for Range {
    /// The whole recording, at its speed.
    fn default() -> Self {
        Self {
            from: Duration::ZERO,
            to: None,
            speed: 1.0,
        }
    }
}

/// The reason why a recording is not replayed. Times are those of the recording, from its first point.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum Refusal {
    /// The recording, or the part of it, has no pose.
    Empty,
    /// The time of a pose, from 1, is not after that of the one before.
    Order {
        /// The pose.
        pose: usize,
        /// The number of poses.
        poses: usize,
    },
    /// The factor of the speed is not over 0, not finite, or leaves less than 1 µs between two poses.
    Speed(f64),
    /// No joint moves within the limits.
    Limits(OutOfRange),
    /// A joint is faster than the limit.
    Jump {
        /// The time of the pose before.
        at: Duration,
        /// The joint, from 1.
        joint: u8,
        /// The distance in degrees…
        degrees: f64,
        /// …and the time for it, as it would be replayed.
        within: Duration,
        /// The limit.
        max: Speed,
    },
    /// A joint is faster than the steps of goals at this rate.
    Rate {
        /// The time of the pose before.
        at: Duration,
        /// The joint, from 1.
        joint: u8,
        /// The distance in degrees…
        degrees: f64,
        /// …and the time for it, as it would be replayed.
        within: Duration,
        /// The rate.
        rate: Rate,
        /// The maximum distance between two goals, in degrees.
        step: f64,
        /// The least rate that would do, if one does.
        needed: Option<Rate>,
    },
    /// A joint moved while nothing was recorded.
    Gap {
        /// The time of the pose before.
        at: Duration,
        /// The time without a pose.
        length: Duration,
        /// The joint, from 1.
        joint: u8,
        /// Its motion in that time, in degrees.
        degrees: f64,
    },
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Empty => f.write_str("there is no pose in this part of it"),
            Self::Order { pose, poses } => write!(
                f,
                "the time of pose {pose} of {poses} is not after that of pose {}",
                pose - 1
            ),
            Self::Speed(factor) => write!(
                f,
                "the factor of the speed is {factor}, must be over 0, finite, and leave 1 µs between two poses"
            ),
            Self::Limits(error) => error.fmt(f),
            Self::Jump {
                at,
                joint,
                degrees,
                within,
                max,
            } => {
                let max = f64::from(max.radians_per_second()).to_degrees();
                let (at, within) = (seconds(at), within.as_micros() as f64 / 1e3);
                write!(
                    f,
                    "joint {joint} jumps by {degrees:.1}° within {within:.0} ms at {at:.2} s: the limit is {max:.0}°/s"
                )
            }
            Self::Rate {
                at,
                joint,
                degrees,
                within,
                rate,
                step,
                needed,
            } => {
                let (at, within, hertz) = (seconds(at), within.as_micros() as f64 / 1e3, rate.hertz());
                write!(
                    f,
                    "joint {joint} moves by {degrees:.1}° within {within:.0} ms at {at:.2} s, and steps of {step:.1}° at \
                     {hertz} Hz are slower: "
                )?;
                Rate::write_needed(needed, f)
            }
            Self::Gap {
                at,
                length,
                joint,
                degrees,
            } => {
                let (at, length) = (seconds(at), seconds(length));
                write!(
                    f,
                    "nothing was recorded for {length:.1} s at {at:.2} s, and joint {joint} moved by {degrees:.1}°"
                )
            }
        }
    }
}

impl error::Error for Refusal {}

/// A motion that an arm can make within its limits.
///
/// ```
/// use armwire::ling::{Opening, Position};
/// use armwire::time::Instant;
/// use armwire_host::replay::{Motion, Point, Range};
/// use armwire_host::{Limits, Rate};
///
/// let point = |millis, ticks| Point {
///     at: Instant::from_millis(millis),
///     joints: [Position::new(ticks).unwrap(); 6],
///     gripper: None,
/// };
/// let slow = [point(0, 2048), point(100, 2148), point(200, 2248)];
/// assert!(Motion::new(&slow, &Range::default(), Limits::REPLAY, Rate::MOVES).is_ok());
/// let jump = Motion::new(&[point(0, 2048), point(100, 3072)], &Range::default(), Limits::REPLAY, Rate::MOVES);
/// let text = "joint 1 jumps by 90.0° within 100 ms at 0.00 s: the limit is 180°/s";
/// assert_eq!(jump.unwrap_err().to_string(), text);
/// ```
#[derive(Clone, Debug)]
pub struct Motion {
    /// The points, whose times grow. Never empty.
    knots: Vec<Knot>,
    limits: Limits,
    rate: Rate,
}

/// A point at its time since the start, as it is replayed.
#[derive(Clone, Debug)]
struct Knot {
    at: Duration,
    ticks: Ticks,
    /// The last goal of the gripper; `None` if it was not recorded up to here.
    gripper: Option<Opening>,
}

impl Motion {
    /// The part of a recording, for an arm that gets moves at this rate.
    ///
    /// # Errors
    ///
    /// [`Refusal`] if goals within the limits, at this rate, would be more than a step behind; a step is for the jitter of
    /// recorded times. And if a joint moved by more than a step while nothing was recorded for 0.5 s.
    pub fn new(points: &[Point], range: &Range, limits: Limits, rate: Rate) -> Result<Self, Refusal> {
        limits.check().map_err(Refusal::Limits)?;
        let Some(first) = points.first() else {
            return Err(Refusal::Empty);
        };
        if let Some(nth) = points.windows(2).position(|pair| pair[1].at <= pair[0].at) {
            let (pose, poses) = (nth + 2, points.len());
            return Err(Refusal::Order { pose, poses });
        }
        let times = points.iter().map(|point| (point.at.since(first.at), point));
        let is_in = |at: Duration| range.from <= at && range.to.is_none_or(|to| at <= to);
        let part: Vec<_> = times.filter(|(at, _)| is_in(*at)).collect();
        let Some(&(start, _)) = part.first() else {
            return Err(Refusal::Empty);
        };
        let mut gripper = None;
        let mut knots = Vec::new();
        for (at, point) in &part {
            gripper = point.gripper.or(gripper);
            knots.push(Knot {
                at: scaled(span(start, *at), range.speed).ok_or(Refusal::Speed(range.speed))?,
                ticks: ticks(point.joints),
                gripper,
            });
        }
        if knots.windows(2).any(|pair| pair[1].at <= pair[0].at) {
            return Err(Refusal::Speed(range.speed));
        }
        let motion = Self { knots, limits, rate };
        motion.check(&part)?;
        Ok(motion)
    }

    /// The time from the first pose to the last, as it is replayed.
    pub fn length(&self) -> Duration {
        self.knots.last().map_or(Duration::ZERO, |knot| knot.at)
    }

    /// True if the gripper was recorded.
    pub fn has_gripper(&self) -> bool {
        self.knots.iter().any(|knot| knot.gripper.is_some())
    }

    pub(super) fn limits(&self) -> &Limits {
        &self.limits
    }

    pub(super) fn rate(&self) -> Rate {
        self.rate
    }

    /// The joints at a time since the start, between two points on the line between them. Before the start and after the
    /// end, the first and the last pose.
    pub(super) fn joints(&self, at: Duration) -> Ticks {
        let next = self.knots.partition_point(|knot| knot.at <= at);
        let from = &self.knots[next.saturating_sub(1)];
        let to = &self.knots[next.min(self.knots.len() - 1)];
        between(&from.ticks, &to.ticks, part(from.at, to.at, at))
    }

    /// The last goal of the gripper at this time.
    pub(super) fn gripper(&self, at: Duration) -> Option<Opening> {
        let next = self.knots.partition_point(|knot| knot.at <= at);
        self.knots[next.saturating_sub(1)].gripper
    }

    /// Checks gaps and speeds. The points are those of the knots, with their times in the recording.
    fn check(&self, part: &[(Duration, &Point)]) -> Result<(), Refusal> {
        let step: f64 = self.limits.step.into();
        for (pair, points) in self.knots.windows(2).zip(part.windows(2)) {
            let (at, length) = (points[0].0, span(points[0].0, points[1].0));
            let (joint, distance) = farthest(&pair[0].ticks, &pair[1].ticks);
            if length >= GAP && distance > step {
                return Err(Refusal::Gap {
                    at,
                    length,
                    joint: joint as u8 + 1,
                    degrees: degrees(distance),
                });
            }
        }
        let max = self.limits.speeds.map(|speed| f64::from(speed.ticks_per_second()));
        if let Some(burst) = self.burst(&max) {
            return Err(Refusal::Jump {
                at: part[burst.first].0,
                joint: burst.joint as u8 + 1,
                degrees: degrees(burst.distance),
                within: burst.within,
                max: self.limits.speeds[burst.joint],
            });
        }
        let at_rate = |rate: Rate| max.map(|max| max.min(step * f64::from(rate.hertz())));
        let Some(burst) = self.burst(&at_rate(self.rate)) else {
            return Ok(());
        };
        let mut faster = (self.rate.hertz() + 1..=Rate::MAX).filter_map(|hertz| Rate::new(hertz).ok());
        Err(Refusal::Rate {
            at: part[burst.first].0,
            joint: burst.joint as u8 + 1,
            degrees: degrees(burst.distance),
            within: burst.within,
            rate: self.rate,
            step: degrees(step),
            needed: faster.find(|rate| self.burst(&at_rate(*rate)).is_none()),
        })
    }

    /// The first motion of a joint that goals of at most this speed, in ticks per second, would follow by more than a step
    /// behind.
    fn burst(&self, max: &Ticks) -> Option<Burst> {
        let step: f64 = self.limits.step.into();
        let start = self.knots.first()?;
        // The goals that follow, and the last knot at which each was not behind.
        let (mut goals, mut since) = (start.ticks, [0; JOINTS]);
        for (nth, pair) in self.knots.windows(2).enumerate() {
            let passed = seconds(span(pair[0].at, pair[1].at));
            for joint in 0..JOINTS {
                let target = pair[1].ticks[joint];
                let (way, most) = (target - goals[joint], max[joint] * passed);
                if way.abs() <= most {
                    (goals[joint], since[joint]) = (target, nth + 1);
                    continue;
                }
                goals[joint] += most.copysign(way);
                if way.abs() - most > step {
                    let first = &self.knots[since[joint]];
                    return Some(Burst {
                        first: since[joint],
                        joint,
                        distance: (target - first.ticks[joint]).abs(),
                        within: span(first.at, pair[1].at),
                    });
                }
            }
        }
        None
    }
}

/// A motion that is too fast.
struct Burst {
    /// The knot before it.
    first: usize,
    /// The joint, from 0.
    joint: usize,
    /// The distance, in ticks, and the time for it.
    distance: f64,
    within: Duration,
}

/// The time between two times since the start.
fn span(from: Duration, to: Duration) -> Duration {
    Duration::from_micros(to.as_micros().saturating_sub(from.as_micros()))
}

/// A time at a factor of the speed; `None` if there is none on the clock.
fn scaled(at: Duration, speed: f64) -> Option<Duration> {
    let micros = (at.as_micros() as f64 / speed).round();
    let is_on_clock = speed.is_finite() && speed > 0.0 && micros < u64::MAX as f64;
    is_on_clock.then(|| Duration::from_micros(micros as u64))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A point with all joints at this position, and perhaps an opening.
    fn point(millis: u64, ticks: u16, gripper: Option<u16>) -> Point {
        Point {
            at: Instant::from_millis(500 + millis),
            joints: [Position::new(ticks).unwrap(); JOINTS],
            gripper: gripper.map(|opening| Opening::new(opening).unwrap()),
        }
    }

    fn motion(points: &[Point], range: Range) -> Result<Motion, Refusal> {
        Motion::new(points, &range, Limits::REPLAY, Rate::MOVES)
    }

    #[test]
    fn poses_between_points_are_on_a_line() {
        let motion = motion(&[point(0, 2_000, None), point(100, 2_100, None)], Range::default()).unwrap();
        let at = |millis| motion.joints(Duration::from_millis(millis))[0];
        assert_eq!([0, 25, 100, 9_000].map(at), [2_000.0, 2_025.0, 2_100.0, 2_100.0]);
        assert!(!motion.has_gripper());
    }

    #[test]
    fn gripper_keeps_its_last_goal() {
        let points = [
            point(0, 2_000, Some(300)),
            point(100, 2_000, None),
            point(200, 2_000, Some(0)),
        ];
        let motion = motion(&points, Range::default()).unwrap();
        let at = |millis| motion.gripper(Duration::from_millis(millis)).unwrap().per_mille();
        assert_eq!([0, 199, 200, 900].map(at), [300, 300, 0, 0]);
    }

    #[test]
    fn part_of_a_recording_is_cut_and_scaled() {
        let points: Vec<_> = (0..=100).map(|n| point(n * 10, 2_000 + n as u16, None)).collect();
        let range = Range {
            from: Duration::from_millis(200),
            to: Some(Duration::from_millis(600)),
            speed: 0.5,
        };
        let motion = motion(&points, range).unwrap();
        assert_eq!(motion.length(), Duration::from_millis(800));
        let at = |millis| motion.joints(Duration::from_millis(millis))[5];
        assert_eq!([0, 400, 800].map(at), [2_020.0, 2_040.0, 2_060.0]);
    }

    #[test]
    fn jumps_are_refused_at_the_speed_of_the_replay() {
        // 1500 ticks/s, in points of 10 ms.
        let points: Vec<_> = (0..=100).map(|n| point(n * 10, 1_000 + 15 * n as u16, None)).collect();
        assert!(motion(&points, Range::default()).is_ok());
        let fast = Range {
            speed: 2.0,
            ..Range::default()
        };
        let refused = motion(&points, fast);
        assert!(matches!(refused, Err(Refusal::Jump { joint: 1, .. })), "{refused:?}");
    }

    #[test]
    fn slow_excess_of_the_limit_is_refused() {
        // 2200 ticks/s, where 2048 are allowed: 56 ticks behind after 0.37 s.
        let points: Vec<_> = (0..=40).map(|n| point(n * 10, 1_000 + 22 * n as u16, None)).collect();
        let text = "joint 1 jumps by 71.5° within 370 ms at 0.00 s: the limit is 180°/s";
        assert_eq!(motion(&points, Range::default()).unwrap_err().to_string(), text);
    }

    #[test]
    fn jitter_of_times_is_no_jump() {
        // 1000 ticks/s, every third point 9 ms late.
        let points = (0..=100).map(|n| point(n * 10 + if n % 3 == 0 { 9 } else { 0 }, 1_000 + 10 * n as u16, None));
        assert!(motion(&points.collect::<Vec<_>>(), Range::default()).is_ok());
    }

    #[test]
    fn many_small_jumps_are_one() {
        let points: Vec<_> = (0..=20).map(|n| point(n, 1_000 + 50 * n as u16, None)).collect();
        let points = [&points[..], &[point(200, 2_000, None)]].concat();
        assert!(matches!(motion(&points, Range::default()), Err(Refusal::Jump { .. })));
    }

    #[test]
    fn motion_that_was_not_recorded_is_refused() {
        let points = [point(0, 2_000, None), point(2_000, 2_300, None)];
        let refused = motion(&points, Range::default()).unwrap_err();
        let text = "nothing was recorded for 2.0 s at 0.00 s, and joint 1 moved by 26.4°";
        assert_eq!(refused.to_string(), text);
        let still = [point(0, 2_000, None), point(2_000, 2_010, None)];
        assert!(motion(&still, Range::default()).is_ok());
    }

    #[test]
    fn nothing_to_replay_is_refused() {
        let later = Range {
            from: Duration::from_millis(1_000),
            ..Range::default()
        };
        assert_eq!(motion(&[point(0, 2_000, None)], later).unwrap_err(), Refusal::Empty);
        assert_eq!(motion(&[], Range::default()).unwrap_err(), Refusal::Empty);
        let still = Range {
            speed: 0.0,
            ..Range::default()
        };
        assert_eq!(motion(&[point(0, 0, None)], still).unwrap_err(), Refusal::Speed(0.0));
    }
}
