//! A virtual STS3215: its registers, and what a write of them does.

use armwire::OutOfRange;
use armwire::time::{Duration, Instant};
use armwire_feetech::register::{self, Access, REGISTERS, Register};

use super::order::OrderError;
use super::plant::{Drive, FASTEST, Plant, STEP, TURN};

/// Bits of an error byte.
const VOLTAGE: u8 = 1;
const TEMPERATURE: u8 = 4;
/// Bits of the register `phase`.
const SPEED_IN_STEPS: i32 = 4;
const NO_SPEED_IS_FASTEST: i32 = 8;
const COUNTS_TURNS: i32 = 16;
/// The speed unit without [`SPEED_IN_STEPS`], in steps per second.
const COARSE: f64 = 50.0;
/// The value of `torque` that makes the present position the middle.
const MIDDLE_IS_HERE: i32 = 128;

/// A virtual servo.
#[derive(Debug)]
pub struct Servo {
    /// Every address that a request can name. Those without a register can be written, and do nothing.
    bytes: [u8; 256],
    /// What a restart restores.
    saved: [u8; 256],
    stored: Option<(u8, Vec<u8>)>,
    plant: Plant,
    /// The goal, as a position of the encoder.
    goal: f64,
    /// The end of the last step of the model.
    at: Instant,
}

impl Servo {
    pub(super) fn new(id: u8, model: u16, decivolts: u8, sag: f64) -> Self {
        let mut servo = Self {
            bytes: [0; 256],
            saved: [0; 256],
            stored: None,
            plant: Plant::new(sag),
            goal: 0.0,
            at: Instant::ZERO,
        };
        for row in REGISTERS {
            servo.put(*row, row.factory.to_le_bytes());
        }
        servo.put(register::MODEL, model.to_le_bytes());
        servo.put(register::ID, [id, 0]);
        servo.put(register::VOLTAGE, [decivolts, 0]);
        servo.put(register::TEMPERATURE, [31, 0]);
        servo.saved = servo.bytes;
        servo.restart();
        servo
    }

    /// Its id.
    pub fn id(&self) -> u8 {
        self.bytes[usize::from(register::ID.address)]
    }

    /// The value of a register.
    pub fn get(&self, row: Register) -> i32 {
        let at = usize::from(row.address);
        let high = if row.len == 2 { self.bytes[at + 1] } else { 0 };
        row.value([self.bytes[at], high])
    }

    /// True if its torque is on.
    pub fn has_torque(&self) -> bool {
        self.get(register::TORQUE) == 1
    }

    /// The position of its encoder, in steps over several turns, without the offset.
    pub fn encoder(&self) -> f64 {
        self.plant.position()
    }

    pub(super) fn baud(&self) -> u32 {
        register::BAUD_RATES[self.get(register::BAUD_RATE) as usize]
    }

    pub(super) fn return_delay(&self) -> Duration {
        Duration::from_micros(2 * self.get(register::RETURN_DELAY) as u64)
    }

    pub(super) fn acknowledges(&self) -> bool {
        self.get(register::STATUS_LEVEL) == 1
    }

    /// The error byte of its answers.
    pub(super) fn errors(&self) -> u8 {
        let limits = self.get(register::MIN_VOLTAGE)..=self.get(register::MAX_VOLTAGE);
        let voltage = if limits.contains(&self.get(register::VOLTAGE)) {
            0
        } else {
            VOLTAGE
        };
        let is_hot = self.get(register::TEMPERATURE) > self.get(register::MAX_TEMPERATURE);
        voltage | if is_hot { TEMPERATURE } else { 0 }
    }

    pub(super) fn set_sag(&mut self, sag: f64) {
        self.plant.sag = sag;
    }

    /// Moves it by hand, until it reports this position.
    pub(super) fn push(&mut self, to: i16) -> Result<(), OrderError> {
        let id = self.id();
        if self.has_torque() {
            return Err(OrderError::Holds(id));
        }
        // The turn of the reported position, unless the turns are counted.
        let here = (self.plant.position() - self.offset()).round();
        let (turns, min, max) = if self.counts_turns() {
            (0.0, register::POSITION.min, register::POSITION.max)
        } else {
            ((here / TURN).floor() * TURN, 0, TURN as i32 - 1)
        };
        let (what, unit, got) = (register::POSITION.name, register::POSITION.unit, i32::from(to));
        if !(min..=max).contains(&got) {
            let error = OutOfRange::new(what, unit, got, min, max);
            return Err(OrderError::Position { id, error });
        }
        self.plant.push(f64::from(to) + turns + self.offset());
        self.show();
        Ok(())
    }

    /// Moves until `now`.
    pub(super) fn advance(&mut self, now: Instant) {
        let acceleration = self.get(register::ACCELERATION) as u8;
        while self.at + STEP <= now {
            let before = (self.plant, self.goal);
            self.plant.advance(self.drive(), acceleration);
            self.at += STEP;
            // At rest until something changes.
            if before == (self.plant, self.goal) {
                let steps = now.since(self.at).as_micros() / STEP.as_micros();
                self.at += Duration::from_micros(steps * STEP.as_micros());
            }
        }
        self.show();
    }

    fn drive(&self) -> Drive {
        let speed = f64::from(self.get(register::GOAL_SPEED)) * self.speed_unit();
        let is_fastest = speed == 0.0 && self.get(register::PHASE) & NO_SPEED_IS_FASTEST != 0;
        let dead_zone = self.get(register::DEAD_ZONE_CW).max(self.get(register::DEAD_ZONE_CCW));
        match self.get(register::MODE) {
            _ if !self.has_torque() => Drive::Off,
            1 => Drive::Speed(speed.clamp(-FASTEST, FASTEST)),
            2 => Drive::Speed(f64::from(self.get(register::GOAL_TIME)) / 1000.0 * FASTEST),
            _ => Drive::Goal {
                goal: self.goal,
                speed: if is_fastest { FASTEST } else { speed.abs().min(FASTEST) },
                dead_zone: dead_zone.into(),
                stiffness: f64::from(self.get(register::P).max(1)) / f64::from(register::P.factory),
            },
        }
    }

    fn offset(&self) -> f64 {
        self.get(register::OFFSET).into()
    }

    fn counts_turns(&self) -> bool {
        self.get(register::PHASE) & COUNTS_TURNS != 0
    }

    fn speed_unit(&self) -> f64 {
        match self.get(register::PHASE) & SPEED_IN_STEPS {
            0 => COARSE,
            _ => 1.0,
        }
    }

    /// The position that it reports, in steps.
    pub fn position(&self) -> i32 {
        let position = (self.plant.position() - self.offset()).round();
        let shown = if self.counts_turns() {
            position
        } else {
            position.rem_euclid(TURN)
        };
        shown as i32
    }

    /// Updates the readings.
    fn show(&mut self) {
        let load = if self.has_torque() { self.plant.load() } else { 0.0 };
        let speed = self.plant.speed() / self.speed_unit();
        self.put_value(register::POSITION, self.position());
        self.put_value(register::SPEED, speed.round() as i32);
        self.put_value(register::LOAD, load.round() as i32);
        self.put_value(register::CURRENT, (load / 2.0).round() as i32);
        self.put_value(register::STORED, self.stored.is_some().into());
        self.put_value(register::STATUS, self.errors().into());
        self.put_value(register::MOVING, self.plant.is_moving().into());
    }

    fn put(&mut self, row: Register, bytes: [u8; 2]) {
        for (at, byte) in (usize::from(row.address)..).zip(bytes).take(row.len.into()) {
            self.bytes[at] = byte;
        }
    }

    /// Sets a register to the nearest value that it can have.
    fn put_value(&mut self, row: Register, value: i32) {
        if let Ok(bytes) = row.bytes(value.clamp(row.min, row.max)) {
            self.put(row, bytes);
        }
    }

    /// The bytes of a read. Behind the last address they are zero.
    pub(super) fn read(&mut self, now: Instant, address: u8, len: u8) -> Vec<u8> {
        self.advance(now);
        let mut bytes = self.bytes[address.into()..].to_vec();
        bytes.resize(len.into(), 0);
        bytes
    }

    /// Writes registers. One that is read-only, or whose value would be outside its range, keeps its value.
    pub(super) fn write(&mut self, now: Instant, address: u8, data: &[u8]) {
        self.advance(now);
        let had_torque = self.has_torque();
        let before = self.bytes;
        for (at, byte) in (usize::from(address)..self.bytes.len()).zip(data) {
            self.bytes[at] = *byte;
        }
        let end = usize::from(address) + data.len();
        let is_written = |row: Register| {
            let (first, len) = (usize::from(row.address), usize::from(row.len));
            usize::from(address) < first + len && first < end
        };
        for row in REGISTERS {
            let (at, len) = (usize::from(row.address), usize::from(row.len));
            let is_valid = (row.min..=row.max).contains(&self.get(*row));
            if row.access == Access::ReadOnly || !is_valid {
                self.bytes[at..at + len].copy_from_slice(&before[at..at + len]);
            } else if row.access == Access::Eeprom && is_written(*row) && self.get(register::LOCK) == 0 {
                self.saved[at..at + len].copy_from_slice(&self.bytes[at..at + len]);
            }
        }
        if is_written(register::MODE) {
            self.goal = self.plant.position();
        }
        if is_written(register::TORQUE) && self.get(register::TORQUE) == MIDDLE_IS_HERE {
            self.put_value(register::TORQUE, had_torque.into());
            self.make_middle();
        }
        if is_written(register::GOAL_POSITION) {
            self.set_goal(true);
            self.put_value(register::TORQUE, 1);
        } else if self.has_torque() && !had_torque {
            self.set_goal(false);
        }
        self.show();
    }

    /// Takes the goal of the register, which was written now or before.
    fn set_goal(&mut self, is_new: bool) {
        let goal = self.get(register::GOAL_POSITION);
        let (min, max) = (self.get(register::MIN_POSITION), self.get(register::MAX_POSITION));
        let offset = self.offset();
        self.goal = match self.get(register::MODE) {
            3 if is_new => self.plant.position() + f64::from(goal),
            // A step is made once.
            3 => self.plant.position(),
            // No limits: several turns.
            _ if (min, max) == (0, 0) => f64::from(goal) + offset,
            _ => f64::from(goal.clamp(min, max.max(min))) + offset,
        };
    }

    /// Stores the offset with which the present position is the middle.
    fn make_middle(&mut self) {
        let offset = self.plant.position().rem_euclid(TURN) - TURN / 2.0;
        self.put_value(register::OFFSET, offset.round() as i32);
        let at = usize::from(register::OFFSET.address);
        self.saved[at..at + 2].copy_from_slice(&self.bytes[at..at + 2]);
    }

    /// Stores a write for [`act`](Self::act).
    pub(super) fn store(&mut self, address: u8, data: &[u8]) {
        self.stored = Some((address, data.to_vec()));
        self.show();
    }

    /// Executes the stored write.
    pub(super) fn act(&mut self, now: Instant) {
        if let Some((address, data)) = self.stored.take() {
            self.write(now, address, &data);
        }
    }

    /// Restores the factory settings, except for the id.
    pub(super) fn reset(&mut self) {
        let id = self.get(register::ID);
        for row in REGISTERS.iter().filter(|row| row.access == Access::Eeprom) {
            self.put(*row, row.factory.to_le_bytes());
        }
        self.put_value(register::ID, id);
        self.saved[..].copy_from_slice(&self.bytes);
        self.restart();
    }

    /// Forgets the turns that were counted.
    pub(super) fn reset_turns(&mut self) {
        self.plant.forget_turns();
        self.goal = self.goal.rem_euclid(TURN);
        self.show();
    }

    /// Power off and on: unsaved registers, torque and turns are lost.
    pub(super) fn restart(&mut self) {
        let before = self.bytes;
        self.bytes = [0; 256];
        for row in REGISTERS {
            let (at, len) = (usize::from(row.address), usize::from(row.len));
            let kept = match row.access {
                Access::Ram => None,
                Access::Eeprom => Some(&self.saved),
                Access::ReadOnly => Some(&before),
            };
            match kept {
                Some(kept) => self.bytes[at..at + len].copy_from_slice(&kept[at..at + len]),
                None => self.put(*row, row.factory.to_le_bytes()),
            }
        }
        self.put_value(register::TORQUE_LIMIT, self.get(register::MAX_TORQUE));
        self.stored = None;
        self.plant.push(self.plant.position().rem_euclid(TURN));
        self.put_value(register::GOAL_POSITION, self.position());
        self.set_goal(false);
        self.show();
    }
}
