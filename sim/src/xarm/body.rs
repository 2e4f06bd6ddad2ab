//! The mechanics of an xArm and what its controller lets them do.
//!
//! The document has no motion in it; registers and codes are those that the vendor's Python SDK names. What is chosen
//! here:
//!
//! * Switched on, it stands with its motors off and its brakes on, in state 4.
//! * It can move when all its motors are on, no error stands, its mode is 0 and its state is below 4.
//! * Moves are queued. Each goes from rest to rest, straight in joint space: the joint with the longest way keeps to
//!   speed and acceleration, and the others arrive with it.
//! * Pausing and stopping take no time. A pause keeps the moves, a stop drops them; so do a change of mode, after which
//!   the state is 5, an error, and a motor switched off, after which it is 4.
//! * A move beyond a joint's limits is error 23. An error keeps the arm stopped until it is cleared; whatever was asked
//!   of it in the meantime must be asked again.
//! * Links have no mass, so torques and currents are zero.

use std::array;
use std::collections::VecDeque;

use armwire::time::Instant;

use super::geometry::{MAX_JOINTS, Model, Placed};
use super::profile::Profile;

/// Moves that wait or are under way, at most.
pub(super) const MAX_MOVES: usize = 512;
/// The fastest that a joint may be told to move, in radians per second.
pub(super) const MAX_SPEED: f32 = std::f32::consts::PI;
/// The quickest that a joint may be told to gain speed, in radians per second squared.
pub(super) const MAX_ACCELERATION: f32 = 20.0;

/// "Joint angle exceeds limit", as the vendor's SDK has it.
const JOINT_LIMIT: u8 = 23;

/// The only mode in which the arm moves by itself: to a joint position.
const POSITION_MODE: u8 = 0;
/// The modes that the vendor's SDK knows.
const MODES: u8 = 7;

/// What the controller is about.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Phase {
    Ready,
    Paused,
    Stopped,
    /// A setting was changed, which stopped it.
    Reset,
}

/// Where to, and how.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Target {
    /// In radians.
    pub(super) joints: [f32; MAX_JOINTS],
    /// Of the joint with the longest way, in radians per second, up to [`MAX_SPEED`].
    pub(super) speed: f32,
    /// Of the same, in radians per second squared, up to [`MAX_ACCELERATION`].
    pub(super) acceleration: f32,
}

/// A move under way.
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

/// A value is out of range, or there is no room for another move. Nothing was done.
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

    /// As after power was off and on again, except that the brakes held it where it is.
    pub(super) fn restart(&mut self) {
        *self = Self {
            now: self.now,
            joints: self.joints,
            ..Self::new(self.model)
        };
    }

    /// Lets time pass. The outcome is the same in however many steps it passes.
    pub(super) fn advance(&mut self, now: Instant) {
        self.now = self.now.max(now);
        while let Some(motion) = &self.motion {
            let elapsed = self.now.since(motion.start);
            let (gone, rate) = motion.profile.at(elapsed);
            for (i, (joint, velocity)) in self.joints.iter_mut().zip(&mut self.velocities).enumerate() {
                let way = f64::from(motion.to.joints[i]) - motion.from[i];
                *joint = motion.from[i] + way * gone;
                *velocity = way * rate;
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

    /// Queues a move. While it cannot move it does nothing, now or later.
    pub(super) fn go(&mut self, target: Target) -> Result<(), Refused> {
        let in_range = |value: f32, max: f32| value > 0.0 && value <= max;
        let makes_sense = in_range(target.speed, MAX_SPEED)
            && in_range(target.acceleration, MAX_ACCELERATION)
            && target.joints.iter().all(|angle| angle.is_finite());
        if !makes_sense {
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
        if self.moves() == MAX_MOVES {
            return Err(Refused);
        }
        // Joints that it does not have stay at zero.
        let joints = array::from_fn(|i| if i < self.model.joints() { target.joints[i] } else { 0.0 });
        self.waiting.push_back(Target { joints, ..target });
        if self.motion.is_none() && self.phase == Phase::Ready {
            self.start_next(self.now);
        }
        Ok(())
    }

    /// Stops where it is and forgets what it was to do.
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

    /// The states that can be set: 0 ready, 3 paused, 4 stopped.
    pub(super) fn set_state(&mut self, state: u8) -> Result<(), Refused> {
        match state {
            // An error keeps it stopped.
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

    pub(super) fn set_mode(&mut self, mode: u8) -> Result<(), Refused> {
        if mode > MODES {
            return Err(Refused);
        }
        self.mode = mode;
        self.stop(if self.error == 0 { Phase::Reset } else { Phase::Stopped });
        Ok(())
    }

    /// Switches the motor of a joint, from 1, or all (8) on or off.
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

    /// An error stops the arm; 0 is none.
    pub(super) fn set_error(&mut self, code: u8) {
        self.error = code;
        if code != 0 {
            self.stop(Phase::Stopped);
        }
    }

    /// A warning stops nothing; 0 is none.
    pub(super) fn set_warning(&mut self, code: u8) {
        self.warning = code;
    }

    fn all_motors(&self) -> u8 {
        (1 << self.model.joints()) - 1
    }

    pub(super) fn can_move(&self) -> bool {
        self.motors == self.all_motors()
            && self.error == 0
            && self.mode == POSITION_MODE
            && matches!(self.phase, Phase::Ready | Phase::Paused)
    }

    /// 1 in motion, 2 at rest, 3 paused, 4 stopped, 5 stopped by a setting.
    pub(super) fn state(&self) -> u8 {
        match self.phase {
            Phase::Ready if self.motion.is_some() => 1,
            Phase::Ready => 2,
            Phase::Paused => 3,
            Phase::Stopped => 4,
            Phase::Reset => 5,
        }
    }

    /// How many moves wait or are under way.
    pub(super) fn moves(&self) -> usize {
        self.waiting.len() + usize::from(self.motion.is_some())
    }

    /// In radians.
    pub(super) fn joints(&self) -> &[f64; MAX_JOINTS] {
        &self.joints
    }

    /// In radians per second.
    pub(super) fn velocities(&self) -> &[f64; MAX_JOINTS] {
        &self.velocities
    }

    pub(super) fn placed(&self) -> Placed {
        self.model.place(&self.joints)
    }

    /// One bit each, joint 1 lowest. A motor that is on has its brake off.
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
