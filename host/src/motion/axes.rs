//! Poses in the arm's units, with their fractions, and distances between them.

use armwire::OutOfRange;
use armwire::ling::{JOINTS, JointState, Opening, Position, TICKS_PER_TURN};
use armwire::time::Duration;

/// The joints, then the gripper.
pub const AXES: usize = JOINTS + 1;

/// A pose: the joints in ticks, and the gripper in thousandths of its stroke.
pub type Axes = [f64; AXES];

/// The allowed distance of each axis, in the units of [`Axes`]. `None` allows any.
pub type Tolerance = [Option<f64>; AXES];

/// The joints in ticks.
pub(crate) type Ticks = [f64; JOINTS];

/// An axis that is too far from where it is to be.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Off {
    /// The axis, from 0.
    pub axis: usize,
    /// Its distance, in the units of [`Axes`].
    pub distance: f64,
    /// The allowed distance.
    pub allowed: f64,
}

/// The axis that exceeds its tolerance most, if one does.
pub(crate) fn off(one: &Axes, other: &Axes, tolerance: &Tolerance) -> Option<Off> {
    let axes = (0..AXES).filter_map(|axis| {
        let distance = (one[axis] - other[axis]).abs();
        let allowed = tolerance[axis].filter(|allowed| distance > *allowed)?;
        Some(Off {
            axis,
            distance,
            allowed,
        })
    });
    axes.reduce(
        |most, next| match next.distance * most.allowed > most.distance * next.allowed {
            true => next,
            false => most,
        },
    )
}

/// The pose in a reading. A gripper beyond the open end stands for that end, as in a stop.
///
/// # Errors
///
/// [`OutOfRange`] for joints that no move can express.
pub(crate) fn axes(reading: &JointState) -> Result<Axes, OutOfRange> {
    let opening = reading.opening().unwrap_or(Opening::OPEN);
    Ok(with_gripper(ticks(reading.positions()?), opening.per_mille().into()))
}

pub(crate) fn with_gripper([a, b, c, d, e, f]: Ticks, gripper: f64) -> Axes {
    [a, b, c, d, e, f, gripper]
}

/// The joints of a pose.
pub(crate) fn joints([a, b, c, d, e, f, _]: &Axes) -> Ticks {
    [*a, *b, *c, *d, *e, *f]
}

/// Positions in ticks.
pub(crate) fn ticks(positions: [Position; JOINTS]) -> Ticks {
    positions.map(|position| position.ticks().into())
}

/// Refuses a pose that no move can express.
///
/// # Errors
///
/// [`OutOfRange`] for an axis whose value, rounded to whole units, is none of the arm's.
pub(crate) fn check(axes: &Axes) -> Result<(), OutOfRange<f32>> {
    for (axis, value) in axes.iter().enumerate() {
        let (what, unit, max) = match axis < JOINTS {
            true => ("joint position", "ticks", Position::MAX.ticks()),
            false => ("gripper opening", "‰", Opening::OPEN.per_mille()),
        };
        if !(-0.5..f64::from(max) + 0.5).contains(value) {
            return Err(OutOfRange::new(what, unit, *value as f32, 0.0, max.into()));
        }
    }
    Ok(())
}

/// The position nearest to one between positions.
pub(crate) fn position(ticks: f64) -> Position {
    Position::new((ticks + 0.5) as u16).unwrap_or(Position::MAX)
}

/// The opening nearest to one between openings.
pub(crate) fn opening(per_mille: f64) -> Opening {
    Opening::new((per_mille + 0.5) as u16).unwrap_or(Opening::OPEN)
}

/// The joint that is farthest from another pose, from 0, and the distance in ticks.
pub(crate) fn farthest(one: &[f64], other: &[f64]) -> (usize, f64) {
    let distances = one.iter().zip(other).map(|(one, other)| (one - other).abs());
    let farther = |most: (usize, f64), next: (usize, f64)| if next.1 > most.1 { next } else { most };
    distances.enumerate().fold((0, 0.0), farther)
}

/// Degrees of so many ticks.
pub(crate) fn degrees(ticks: f64) -> f64 {
    ticks * 360.0 / f64::from(TICKS_PER_TURN)
}

pub(crate) fn seconds(span: Duration) -> f64 {
    span.as_micros() as f64 / 1e6
}

/// The part of the way that a line from one time to another has made at a time between them.
pub(crate) fn part(from: Duration, to: Duration, at: Duration) -> f64 {
    let length = seconds(to) - seconds(from);
    match length > 0.0 {
        true => ((seconds(at) - seconds(from)) / length).clamp(0.0, 1.0),
        false => 1.0,
    }
}

/// The pose at a part of the way.
pub(crate) fn between<const N: usize>(from: &[f64; N], to: &[f64; N], part: f64) -> [f64; N] {
    std::array::from_fn(|axis| match part < 1.0 {
        true => from[axis] + (to[axis] - from[axis]) * part,
        // Exactly, without rounding.
        false => to[axis],
    })
}
