//! The end of a replay: the arm at rest at the last pose.

use armwire::ling::arrival::Tolerances;
use armwire::ling::{JOINTS, Rest};
use armwire::time::Instant;

use super::failure::{Failure, LIMIT};
use crate::motion::axes::{Off, Ticks, farthest};

/// The arrival at the last pose. Readings go in.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrival {
    pose: Ticks,
    /// The time since which the last pose is the goal.
    sent: Instant,
    window: Option<Window>,
}

/// Readings that lie close to each other.
#[derive(Clone, Copy, Debug)]
struct Window {
    /// The times of the first and of the last one.
    first: Instant,
    last: Instant,
    /// The last one.
    joints: Ticks,
    /// The bounds of the joints, in ticks.
    low: [u16; JOINTS],
    high: [u16; JOINTS],
    /// The joint that moved before them, from 0.
    moved: Option<usize>,
}

impl Arrival {
    /// The arrival at this pose, which is the goal since `sent`.
    pub(super) fn new(pose: Ticks, sent: Instant) -> Self {
        let window = None;
        Self { pose, sent, window }
    }

    /// Takes a reading of the joints that was made at `at`.
    pub(super) fn on_joints(&mut self, at: Instant, joints: &[u16; JOINTS]) {
        if at < self.sent {
            return;
        }
        let new = Window {
            first: at,
            last: at,
            joints: joints.map(f64::from),
            low: *joints,
            high: *joints,
            moved: None,
        };
        let Some(window) = &mut self.window else {
            self.window = Some(new);
            return;
        };
        for (joint, ticks) in joints.iter().enumerate() {
            window.low[joint] = window.low[joint].min(*ticks);
            window.high[joint] = window.high[joint].max(*ticks);
        }
        let spans = window.high.iter().zip(window.low).map(|(high, low)| high - low);
        let moved = spans.enumerate().find(|(_, span)| *span > Rest::TOLERANCE);
        *window = match moved.map(|(joint, _)| joint) {
            moved @ Some(_) => Window { moved, ..new },
            None => Window {
                last: at,
                joints: new.joints,
                ..*window
            },
        };
    }

    /// The end at `now`; `None` before it.
    pub(super) fn end(&self, now: Instant) -> Option<Result<(), Failure>> {
        let window = self.window?;
        let (axis, distance) = farthest(&window.joints, &self.pose);
        let is_at_rest = window.last.since(window.first) >= Rest::TIME;
        let is_there = distance <= f64::from(Tolerances::JOINT);
        match (is_at_rest, is_there) {
            (true, true) => Some(Ok(())),
            // It may begin to move yet.
            _ if now.since(self.sent) < LIMIT => None,
            // Without a motion, readings are late.
            (false, _) => Some(Err(Failure::Moving(window.moved? as u8 + 1))),
            (true, false) => Some(Err(Failure::Away(Off {
                axis,
                distance,
                allowed: Tolerances::JOINT.into(),
            }))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The end of an arrival at 2,048 ticks with readings of joint 3, each with its time in milliseconds.
    fn end(readings: impl IntoIterator<Item = (u64, u16)>) -> Option<(u64, Result<(), Failure>)> {
        let mut arrival = Arrival::new([2_048.0; JOINTS], Instant::ZERO);
        readings.into_iter().find_map(|(millis, ticks)| {
            let mut joints = [2_048; JOINTS];
            joints[2] = ticks;
            let now = Instant::from_millis(millis);
            arrival.on_joints(now, &joints);
            Some((millis, arrival.end(now)?))
        })
    }

    #[test]
    fn arm_at_rest_within_the_tolerance_has_arrived() {
        let sagging = (0..)
            .step_by(10)
            .map(|millis| (millis, 2_048 - 65 + (millis / 10 % 4) as u16));
        assert_eq!(end(sagging), Some((200, Ok(()))));
        let late = (0..)
            .step_by(10)
            .map(|millis| (millis, 2_000 + (millis / 10).min(40) as u16));
        assert_eq!(end(late), Some((600, Ok(()))));
    }

    #[test]
    fn arm_at_rest_elsewhere_is_away() {
        let off = Off {
            axis: 2,
            distance: 66.0,
            allowed: 65.0,
        };
        let away = (0..).step_by(10).map(|millis| (millis, 2_048 + 66));
        assert_eq!(end(away), Some((2_000, Err(Failure::Away(off)))));
    }

    #[test]
    fn arm_that_swings_is_not_at_rest() {
        let swinging = (0..)
            .step_by(10)
            .map(|millis| (millis, 2_048 + (millis / 100 % 2 * 4) as u16));
        assert_eq!(end(swinging), Some((2_000, Err(Failure::Moving(3)))));
    }

    #[test]
    fn slow_readings_show_a_rest() {
        assert_eq!(end([(0, 2_048), (1_000, 2_049)]), Some((1_000, Ok(()))));
    }
}
