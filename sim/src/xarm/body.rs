//! The mechanics of an xArm, and the controller's rules of motion.
//!
//! The document does not describe motion. Registers and codes are those of the vendor's Python SDK. This model assumes:
//!
//! * At power-on the arm is in state 4, with its motors off and its brakes on.
//! * Motion requires all motors on, no error and a state below 4. There are two modes, and a move of the other one is
//!   refused: 0, in which moves are queued, and 1, in which a target replaces the one before it.
//! * Moves are queued. Each starts and ends at rest and is linear in joint space: the joint with the longest distance
//!   follows speed and acceleration, and the others arrive with it. A blended move does not blend: it rests at its
//!   target, too.
//! * In mode 1 the joint with the longest distance has the maximum speed at once, without acceleration.
//! * Pausing and stopping are instantaneous. A pause keeps the moves. A stop drops them, and so does an error, a change
//!   of mode (state 5 follows) and a motor switched off (state 4 follows).
//! * A move beyond a joint's limits is error 23. An error stops the arm until it is cleared. Requests during an error
//!   are not repeated afterwards.
//! * Links have no mass, so torques and currents are zero.

use std::array;
use std::collections::VecDeque;

use armwire::time::Instant;

use super::geometry::{MAX_JOINTS, Model, Placed};
use super::profile::Profile;

/// Maximum number of moves, queued or in progress.
pub(super) const MAX_MOVES: usize = 512;
/// Maximum joint speed of a move, in radians per second.
pub(super) const MAX_SPEED: f32 = std::f32::consts::PI;
/// Maximum joint acceleration of a move, in radians per second squared.
pub(super) const MAX_ACCELERATION: f32 = 20.0;

/// "Joint angle exceeds limit", in the words of the vendor's SDK.
const JOINT_LIMIT: u8 = 23;

/// The mode of queued moves.
const POSITION_MODE: u8 = 0;
/// The mode of targets that replace each other.
const SERVO_MODE: u8 = 1;

/// State of the controller.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Ready,
    Paused,
    Stopped,
    /// Stopped by a change of settings.
    Reset,
}

/// Target of a move, with its limits.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Target {
    /// In radians.
    pub(super) joints: [f32; MAX_JOINTS],
    /// Speed of the joint with the longest distance, in radians per second, up to [`MAX_SPEED`].
    pub(super) speed: f32,
    /// Acceleration of the same joint, in radians per second squared, up to [`MAX_ACCELERATION`], or infinite.
    pub(super) acceleration: f32,
}

/// A move in progress.
#[derive(Clone, Debug)]
struct Motion {
    start: Instant,
    from: [f64; MAX_JOINTS],
    to: Target,
    profile: Profile,
}

impl Motion {
    fn new(start: Instant, from: [f64; MAX_JOINTS], to: Target) -> Self {
        let ways = from
            .iter()
            .zip(to.joints)
            .map(|(from, to)| (f64::from(to) - from).abs());
        let longest = ways.fold(0.0, f64::max);
        Self {
            start,
            from,
            to,
            profile: Profile::new(longest, to.speed.into(), to.acceleration.into()),
        }
    }
}

/// A value is out of range, the mode is another one, or the queue is full. The request had no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Refused;

#[derive(Clone, Debug)]
pub(super) struct Body {
    model: Model,
    now: Instant,
    /// In radians.
    joints: [f64; MAX_JOINTS],
    /// In radians per second.
    velocities: [f64; MAX_JOINTS],
    motion: Option<Motion>,
    waiting: VecDeque<Target>,
    /// Motors that are on, one bit each, joint 1 lowest.
    motors: u8,
    phase: Phase,
    mode: u8,
    error: u8,
    warning: u8,
}

impl Body {
    pub(super) fn new(model: Model) -> Self {
        Self {
            model,
            now: Instant::ZERO,
            joints: [0.0; MAX_JOINTS],
            velocities: [0.0; MAX_JOINTS],
            motion: None,
            waiting: VecDeque::new(),
            motors: 0,
            phase: Phase::Stopped,
            mode: POSITION_MODE,
            error: 0,
            warning: 0,
        }
    }

    /// Restores the power-on state at the current joint position.
    pub(super) fn restart(&mut self) {
        *self = Self {
            now: self.now,
            joints: self.joints,
            ..Self::new(self.model)
        };
    }

    /// Advances time. The result does not depend on the number of steps.
    pub(super) fn advance(&mut self, now: Instant) {
        self.now = self.now.max(now);
        while let Some(motion) = &self.motion {
            let elapsed = self.now.since(motion.start);
            let (gone, rate) = motion.profile.at(elapsed);
            for (i, (joint, velocity)) in self.joints.iter_mut().zip(&mut self.velocities).enumerate() {
                let distance = f64::from(motion.to.joints[i]) - motion.from[i];
                *joint = motion.from[i] + distance * gone;
                *velocity = distance * rate;
            }
            let duration = motion.profile.duration();
            if elapsed < duration {
                return;
            }
            self.joints = motion.to.joints.map(f64::from);
            self.start_next(motion.start + duration);
        }
    }

    fn start_next(&mut self, start: Instant) {
        let next = self.waiting.pop_front();
        self.motion = next.map(|to| Motion::new(start, self.joints, to));
    }

    /// Queues a move. A move while the arm cannot move is dropped.
    pub(super) fn go(&mut self, target: Target) -> Result<(), Refused> {
        let in_range = |value: f32, max: f32| value > 0.0 && value <= max;
        if !in_range(target.speed, MAX_SPEED) || !in_range(target.acceleration, MAX_ACCELERATION) {
            return Err(Refused);
        }
        self.enqueue(POSITION_MODE, target)
    }

    /// Replaces the target in servo mode. A target while the arm cannot move is dropped.
    pub(super) fn follow(&mut self, joints: [f32; MAX_JOINTS]) -> Result<(), Refused> {
        let target = Target {
            joints,
            speed: MAX_SPEED,
            acceleration: f32::INFINITY,
        };
        self.enqueue(SERVO_MODE, target)
    }

    /// Takes a move of this mode, to begin after those that it does not replace.
    fn enqueue(&mut self, mode: u8, target: Target) -> Result<(), Refused> {
        if self.mode != mode || !target.joints.iter().all(|angle| angle.is_finite()) {
            return Err(Refused);
        }
        if !self.can_move() {
            return Ok(());
        }
        let mut limits = self.model.limits().iter().zip(target.joints);
        if limits.any(|(&(min, max), angle)| !(min..=max).contains(&angle)) {
            self.set_error(JOINT_LIMIT);
            return Ok(());
        }
        if mode == SERVO_MODE {
            self.motion = None;
            self.waiting.clear();
        }
        if self.moves() == MAX_MOVES {
            return Err(Refused);
        }
        // Joints beyond the model's number stay at zero.
        let joints = array::from_fn(|i| if i < self.model.joints() { target.joints[i] } else { 0.0 });
        self.waiting.push_back(Target { joints, ..target });
        if self.motion.is_none() && self.phase == Phase::Ready {
            self.start_next(self.now);
        }
        Ok(())
    }

    /// Stops at the current position and drops all moves.
    fn stop(&mut self, phase: Phase) {
        self.motion = None;
        self.waiting.clear();
        self.velocities = [0.0; MAX_JOINTS];
        self.phase = phase;
    }

    fn pause(&mut self) {
        if let Some(motion) = self.motion.take() {
            self.waiting.push_front(motion.to);
        }
        self.velocities = [0.0; MAX_JOINTS];
        self.phase = Phase::Paused;
    }

    /// Sets the state: 0 ready, 3 paused, 4 stopped.
    pub(super) fn set_state(&mut self, state: u8) -> Result<(), Refused> {
        match state {
            // An error keeps the arm stopped.
            0 | 3 if self.error != 0 => {}
            0 => {
                self.phase = Phase::Ready;
                if self.motion.is_none() {
                    self.start_next(self.now);
                }
            }
            3 => self.pause(),
            4 => self.stop(Phase::Stopped),
            _ => return Err(Refused),
        }
        Ok(())
    }

    /// Sets the mode. Modes that this model cannot run are refused.
    pub(super) fn set_mode(&mut self, mode: u8) -> Result<(), Refused> {
        if !matches!(mode, POSITION_MODE | SERVO_MODE) {
            return Err(Refused);
        }
        self.mode = mode;
        self.stop(if self.error == 0 { Phase::Reset } else { Phase::Stopped });
        Ok(())
    }

    /// Switches the motor of a joint, from 1, or all motors (8) on or off.
    pub(super) fn set_motor(&mut self, joint: u8, on: bool) -> Result<(), Refused> {
        let all = self.all_motors();
        let chosen = match joint {
            8 => all,
            1..=7 => 1 << (joint - 1),
            _ => 0,
        };
        if chosen & all == 0 {
            return Err(Refused);
        }
        if !on {
            self.motors &= !chosen;
            self.stop(Phase::Stopped);
        } else if self.error == 0 {
            self.motors |= chosen;
        }
        Ok(())
    }

    /// Sets the error, which stops the arm; 0 clears it.
    pub(super) fn set_error(&mut self, code: u8) {
        self.error = code;
        if code != 0 {
            self.stop(Phase::Stopped);
        }
    }

    /// Sets the warning, which stops nothing; 0 clears it.
    pub(super) fn set_warning(&mut self, code: u8) {
        self.warning = code;
    }

    fn all_motors(&self) -> u8 {
        (1 << self.model.joints()) - 1
    }

    pub(super) fn can_move(&self) -> bool {
        self.motors == self.all_motors() && self.error == 0 && matches!(self.phase, Phase::Ready | Phase::Paused)
    }

    /// Returns 1 in motion, 2 at rest, 3 paused, 4 stopped, 5 stopped by a setting.
    pub(super) fn state(&self) -> u8 {
        match self.phase {
            Phase::Ready if self.motion.is_some() => 1,
            Phase::Ready => 2,
            Phase::Paused => 3,
            Phase::Stopped => 4,
            Phase::Reset => 5,
        }
    }

    /// Returns the number of moves, queued or in progress.
    pub(super) fn moves(&self) -> usize {
        self.waiting.len() + usize::from(self.motion.is_some())
    }

    /// Returns the joint angles, in radians.
    pub(super) fn joints(&self) -> &[f64; MAX_JOINTS] {
        &self.joints
    }

    /// Returns the joint velocities, in radians per second.
    pub(super) fn velocities(&self) -> &[f64; MAX_JOINTS] {
        &self.velocities
    }

    pub(super) fn placed(&self) -> Placed {
        self.model.place(&self.joints)
    }

    /// Returns one bit per motor that is on, joint 1 lowest. Its brake is off.
    pub(super) fn motors(&self) -> u8 {
        self.motors
    }

    pub(super) fn mode(&self) -> u8 {
        self.mode
    }

    pub(super) fn error(&self) -> u8 {
        self.error
    }

    pub(super) fn warning(&self) -> u8 {
        self.warning
    }
}
