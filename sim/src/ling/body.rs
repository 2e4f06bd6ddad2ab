//! The mechanics of a Ling arm: axes, servo temperatures, and overheat protection.
//!
//! The document describes the readings, not the arm's behaviour. This model assumes:
//!
//! * A follower has ten servos: two each for joints 1 to 3, one each for joints 4 to 6 (the mapping of the vendor's
//!   software for the older generation), and one for the gripper. A leader has six, one for each joint; its gripper is
//!   a sensor.
//! * At power-on a follower holds, a leader does not. Motion has no status of its own: *locked* means torque on, *idle*
//!   means torque off. The arm never follows a leader, so it is never *syncing*.
//! * The gripper's servo turns one tick for each thousandth of the stroke, for every stroke.
//! * Speed 0 means no motion.
//! * A leader's motors only hold, except those of a force-feedback leader (`leader.rs`).
//! * The plant (`mechanics.rs`) is that of a follower's joints. The gripper, and a leader in a hand, have none. Torque
//!   that is switched on holds the present position.
//! * Each servo is a first-order thermal model with a time constant of [`TIME_CONSTANT`]. Its final temperature is
//!   ambient, plus 10 °C while it holds (35 °C, as in the document's example), plus 16 °C for each 1000 ticks/s.
//! * At the limit the arm reports overheating and continues. At 5 °C above the limit protection starts: the arm stops,
//!   its torque is off, and it neither moves nor holds. Both conditions end 5 °C below the limit; the torque stays off.

use std::array;

use armwire::ling::{JOINTS, Kind, MotionStatus, Move, TemperatureLimit};
use armwire::time::{Duration, Instant};

use super::axis::Axis;
use super::plant::{JointAngle, Plant};

/// Number of axes: the joints, then the gripper.
const AXES: usize = JOINTS + 1;
const GRIPPER: usize = JOINTS;

/// The axis of each servo of a follower, servo 1 first.
const FOLLOWER_SERVOS: [usize; 10] = [0, 0, 1, 1, 2, 2, 3, 4, 5, GRIPPER];
/// The axis of each servo of a leader.
const LEADER_SERVOS: [usize; 6] = [0, 1, 2, 3, 4, 5];

/// Step of the thermal model.
const HEAT_STEP: Duration = Duration::from_millis(100);
/// Time to 63 % of a temperature change.
const TIME_CONSTANT: Duration = Duration::from_millis(120_000);
const HEAT_STEPS: i64 = (TIME_CONSTANT.as_micros() / HEAT_STEP.as_micros()) as i64;

/// Speed of the move of another program, in ticks per second: 88°/s.
const OTHER_SPEED: u16 = 1000;

/// Temperatures are in millionths of a degree.
const DEGREE: i64 = 1_000_000;
const HOLDING: i64 = 10 * DEGREE;
const PER_TICK_PER_SECOND: i64 = 16 * DEGREE / 1000;
/// Distance from the limit at which protection starts, and at which it ends.
const MARGIN: i64 = 5 * DEGREE;

/// Effect of heat on the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Heat {
    Normal,
    Over,
    Protecting,
}

/// What the motors of the joints follow.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Drive {
    /// Nothing: with torque on they hold the pose.
    Nothing,
    /// Moves.
    Position,
    /// Currents: nothing holds a pose.
    Current,
}

#[derive(Clone, Debug, PartialEq, Eq)]
struct Servo {
    axis: usize,
    /// In millionths of °C.
    temperature: i64,
    faulty: bool,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Body {
    kind: Kind,
    now: Instant,
    axes: [Axis; AXES],
    /// Distance of each axis since the last thermal step, in millionths of a tick.
    travelled: [u64; AXES],
    servos: Vec<Servo>,
    /// In millionths of °C.
    ambient: i64,
    limit: TemperatureLimit,
    torque: bool,
    drive: Drive,
    heat: Heat,
    /// Move of another program, `None` after its time.
    other: Option<(JointAngle, Instant)>,
}

impl Body {
    pub(super) fn new(kind: Kind, ambient: u8, plant: &Plant) -> Self {
        let ambient = i64::from(ambient) * DEGREE;
        let axes: &[usize] = match kind {
            Kind::Leader => &LEADER_SERVOS,
            Kind::Follower => &FOLLOWER_SERVOS,
        };
        let servo = |&axis| Servo {
            axis,
            temperature: ambient,
            faulty: false,
        };
        let axis = |axis| match axis {
            GRIPPER => Axis::ideal(0),
            _ if kind == Kind::Leader => Axis::ideal(2048),
            joint => Axis::joint(plant, joint),
        };
        Self {
            kind,
            now: Instant::ZERO,
            axes: array::from_fn(axis),
            travelled: [0; AXES],
            servos: axes.iter().map(servo).collect(),
            ambient,
            limit: TemperatureLimit::FACTORY,
            // The vendor's examples move a follower without switching its torque on.
            torque: kind == Kind::Follower,
            drive: match kind {
                Kind::Leader => Drive::Nothing,
                Kind::Follower => Drive::Position,
            },
            heat: Heat::Normal,
            other: plant.other.map(|(angle, after)| (angle, Instant::ZERO + after)),
        }
    }

    /// Advances time. The result does not depend on the number of steps.
    pub(super) fn advance(&mut self, now: Instant) {
        if let Some((angle, at)) = self.other.take_if(|&mut (_, at)| at <= now) {
            self.advance_axes(at);
            if self.can_move() {
                self.axes[angle.joint].go(angle.ticks(), OTHER_SPEED);
            }
        }
        self.advance_axes(now);
    }

    fn advance_axes(&mut self, now: Instant) {
        loop {
            let step = Instant::from_micros(
                (self.now.as_micros() / HEAT_STEP.as_micros() + 1).saturating_mul(HEAT_STEP.as_micros()),
            );
            if now < step {
                break;
            }
            self.travel(step);
            if self.warm() && !self.is_moving() {
                // The state is final.
                self.now = now.max(self.now);
                return;
            }
        }
        self.travel(now);
    }

    fn travel(&mut self, to: Instant) {
        for (axis, travelled) in self.axes.iter_mut().zip(&mut self.travelled) {
            *travelled += axis.advance(self.now, to, self.torque);
        }
        self.now = to.max(self.now);
    }

    /// Computes one thermal step. Returns true if all temperatures are final.
    fn warm(&mut self) -> bool {
        let mut settled = self.travelled == [0; AXES];
        for servo in &mut self.servos {
            let mean_speed = (self.travelled[servo.axis] / HEAT_STEP.as_micros()) as i64;
            let holding = if self.torque { HOLDING } else { 0 };
            let goal = self.ambient + holding + mean_speed * PER_TICK_PER_SECOND;
            let change = (goal - servo.temperature) / HEAT_STEPS;
            servo.temperature += change;
            settled &= change == 0;
        }
        self.travelled = [0; AXES];
        let before = self.heat;
        self.protect();
        settled && before == self.heat
    }

    /// Compares the hottest servo with the limit.
    fn protect(&mut self) {
        let limit = i64::from(self.limit.celsius()) * DEGREE;
        let hottest = self.servos.iter().map(|servo| servo.temperature).max().unwrap_or(0);
        if hottest >= limit + MARGIN {
            self.heat = Heat::Protecting;
            self.set_torque(false);
        } else if hottest < limit - MARGIN {
            self.heat = Heat::Normal;
        } else if hottest >= limit && self.heat == Heat::Normal {
            self.heat = Heat::Over;
        }
    }

    /// Returns true if the arm may move by itself now.
    fn can_move(&self) -> bool {
        self.drive == Drive::Position && self.torque
    }

    /// Changes what the motors follow. A motion ends.
    pub(super) fn set_drive(&mut self, drive: Drive) {
        self.axes.iter_mut().for_each(Axis::stop);
        self.drive = drive;
    }

    /// Starts a move. Returns true if it was accepted.
    pub(super) fn go(&mut self, target: &Move) -> bool {
        if !self.can_move() {
            return false;
        }
        let joints = target
            .joints
            .map(|(position, speed)| (position.ticks(), speed.ticks_per_second()));
        let (opening, speed) = target.gripper;
        let targets = joints.into_iter().chain([(opening.per_mille(), speed.0)]);
        for (axis, (ticks, speed)) in self.axes.iter_mut().zip(targets) {
            axis.go(ticks, speed);
        }
        true
    }

    /// Sets the torque. Returns true if it was accepted: the torque stays off during overheat protection.
    pub(super) fn set_torque(&mut self, on: bool) -> bool {
        if on && self.heat == Heat::Protecting {
            return false;
        }
        if on != self.torque {
            self.axes.iter_mut().for_each(Axis::stop);
        }
        self.torque = on;
        true
    }

    pub(super) fn set_zero(&mut self) {
        self.set_torque(false);
        self.axes[..JOINTS].iter_mut().for_each(Axis::set_zero);
    }

    pub(super) fn set_limit(&mut self, limit: TemperatureLimit) {
        self.limit = limit;
        self.protect();
    }

    /// Moves an axis by hand. Returns true if it moved.
    pub(super) fn push(&mut self, axis: usize, ticks: u16) -> bool {
        if self.torque && self.drive != Drive::Current {
            return false;
        }
        self.axes[axis].push(ticks);
        true
    }

    pub(super) fn push_gripper(&mut self, per_mille: u16) -> bool {
        // A leader's gripper has no motor, so the torque does not hold it.
        let torque = self.torque && self.kind == Kind::Follower;
        if !torque {
            self.axes[GRIPPER].push(per_mille);
        }
        !torque
    }

    pub(super) fn remove_obstacle(&mut self) {
        self.axes.iter_mut().for_each(Axis::remove_obstacle);
    }

    /// Sets or clears a servo's fault, by its id from 1. An unknown id is ignored.
    pub(super) fn set_faulty(&mut self, id: u8, faulty: bool) {
        if let Some(servo) = usize::from(id).checked_sub(1).and_then(|i| self.servos.get_mut(i)) {
            servo.faulty = faulty;
        }
    }

    #[cfg(test)]
    pub(super) fn now(&self) -> Instant {
        self.now
    }

    pub(super) fn joints(&self) -> [u16; JOINTS] {
        std::array::from_fn(|joint| self.axes[joint].ticks())
    }

    pub(super) fn gripper(&self) -> u16 {
        self.axes[GRIPPER].ticks()
    }

    pub(super) fn is_holding(&self) -> bool {
        self.torque
    }

    pub(super) fn is_moving(&self) -> bool {
        self.axes.iter().any(Axis::is_moving)
    }

    pub(super) fn status(&self) -> MotionStatus {
        match self.heat {
            Heat::Over => MotionStatus::Overheating,
            Heat::Protecting => MotionStatus::OverheatProtection,
            Heat::Normal if self.torque => MotionStatus::Locked,
            Heat::Normal => MotionStatus::Idle,
        }
    }

    /// Returns the temperature of each servo in whole °C.
    pub(super) fn temperatures(&self) -> impl Iterator<Item = u8> {
        let celsius = |servo: &Servo| (servo.temperature / DEGREE).clamp(0, 255) as u8;
        self.servos.iter().map(celsius)
    }

    /// Returns the velocity of each servo in ticks per second.
    pub(super) fn velocities(&self) -> impl Iterator<Item = u16> {
        self.servos.iter().map(|servo| self.axes[servo.axis].velocity())
    }

    /// Returns one bit per servo, servo 1 lowest, 1 = normal.
    pub(super) fn normal(&self) -> u16 {
        let bit = |(i, servo): (usize, &Servo)| u16::from(!servo.faulty) << i;
        self.servos.iter().enumerate().map(bit).sum()
    }
}
