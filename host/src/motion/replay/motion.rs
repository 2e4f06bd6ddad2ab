//! A recorded motion, and the checks before it is replayed.

use std::error;
use std::fmt;

use armwire::ling::{JOINTS, Opening, Position, Speed};
use armwire::time::{Duration, Instant};

use crate::motion::axes::{Ticks, between, degrees, farthest, part, seconds, ticks};
use crate::motion::goal::Limits;

/// The longest time between two points in which a joint may move by more than a step.
const GAP: Duration = Duration::from_millis(500);
/// The span in which the speed of a motion is judged: the times of single points jitter.
const SPAN: Duration = Duration::from_millis(100);

/// A pose of a recording.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Point {
    /// Its time on any clock. The first point of a motion is its start.
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
    /// Factor of its speed, over 0.
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
    /// The factor of the speed is not over 0.
    Speed(f64),
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
            Self::Speed(factor) => write!(f, "the factor of the speed is {factor}, must be over 0"),
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
/// use armwire_host::Limits;
/// use armwire_host::replay::{Motion, Point, Range};
///
/// let point = |millis, ticks| Point {
///     at: Instant::from_millis(millis),
///     joints: [Position::new(ticks).unwrap(); 6],
///     gripper: None,
/// };
/// let slow = [point(0, 2048), point(100, 2148), point(200, 2248)];
/// assert!(Motion::new(&slow, &Range::default(), Limits::REPLAY).is_ok());
/// let jump = Motion::new(&[point(0, 2048), point(100, 3072)], &Range::default(), Limits::REPLAY);
/// let text = "joint 1 jumps by 90.0° within 100 ms at 0.00 s: the limit is 180°/s";
/// assert_eq!(jump.unwrap_err().to_string(), text);
/// ```
#[derive(Clone, Debug)]
pub struct Motion {
    /// The points, whose times grow. Never empty.
    knots: Vec<Knot>,
    limits: Limits,
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
    /// The part of a recording. Points that are no later than the one before are left out.
    ///
    /// # Errors
    ///
    /// [`Refusal`] if a joint is faster than the limit, or moved by more than a step while nothing was recorded for
    /// 0.5 s. A speed may exceed the limit by one step in 0.1 s: the times of recordings jitter.
    pub fn new(points: &[Point], range: &Range, limits: Limits) -> Result<Self, Refusal> {
        if range.speed.is_nan() || range.speed <= 0.0 {
            return Err(Refusal::Speed(range.speed));
        }
        let Some(first) = points.first() else {
            return Err(Refusal::Empty);
        };
        let mut part: Vec<(Duration, &Point)> = Vec::new();
        for point in points {
            let at = point.at.since(first.at);
            let is_in = range.from <= at && range.to.is_none_or(|to| at <= to);
            if is_in && part.last().is_none_or(|(before, _)| *before < at) {
                part.push((at, point));
            }
        }
        let Some(&(start, _)) = part.first() else {
            return Err(Refusal::Empty);
        };
        let mut gripper = None;
        let knots = part.iter().map(|(at, point)| {
            gripper = point.gripper.or(gripper);
            Knot {
                at: scaled(span(start, *at), range.speed),
                ticks: ticks(point.joints),
                gripper,
            }
        });
        let motion = Self {
            knots: knots.collect(),
            limits,
        };
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

    /// Checks speeds and gaps. The points are those of the knots, with their times in the recording.
    fn check(&self, part: &[(Duration, &Point)]) -> Result<(), Refusal> {
        let step: f64 = self.limits.step.into();
        let mut later = 0;
        for (nth, knot) in self.knots.iter().enumerate() {
            let at = part[nth].0;
            if let Some(next) = self.knots.get(nth + 1) {
                let length = span(at, part[nth + 1].0);
                let (joint, distance) = farthest(&knot.ticks, &next.ticks);
                if length >= GAP && distance > step {
                    return Err(Refusal::Gap {
                        at,
                        length,
                        joint: joint as u8 + 1,
                        degrees: degrees(distance),
                    });
                }
            }
            while self.knots.get(later).is_some_and(|end| end.at < knot.at + SPAN) {
                later += 1;
            }
            // The next point, and the first one behind the span.
            for end in [nth + 1, later] {
                let Some(end) = self.knots.get(end) else { continue };
                let within = span(knot.at, end.at);
                let max = self.limits.speeds.map(|speed| f64::from(speed.ticks_per_second()));
                let jump = (0..JOINTS).map(|joint| {
                    let distance = (end.ticks[joint] - knot.ticks[joint]).abs();
                    (joint, distance, distance - max[joint] * seconds(within) - step)
                });
                let farther =
                    |most: (usize, f64, f64), next: (usize, f64, f64)| if next.2 > most.2 { next } else { most };
                let (joint, distance, excess) = jump.fold((0, 0.0, 0.0), farther);
                if excess > 0.0 {
                    return Err(Refusal::Jump {
                        at,
                        joint: joint as u8 + 1,
                        degrees: degrees(distance),
                        within,
                        max: self.limits.speeds[joint],
                    });
                }
            }
        }
        Ok(())
    }
}

/// The time between two times since the start.
fn span(from: Duration, to: Duration) -> Duration {
    Duration::from_micros(to.as_micros().saturating_sub(from.as_micros()))
}

/// A time at a factor of the speed.
fn scaled(at: Duration, speed: f64) -> Duration {
    Duration::from_micros((at.as_micros() as f64 / speed).round() as u64)
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
        Motion::new(points, &range, Limits::REPLAY)
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
