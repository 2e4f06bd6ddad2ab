//! The mechanics of a joint: a servo that follows its setpoint late and carries a weight by its error.
//!
//! The document describes none of it. This model assumes:
//!
//! * The servo is a proportional controller: the joint rests where its error balances its load, below its setpoint.
//!   *Below* is towards lower ticks between −90° and 90°.
//! * The load of joints 2, 3 and 5 is proportional to the cosine of their own angle; the other joints have none. Their
//!   shares are in [`SHARES`]. An angle of 0° is horizontal, wherever the zero position is set later.
//! * Friction is Coulomb friction: it carries a part of the load at rest, so the rest depends on the direction.
//! * Backlash lies between the motor and the joint. A load larger than the friction takes it up.
//! * Without torque a joint sinks at [`SINKING`] until it hangs at −90° or its friction carries it.

use std::f64::consts::PI;

use armwire::ling::{JOINTS, TICKS_PER_TURN};
use armwire::time::Duration;

use super::plant::Plant;
use crate::angle::cosine;

/// Step of the model.
pub(super) const STEP: Duration = Duration::from_millis(1);
const DT: f64 = STEP.as_micros() as f64 / 1e6;
/// Steps of the second-order model in one step.
const SUBSTEPS: u8 = 4;

/// Share of the sag by joint.
const SHARES: [f64; JOINTS] = [0.0, 1.0, 0.8, 0.0, 0.4, 0.0];
/// Ticks in 90°.
const QUARTER: f64 = TICKS_PER_TURN as f64 / 4.0;
/// Maximum speed of a servo, in ticks per second.
const FASTEST: f64 = 6000.0;
/// Speed without torque, in ticks per second: 26°/s.
const SINKING: f64 = 300.0;
/// Error within which a servo rests without friction, in ticks.
const RESTING: f64 = 0.01;

/// A joint with mechanics. Positions are in ticks, speeds in ticks per second.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Mechanics {
    /// Sag in the horizontal.
    sag: f64,
    friction: f64,
    /// Half the backlash.
    play: f64,
    /// In seconds.
    lag: f64,
    /// Damping ratio of the second-order model, `None` for the first-order model.
    damping: Option<f64>,
    restarts: bool,

    /// Position in which the joint is horizontal.
    horizontal: f64,
    /// Positions that the joint can reach.
    lowest: f64,
    highest: f64,

    motor: f64,
    motor_speed: f64,
    position: f64,
    speed: f64,
}

impl Mechanics {
    /// Creates the mechanics of joint 0 to 5 in its zero position. `None` if the joint is ideal.
    pub(super) fn new(plant: &Plant, joint: usize) -> Option<Self> {
        let zero = 2048.0;
        let obstacle = plant.obstacle.filter(|obstacle| obstacle.joint == joint);
        let obstacle = obstacle.map(|obstacle| f64::from(obstacle.ticks()));
        let is_ideal = [plant.sag, plant.friction, plant.backlash] == [0; 3] && plant.lag == Duration::ZERO;
        if is_ideal && obstacle.is_none() {
            return None;
        }
        Some(Self {
            sag: f64::from(plant.sag) * SHARES[joint],
            friction: plant.friction.into(),
            play: f64::from(plant.backlash) / 2.0,
            lag: plant.lag.as_micros() as f64 / 1e6,
            damping: (plant.overshoot > 0).then(|| damping(plant.overshoot)),
            restarts: plant.restart,
            horizontal: zero,
            lowest: obstacle.filter(|&at| at < zero).unwrap_or(f64::NEG_INFINITY),
            highest: obstacle.filter(|&at| at >= zero).unwrap_or(f64::INFINITY),
            motor: zero,
            motor_speed: 0.0,
            position: zero,
            speed: 0.0,
        })
    }

    pub(super) fn position(&self) -> f64 {
        self.position
    }

    /// Returns the speed, without direction.
    pub(super) fn speed(&self) -> f64 {
        self.speed
    }

    pub(super) fn is_moving(&self) -> bool {
        self.speed != 0.0 || self.motor_speed != 0.0
    }

    /// Returns the start of a new trajectory, if it is the position and not the setpoint.
    pub(super) fn restart(&self) -> Option<f64> {
        self.restarts.then_some(self.position)
    }

    /// Advances one step with torque. Returns the distance travelled, in millionths of a tick.
    pub(super) fn follow(&mut self, setpoint: f64) -> u64 {
        let load = self.load();
        match self.damping {
            None => self.approach(setpoint - load),
            Some(damping) => self.swing(setpoint - load, damping),
        }
        let is_loaded = load.abs() > self.friction;
        let lean = if is_loaded {
            self.play.copysign(load)
        } else {
            within(self.motor - self.position, self.play)
        };
        let wanted = self.motor - lean;
        let reached = self.reachable(wanted);
        if reached != wanted {
            self.motor_speed = 0.0;
            self.motor = reached
                + if is_loaded {
                    lean
                } else {
                    self.play.copysign(wanted - reached)
                };
        }
        self.place(reached)
    }

    /// Moves the motor of a first-order servo towards its rest.
    fn approach(&mut self, rest: f64) {
        let error = rest - self.motor;
        let drive = if error.abs() > self.friction + RESTING {
            error - self.friction.copysign(error)
        } else {
            0.0
        };
        // The implicit Euler method: stable for any lag, and 0 is no special case.
        self.motor_speed = within(drive / (self.lag + DT), FASTEST);
        self.motor += self.motor_speed * DT;
    }

    /// Moves the motor of a second-order servo towards its rest.
    fn swing(&mut self, rest: f64, damping: f64) {
        let step = DT / f64::from(SUBSTEPS);
        // The lag behind a ramp is 2 × damping ratio ÷ natural frequency.
        let frequency = 2.0 * damping / self.lag;
        for _ in 0..SUBSTEPS {
            let (error, speed) = (rest - self.motor, self.motor_speed);
            let direction = if speed == 0.0 { error } else { speed };
            let drive = error - self.friction.copysign(direction);
            let next = speed + (frequency * frequency * drive - 2.0 * damping * frequency * speed) * step;
            let has_turned = speed * next <= 0.0;
            let sticks = error.abs() <= self.friction + RESTING && (has_turned || next.abs() * self.lag < RESTING);
            self.motor_speed = if sticks { 0.0 } else { within(next, FASTEST) };
            self.motor += self.motor_speed * step;
        }
    }

    /// Advances one step without torque. Returns the distance travelled, in millionths of a tick.
    pub(super) fn fall(&mut self) -> u64 {
        let load = self.load();
        let step = if load.abs() > self.friction + RESTING {
            -(SINKING * DT).copysign(load)
        } else {
            0.0
        };
        let hanging = self.horizontal - QUARTER;
        let to = if (hanging - self.position).abs() <= step.abs() {
            hanging
        } else {
            self.position + step
        };
        let travelled = self.place(self.reachable(to));
        self.motor = self.position;
        travelled
    }

    /// Ends the motion of the motor at the joint's position.
    pub(super) fn halt(&mut self) {
        self.motor = self.position;
        self.motor_speed = 0.0;
    }

    /// Moves the joint by hand.
    pub(super) fn push(&mut self, to: f64) {
        self.place(self.reachable(to));
        self.halt();
        self.speed = 0.0;
    }

    /// Gives the present position another number.
    pub(super) fn renumber(&mut self, position: f64) {
        let shift = position - self.position;
        for place in [&mut self.horizontal, &mut self.lowest, &mut self.highest] {
            *place += shift;
        }
        self.position = position;
        self.halt();
        self.speed = 0.0;
    }

    pub(super) fn remove_obstacle(&mut self) {
        (self.lowest, self.highest) = (f64::NEG_INFINITY, f64::INFINITY);
    }

    /// Returns the distance at which the joint rests below its setpoint, without friction.
    fn load(&self) -> f64 {
        self.sag * cosine((self.position - self.horizontal) / f64::from(TICKS_PER_TURN))
    }

    /// Returns the position nearest to `to` that the joint can reach and report.
    fn reachable(&self, to: f64) -> f64 {
        to.min(self.highest)
            .max(self.lowest)
            .clamp(0.0, f64::from(TICKS_PER_TURN - 1))
    }

    fn place(&mut self, to: f64) -> u64 {
        let distance = (to - self.position).abs();
        self.position = to;
        self.speed = distance / DT;
        (distance * 1e6).round() as u64
    }
}

/// Returns the damping ratio at which a step overshoots by this many percent.
fn damping(overshoot: u8) -> f64 {
    let log = (f64::from(overshoot) / 100.0).ln();
    -log / (PI * PI + log * log).sqrt()
}

/// Limits a value to `-limit..=limit`. `f64::clamp` may panic with its numbers as text, which is much code in the page.
fn within(value: f64, limit: f64) -> f64 {
    value.min(limit).max(-limit)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn damping_gives_the_overshoot_back() {
        for overshoot in 1..=50 {
            let ratio = damping(overshoot);
            let peak = (-PI * ratio / (1.0 - ratio * ratio).sqrt()).exp();
            assert!((peak * 100.0 - f64::from(overshoot)).abs() < 1e-9, "{overshoot}");
        }
    }
}
