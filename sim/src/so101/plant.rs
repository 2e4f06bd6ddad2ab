//! The motion of one servo, and the weight that it carries.
//!
//! The ideas are those of the Ling arm's mechanics: a servo is a proportional controller, which rests where its error
//! balances its load, and a joint without torque sinks. A motion is a trapezoid of speed and acceleration. No number was
//! measured: docs/so101.md lists the guesses.

use armwire::time::Duration;

use crate::angle::cosine;

/// Steps of the encoder in a turn.
pub(super) const TURN: f64 = 4096.0;
/// Step of the model.
pub(super) const STEP: Duration = Duration::from_millis(1);
const DT: f64 = STEP.as_micros() as f64 / 1e6;
/// Maximum speed, in steps per second: 50 revolutions per minute at 7.4 V.
pub(super) const FASTEST: f64 = 3_400.0;
/// Acceleration of a servo whose register says 0, in steps per second²: that of the register's maximum.
const HARDEST: f64 = 25_400.0;
/// Speed without torque, in steps per second.
const SINKING: f64 = 400.0;
/// The position in which a joint is horizontal, and that in which it hangs.
const HORIZONTAL: f64 = TURN / 2.0;
const HANGING: f64 = HORIZONTAL - TURN / 4.0;
/// Reported load per step of sag, and per step per second, in thousandths.
const LOAD_OF_SAG: f64 = 8.0;
const LOAD_OF_SPEED: f64 = 0.1;

/// What a servo wants its motor to do.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Drive {
    /// Nothing: its torque is off.
    Off,
    /// Move to a position of the encoder, at up to this speed, and rest within the dead zone around it.
    Goal {
        goal: f64,
        speed: f64,
        dead_zone: f64,
        /// The proportional factor, as a part of the one at the factory.
        stiffness: f64,
    },
    /// Turn at this speed.
    Speed(f64),
}

/// The mechanics of a joint. Positions are steps of the encoder, over several turns.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plant {
    /// The distance at which it rests below its goal when horizontal. A negative one is above.
    pub(super) sag: f64,
    position: f64,
    speed: f64,
}

impl Plant {
    /// A joint at rest in the middle.
    pub(super) fn new(sag: f64) -> Self {
        Self {
            sag,
            position: HORIZONTAL,
            speed: 0.0,
        }
    }

    pub(super) fn position(&self) -> f64 {
        self.position
    }

    pub(super) fn speed(&self) -> f64 {
        self.speed
    }

    pub(super) fn is_moving(&self) -> bool {
        self.speed != 0.0
    }

    /// The load of a servo with torque, in thousandths of its maximum.
    pub(super) fn load(&self) -> f64 {
        let load = self.weight() * LOAD_OF_SAG + self.speed * LOAD_OF_SPEED;
        load.clamp(-1000.0, 1000.0)
    }

    /// Moves the joint by hand.
    pub(super) fn push(&mut self, to: f64) {
        (self.position, self.speed) = (to, 0.0);
    }

    /// Forgets whole turns, as an encoder of one turn does.
    pub(super) fn forget_turns(&mut self) {
        self.position = self.position.rem_euclid(TURN);
    }

    /// Advances one step. `acceleration` is the register's count; 0 is the maximum.
    pub(super) fn advance(&mut self, drive: Drive, acceleration: u8) {
        let most = DT
            * if acceleration == 0 {
                HARDEST
            } else {
                f64::from(acceleration) * 100.0
            };
        let wanted = match drive {
            Drive::Off => return self.sink(),
            Drive::Speed(speed) => speed,
            Drive::Goal {
                goal,
                speed,
                dead_zone,
                stiffness,
            } => {
                let left = goal - self.weight() / stiffness - self.position;
                if left.abs() <= dead_zone && self.speed.abs() <= most {
                    0.0
                } else {
                    // The speed from which it can still stop at the goal, in whole steps of the model.
                    let braking = (most * most / 4.0 + 2.0 * most / DT * left.abs()).sqrt() - most / 2.0;
                    braking.min(speed).min(left.abs() / DT).copysign(left)
                }
            }
        };
        self.speed += (wanted - self.speed).clamp(-most, most);
        self.position += self.speed * DT;
    }

    /// Advances one step without torque: a loaded joint sinks until it hangs.
    fn sink(&mut self) {
        let below = self.position - HANGING;
        let (towards, is_loaded) = (-self.sag.signum(), self.weight().abs() >= 1.0);
        self.speed = match is_loaded && below.abs() >= SINKING * DT {
            true => SINKING * towards,
            false => 0.0,
        };
        self.position += self.speed * DT;
    }

    /// The distance between goal and rest at the factory's stiffness.
    fn weight(&self) -> f64 {
        self.sag * cosine((self.position - HORIZONTAL) / TURN)
    }
}
