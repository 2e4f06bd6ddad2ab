//! Motion while a key or button is held: from directions and time to the next target.
//!
//! A target is at most [`LOOKAHEAD`] of motion away. An arm whose host disappears during a motion therefore soon stops by
//! itself.

use armwire::OutOfRange;
use armwire::ling::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Speed};
use armwire::time::{Duration, Instant};

/// The joints, then the gripper.
pub const AXES: usize = JOINTS + 1;
/// Targets are this much motion ahead of the setpoint: 2.5 periods, so that a lost or late target does not stop the arm.
pub const LOOKAHEAD: Duration = Duration::from_millis(100);
/// The time between two targets.
pub const PERIOD: Duration = Duration::from_millis(40);
/// The setpoint is at most this much motion plus [`SLACK`] ahead of the arm: it waits for an arm that cannot follow.
const LEAD: Duration = Duration::from_millis(250);
/// In ticks, or in thousandths of the gripper's stroke.
const SLACK: f32 = 20.0;
/// The gripper's speed: in thousandths of its stroke per second for the setpoint, in ticks per second for the arm.
const GRIPPER_SPEED: u16 = 500;
/// The initial speed of the joints: 20°/s.
const SPEED: u16 = 228;

/// The direction of an axis.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// To smaller angles, or to closed.
    Down,
    /// None.
    Rest,
    /// To larger angles, or to open.
    Up,
}

/// The held axes and the setpoint of their motion.
#[derive(Clone, Debug)]
pub struct Jog {
    directions: [Direction; AXES],
    speed: Speed,
    setpoint: Option<Setpoint>,
}

/// The arm's target, in ticks and thousandths of the gripper's stroke.
#[derive(Clone, Copy, Debug)]
struct Setpoint {
    at: Instant,
    axes: [f32; AXES],
}

impl Default for Jog {
    fn default() -> Self {
        Self {
            directions: [Direction::Rest; AXES],
            speed: Speed::new(SPEED).unwrap_or(Speed::MAX),
            setpoint: None,
        }
    }
}

impl Jog {
    /// Holds an axis, 0 to 5 for the joints and 6 for the gripper, or releases it. Returns true for a change.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] for another axis.
    pub fn hold(&mut self, now: Instant, axis: usize, direction: Direction) -> Result<bool, OutOfRange<usize>> {
        self.advance(now);
        let error = OutOfRange::new("axis", "", axis, 0, AXES - 1);
        let held = self.directions.get_mut(axis).ok_or(error)?;
        Ok(std::mem::replace(held, direction) != direction)
    }

    /// Releases all axes. Returns true if one was held.
    pub fn release(&mut self, now: Instant) -> bool {
        self.advance(now);
        let held = self.is_held();
        self.directions = [Direction::Rest; AXES];
        held
    }

    /// Returns true if an axis is held.
    pub fn is_held(&self) -> bool {
        self.directions.iter().any(|direction| *direction != Direction::Rest)
    }

    /// Sets the speed of the joints.
    pub fn set_speed(&mut self, speed: Speed) {
        self.speed = speed;
    }

    /// Returns true from the first target of a motion until it is stopped.
    pub fn is_moving(&self) -> bool {
        self.setpoint.is_some()
    }

    /// The target at `now`, by the arm's last reading. The first target of a motion starts from the reading.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if a position in the reading cannot be a target.
    pub fn target(&mut self, now: Instant, reading: &JointState) -> Result<Move, OutOfRange> {
        let positions = axes(reading)?;
        self.advance(now);
        let mut axes = self.setpoint.map_or(positions, |setpoint| setpoint.axes);
        for (axis, (value, position)) in axes.iter_mut().zip(positions).enumerate() {
            let lead = self.travel(axis, LEAD).abs() + SLACK;
            *value = within(within(*value, position - lead, position + lead), 0.0, top(axis));
        }
        self.setpoint = Some(Setpoint { at: now, axes });
        self.move_to(|axis| within(axes[axis] + self.travel(axis, LOOKAHEAD), 0.0, top(axis)))
    }

    /// Ends the motion and returns the target that stops the arm: the setpoint at `now`. `None` without a motion.
    pub fn stop(&mut self, now: Instant, reading: &JointState) -> Option<Move> {
        self.setpoint?;
        let target = self.target(now, reading).ok();
        self.setpoint = None;
        target
    }

    /// Ends the motion without a last target.
    pub fn reset(&mut self) {
        self.setpoint = None;
    }

    /// Moves the setpoint in the held directions up to `now`. After a pause of the page it makes a single step.
    fn advance(&mut self, now: Instant) {
        let Some(mut setpoint) = self.setpoint else {
            return;
        };
        let elapsed = now.since(setpoint.at).min(LOOKAHEAD);
        setpoint.at = now;
        for (axis, value) in setpoint.axes.iter_mut().enumerate() {
            *value += self.travel(axis, elapsed);
        }
        self.setpoint = Some(setpoint);
    }

    /// The signed motion of an axis in this time.
    fn travel(&self, axis: usize, span: Duration) -> f32 {
        let speed = match axis < JOINTS {
            true => self.speed.ticks_per_second(),
            false => GRIPPER_SPEED,
        };
        let distance = f32::from(speed) * span.as_micros() as f32 / 1e6;
        match self.directions[axis] {
            Direction::Down => -distance,
            Direction::Rest => 0.0,
            Direction::Up => distance,
        }
    }

    fn move_to(&self, value: impl Fn(usize) -> f32) -> Result<Move, OutOfRange> {
        let mut joints = [(Position::CENTRE, self.speed); JOINTS];
        for (axis, (position, _)) in joints.iter_mut().enumerate() {
            *position = Position::new(value(axis).round() as u16)?;
        }
        let opening = Opening::new(value(JOINTS).round() as u16)?;
        Ok(Move {
            joints,
            gripper: (opening, GripperSpeed(GRIPPER_SPEED)),
        })
    }
}

/// The positions in a reading as numbers.
fn axes(reading: &JointState) -> Result<[f32; AXES], OutOfRange> {
    let [a, b, c, d, e, f] = reading.positions()?.map(|position| f32::from(position.ticks()));
    Ok([a, b, c, d, e, f, f32::from(reading.opening()?.per_mille())])
}

/// The nearest value in this range. `f32::clamp` can panic, and its message formats floats: a fifth of the module.
fn within(value: f32, min: f32, max: f32) -> f32 {
    value.max(min).min(max)
}

/// The upper end of an axis.
fn top(axis: usize) -> f32 {
    match axis < JOINTS {
        true => f32::from(Position::MAX.ticks()),
        false => f32::from(Opening::OPEN.per_mille()),
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;

    use super::*;

    const CENTRED: JointState = JointState {
        joints: [2048; JOINTS],
        gripper: 500,
        status: MotionStatus::Locked,
    };

    fn millis(millis: u64) -> Instant {
        Instant::from_millis(1_000 + millis)
    }

    fn jog(axis: usize, direction: Direction) -> Jog {
        let mut jog = Jog::default();
        jog.set_speed(Speed::new(1_000).unwrap());
        assert_eq!(jog.hold(millis(0), axis, direction), Ok(true));
        jog
    }

    fn ticks(target: Move) -> [u16; JOINTS] {
        target.joints.map(|(position, _)| position.ticks())
    }

    #[test]
    fn target_is_one_lookahead_from_the_reading() {
        let target = jog(1, Direction::Down).target(millis(0), &CENTRED).unwrap();
        assert_eq!(ticks(target), [2048, 1948, 2048, 2048, 2048, 2048]);
        assert_eq!(target.gripper.0.per_mille(), 500);
    }

    #[test]
    fn setpoint_moves_at_speed_of_joints() {
        let mut jog = jog(0, Direction::Up);
        let mut reading = CENTRED;
        for step in 0..=10 {
            reading.joints[0] = 2048 + 40 * step;
            let target = jog.target(millis(40 * u64::from(step)), &reading).unwrap();
            assert_eq!(ticks(target)[0], 2048 + 40 * step + 100);
        }
    }

    #[test]
    fn released_arm_stops_at_the_setpoint() {
        let mut jog = jog(0, Direction::Up);
        jog.target(millis(0), &CENTRED).unwrap();
        assert!(jog.release(millis(20)));
        let stop = jog.stop(millis(30), &CENTRED).unwrap();
        assert_eq!(ticks(stop), [2068, 2048, 2048, 2048, 2048, 2048]);
        assert_eq!(jog.stop(millis(40), &CENTRED), None);
    }

    #[test]
    fn setpoint_waits_for_arm_that_lags() {
        let mut jog = jog(0, Direction::Up);
        let last = (0..100)
            .map(|step| jog.target(millis(40 * step), &CENTRED).unwrap())
            .last();
        assert_eq!(ticks(last.unwrap())[0], 2048 + 250 + 20 + 100);
    }

    #[test]
    fn axes_stop_at_the_ends_of_their_ranges() {
        let mut jog = jog(6, Direction::Up);
        assert_eq!(jog.hold(millis(0), 5, Direction::Up), Ok(true));
        let mut reading = CENTRED;
        (reading.joints[5], reading.gripper) = (4090, 999);
        let target = jog.target(millis(0), &reading).unwrap();
        assert_eq!((ticks(target)[5], target.gripper.0.per_mille()), (4095, 1000));
    }

    #[test]
    fn pause_of_the_page_causes_no_jump() {
        let mut jog = jog(0, Direction::Up);
        jog.target(millis(0), &CENTRED).unwrap();
        let target = jog.target(millis(60_000), &CENTRED).unwrap();
        assert_eq!(ticks(target)[0], 2048 + 100 + 100);
    }

    #[test]
    fn reading_out_of_range_starts_no_motion() {
        let mut reading = CENTRED;
        reading.gripper = 2051;
        let error = jog(0, Direction::Up).target(millis(0), &reading).unwrap_err();
        assert_eq!(error.to_string(), "gripper opening is 2051 ‰, must be 0..=1000");
    }

    #[test]
    fn unknown_axis_is_an_error() {
        let error = Jog::default().hold(millis(0), 7, Direction::Up).unwrap_err();
        assert_eq!(error.to_string(), "axis is 7, must be 0..=6");
    }
}
