//! Motion while a key or button is held: from directions and time to the next target.
//!
//! A target is never further away than [`LOOKAHEAD`] of motion. So an arm whose host disappears in the middle of it stops by
//! itself, and soon.

use armwire::OutOfRange;
use armwire::ling::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, Speed};
use armwire::time::{Duration, Instant};

/// The joints, then the gripper.
pub const AXES: usize = JOINTS + 1;
/// Targets are this much motion ahead of the setpoint: two and a half periods, so that one that is lost or late is no stop.
pub const LOOKAHEAD: Duration = Duration::from_millis(100);
/// The time between two targets.
pub const PERIOD: Duration = Duration::from_millis(40);
/// The setpoint is at most this much motion ahead of the arm, and [`SLACK`]: an arm that cannot follow is not chased.
const LEAD: Duration = Duration::from_millis(250);
/// In ticks, or in thousandths of the gripper's stroke.
const SLACK: f32 = 20.0;
/// The gripper's speed, in thousandths of its stroke per second, and for the arm in ticks per second.
const GRIPPER_SPEED: u16 = 500;
/// The speed of the joints at first: 20°/s.
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
    /// Holds an axis, 0 to 5 for the joints and 6 for the gripper, or lets it rest. Returns whether that changes anything.
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

    /// Lets all axes rest. Returns whether one was held.
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

    /// The speed of the joints from now on.
    pub fn set_speed(&mut self, speed: Speed) {
        self.speed = speed;
    }

    /// True if there was a target since the arm was last at rest.
    pub fn is_under_way(&self) -> bool {
        self.setpoint.is_some()
    }

    /// The target at `now` of an arm whose last reading is this. The first target starts from there.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] when a position in the reading is none that can be a target.
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

    /// The target that stops the arm: the setpoint at `now`. `None` if there was no target. Motion is over then.
    pub fn stop(&mut self, now: Instant, reading: &JointState) -> Option<Move> {
        self.setpoint?;
        let target = self.target(now, reading).ok();
        self.setpoint = None;
        target
    }

    /// Motion is over, without a last target.
    pub fn forget(&mut self) {
        self.setpoint = None;
    }

    /// Lets the setpoint follow the held directions up to `now`. After a pause of the page it makes one step, no jump.
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

    /// The motion of an axis in this time, with its sign.
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

/// The value in this range that is nearest. `f32::clamp` can panic, and its message formats floats: a fifth of the module.
fn within(value: f32, least: f32, most: f32) -> f32 {
    value.max(least).min(most)
}

/// The most that an axis reaches.
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
    fn a_target_is_one_lookahead_from_the_reading() {
        let target = jog(1, Direction::Down).target(millis(0), &CENTRED).unwrap();
        assert_eq!(ticks(target), [2048, 1948, 2048, 2048, 2048, 2048]);
        assert_eq!(target.gripper.0.per_mille(), 500);
    }

    #[test]
    fn the_setpoint_moves_at_the_speed_of_the_joints() {
        let mut jog = jog(0, Direction::Up);
        let mut reading = CENTRED;
        for step in 0..=10 {
            reading.joints[0] = 2048 + 40 * step;
            let target = jog.target(millis(40 * u64::from(step)), &reading).unwrap();
            assert_eq!(ticks(target)[0], 2048 + 40 * step + 100);
        }
    }

    #[test]
    fn a_released_arm_stops_at_the_setpoint() {
        let mut jog = jog(0, Direction::Up);
        jog.target(millis(0), &CENTRED).unwrap();
        assert!(jog.release(millis(20)));
        let stop = jog.stop(millis(30), &CENTRED).unwrap();
        assert_eq!(ticks(stop), [2068, 2048, 2048, 2048, 2048, 2048]);
        assert_eq!(jog.stop(millis(40), &CENTRED), None);
    }

    #[test]
    fn an_arm_that_does_not_follow_is_not_chased() {
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
    fn a_pause_of_the_page_is_no_jump() {
        let mut jog = jog(0, Direction::Up);
        jog.target(millis(0), &CENTRED).unwrap();
        let target = jog.target(millis(60_000), &CENTRED).unwrap();
        assert_eq!(ticks(target)[0], 2048 + 100 + 100);
    }

    #[test]
    fn a_reading_out_of_range_is_no_start() {
        let mut reading = CENTRED;
        reading.gripper = 2051;
        let error = jog(0, Direction::Up).target(millis(0), &reading).unwrap_err();
        assert_eq!(error.to_string(), "gripper opening is 2051 ‰, must be 0..=1000");
    }

    #[test]
    fn an_axis_that_the_arm_lacks_is_an_error() {
        let error = Jog::default().hold(millis(0), 7, Direction::Up).unwrap_err();
        assert_eq!(error.to_string(), "axis is 7, must be 0..=6");
    }
}
