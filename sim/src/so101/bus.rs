//! The servos on their wire, behind a board with USB.

use std::collections::VecDeque;

use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{Device, DeviceEvent};
use armwire_feetech::{BROADCAST, Feetech, MAX_FRAME, Request, Status};

use super::config::Config;
use super::faults::Faults;
use super::order::{Order, OrderError};
use super::servo::Servo;
use crate::serial::{Counters, SerialDevice};

/// Time of a servo from the end of a request to its answer, besides its return delay.
const TURNAROUND: Duration = Duration::from_micros(20);
/// Silence of the line after which an incomplete request is discarded.
const IDLE: Duration = Duration::from_millis(5);
/// Maximum number of queued answers. Further ones are dropped.
const MAX_ANSWERS: usize = 256;

/// A virtual SO-101. At time zero it is switched on, without torque, with every joint in the middle.
///
/// Bytes that arrive while a servo transmits are lost. A servo hears requests at its own baud rate only.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::serial::SerialDevice;
/// use armwire_sim::so101::{Config, So101};
///
/// let mut arm = So101::new(Config::default());
/// for byte in [0xFF, 0xFF, 0x01, 0x02, 0x01, 0xFB] {
///     arm.receive(Instant::ZERO, byte); // ping of servo 1
/// }
/// assert_eq!(arm.transmit(Instant::from_micros(519)), None);
/// let answer: Vec<u8> = std::iter::from_fn(|| arm.transmit(Instant::from_micros(520))).collect();
/// assert_eq!(answer, [0xFF, 0xFF, 0x01, 0x02, 0x00, 0xFC]);
/// ```
#[derive(Debug)]
pub struct So101 {
    device: Device<Feetech, MAX_FRAME>,
    /// The time at which the line becomes idle, after the last byte.
    idle_at: Instant,
    echo: VecDeque<u8>,
    arm: Arm,
}

/// An answer that is queued or in transmission.
#[derive(Debug)]
struct Answer {
    due: Instant,
    bytes: Vec<u8>,
    sent: usize,
}

/// The servos and their answers.
#[derive(Debug)]
struct Arm {
    servos: Vec<Servo>,
    faults: Faults,
    baud: u32,
    answers: VecDeque<Answer>,
    /// The end of the last answer on the wire.
    free: Instant,
    /// The end of a pause of the host's USB.
    held: Instant,
    /// The end of a brown-out.
    off_until: Instant,
    counters: Counters,
}

impl So101 {
    /// Creates an arm with these servos.
    pub fn new(config: Config) -> Self {
        Self {
            device: Device::default(),
            idle_at: Instant::ZERO,
            echo: VecDeque::new(),
            arm: Arm {
                servos: config.servos(),
                faults: Faults::default(),
                baud: armwire_feetech::register::BAUD_RATES[0],
                answers: VecDeque::new(),
                free: Instant::ZERO,
                held: Instant::ZERO,
                off_until: Instant::ZERO,
                counters: Counters::default(),
            },
        }
    }

    /// Returns the servos at this time, from the arm's base on. Their order stays the same when ids change.
    pub fn servos(&mut self, now: Instant) -> &[Servo] {
        self.arm.advance(now);
        &self.arm.servos
    }

    /// Returns the receive and answer counters. `refused` counts executed requests that a silent servo did not answer.
    pub fn counters(&self) -> Counters {
        self.arm.counters
    }

    /// Carries out an order. Returns the lines of [`State`](Order::State), none for another order.
    ///
    /// # Errors
    ///
    /// [`OrderError`] if the bus has no such servo, or a hand cannot move it there. Nothing happens then.
    pub fn order(&mut self, now: Instant, order: Order) -> Result<Vec<String>, OrderError> {
        self.arm.advance(now);
        match order {
            Order::State => return Ok(self.arm.state()),
            Order::Sag(steps) => self.arm.set_sag(steps),
            Order::Hand { id, position } => {
                let index = self.arm.index(id)?;
                self.arm.servos[index].push(position)?;
            }
            Order::Silent { id } => self.arm.faults.silence(self.arm.index(id)?),
            Order::Clear => {
                self.arm.faults.add(order);
                self.arm.end_waits(now);
            }
            Order::Error { id, bits } => self.arm.faults.set_errors(self.arm.index(id)?, bits),
            Order::Unplugged { id } => {
                self.arm.faults.unplug(self.arm.index(id)?);
                self.arm.cut_supply();
            }
            other => self.arm.faults.add(other),
        }
        Ok(Vec::new())
    }

    fn process_requests(&mut self, now: Instant) {
        while let Some(event) = self.device.poll() {
            match event {
                DeviceEvent::Request { request, .. } => self.arm.execute(now, &request),
                DeviceEvent::Unknown { .. } => self.arm.counters.unknown += 1,
                DeviceEvent::Noise { bytes, .. } => self.arm.counters.noise_bytes += bytes.len() as u64,
                DeviceEvent::Broken { .. } => {}
            }
        }
    }
}

impl Arm {
    fn advance(&mut self, now: Instant) {
        self.servos.iter_mut().for_each(|servo| servo.advance(now));
    }

    fn index(&self, id: u8) -> Result<usize, OrderError> {
        let index = self.servos.iter().position(|servo| servo.id() == id);
        index.ok_or(OrderError::NoServo(id))
    }

    fn set_sag(&mut self, steps: i16) {
        for (servo, share) in self.servos.iter_mut().zip(Config::SHARES) {
            servo.set_sag(f64::from(steps) * share);
        }
    }

    fn state(&self) -> Vec<String> {
        let line = |servo: &Servo| {
            let torque = if servo.has_torque() { "on" } else { "off" };
            let (id, position, encoder) = (servo.id(), servo.position(), servo.encoder());
            format!("servo {id}: position {position}, encoder {encoder:.0}, torque {torque}")
        };
        self.servos.iter().map(line).collect()
    }

    /// Restarts the servos without a supply: they are as after power-on once it is back.
    fn cut_supply(&mut self) {
        let servos = self.servos.iter_mut().enumerate();
        for (_, servo) in servos.filter(|(index, _)| !self.faults.is_supplied(*index)) {
            servo.restart();
        }
    }

    /// Ends a pause of the host's USB and a brown-out.
    fn end_waits(&mut self, now: Instant) {
        (self.held, self.off_until) = (now, now);
        let sent = self.free.max(now);
        for answer in &mut self.answers {
            answer.due = answer.due.min(sent);
        }
    }

    /// The servos that hear a request to this id.
    fn addressed(&self, now: Instant, id: u8) -> Vec<usize> {
        let is_meant = |servo: &Servo| servo.baud() == self.baud && (id == BROADCAST || servo.id() == id);
        let hears = |index: &usize| self.faults.is_supplied(*index) && is_meant(&self.servos[*index]);
        let is_on = now >= self.off_until;
        (0..self.servos.len()).filter(|index| is_on && hears(index)).collect()
    }

    fn execute(&mut self, now: Instant, request: &Request) {
        self.counters.requests += 1;
        match *request {
            Request::Ping { id: BROADCAST } => {
                for index in self.addressed(now, BROADCAST) {
                    self.answer(now, vec![(index, Vec::new())]);
                }
            }
            Request::Ping { id } => {
                let servos = self.addressed(now, id).into_iter();
                self.answer(now, servos.map(|index| (index, Vec::new())).collect());
            }
            Request::Read { id, address, len } => self.read(now, id, address, len),
            Request::SyncRead { address, len, ids } => ids.iter().for_each(|id| self.read(now, *id, address, len)),
            Request::Write { id, address, data } => self.change(now, id, |servo| servo.write(now, address, data)),
            Request::RegWrite { id, address, data } => self.change(now, id, |servo| servo.store(address, data)),
            Request::Action { id } => self.change(now, id, |servo| servo.act(now)),
            Request::FactoryReset { id } => self.change(now, id, Servo::reset),
            Request::ResetTurns { id } => self.change(now, id, Servo::reset_turns),
            Request::Reboot { id } => {
                for index in self.addressed(now, id) {
                    self.servos[index].restart();
                }
            }
            Request::SyncWrite { address, len, data } => {
                for part in data.chunks_exact(usize::from(len) + 1) {
                    for index in self.addressed(now, part[0]) {
                        self.servos[index].write(now, address, &part[1..]);
                    }
                }
            }
            _ => self.counters.unknown += 1,
        }
    }

    /// Answers a read of one servo. A read of all, also by a SYNC_READ, has no answer.
    fn read(&mut self, now: Instant, id: u8, address: u8, len: u8) {
        if id == BROADCAST {
            return;
        }
        let servos = self.addressed(now, id).into_iter();
        let data = servos
            .map(|index| (index, self.servos[index].read(now, address, len)))
            .collect();
        self.answer(now, data);
    }

    /// Acknowledges a change with the id and the rate before it, and makes it. A brown-out at the answer prevents it.
    fn change(&mut self, now: Instant, id: u8, change: impl Fn(&mut Servo)) {
        let servos = self.addressed(now, id);
        let answering = servos.iter().filter(|index| self.servos[**index].acknowledges());
        let answers: Vec<_> = answering.map(|index| (*index, Vec::new())).collect();
        if id != BROADCAST {
            self.answer(now, answers);
        }
        if now >= self.off_until {
            for index in servos {
                self.servos[index].advance(now);
                change(&mut self.servos[index]);
            }
        }
    }

    /// Queues the answer of servos with the same id, which transmit at the same time.
    fn answer(&mut self, now: Instant, data: Vec<(usize, Vec<u8>)>) {
        // A brown-out at the answer of one servo silences those that would answer behind it.
        if now < self.off_until {
            return;
        }
        let (silent, data): (Vec<_>, Vec<_>) = data.into_iter().partition(|(index, _)| self.faults.is_silent(*index));
        self.counters.refused += silent.len() as u64;
        let packets: Vec<_> = data
            .iter()
            .filter_map(|(index, data)| self.packet(*index, data))
            .collect();
        let Some(mut bytes) = packets.iter().cloned().reduce(|one, other| collision(&one, &other)) else {
            return;
        };
        if self.answers.len() >= MAX_ANSWERS {
            self.counters.overrun += 1;
            return;
        }
        let fate = self.faults.next();
        if let Some(time) = fate.brownout {
            self.off_until = now + time;
            // Queued answers were on the wire before.
            self.servos.iter_mut().for_each(Servo::restart);
            return;
        }
        if fate.is_damaged
            && let Some(byte) = bytes.iter_mut().rev().nth(1)
        {
            *byte ^= 4;
        }
        self.counters.answered += 1;
        let delay = data.iter().map(|(index, _)| self.servos[*index].return_delay()).max();
        let start = self.free.max(now) + delay.unwrap_or(Duration::ZERO) + TURNAROUND;
        self.held = self.held.max(start + fate.late.unwrap_or(Duration::ZERO));
        for _ in 0..1 + u8::from(fate.is_twice) {
            let due = start.max(self.free).max(self.held);
            let micros = (bytes.len() as u64 * 10_000_000).div_ceil(self.baud.max(1).into());
            self.free = start.max(self.free) + Duration::from_micros(micros);
            self.answers.push_back(Answer {
                due,
                bytes: bytes.clone(),
                sent: 0,
            });
        }
    }

    /// The answer of a servo. None if no packet is long enough.
    fn packet(&self, index: usize, data: &[u8]) -> Option<Vec<u8>> {
        let servo = &self.servos[index];
        let (id, error) = (servo.id(), servo.errors() | self.faults.errors(index));
        let mut bytes = vec![0; MAX_FRAME];
        let n = Feetech::default().encode_response(&Status { id, error, data }, None, &mut bytes);
        bytes.truncate(n.ok()?);
        Some(bytes)
    }
}

/// The bytes of two servos that transmit at the same time: a 0 on the wire wins.
fn collision(one: &[u8], other: &[u8]) -> Vec<u8> {
    let (short, long) = if one.len() < other.len() {
        (one, other)
    } else {
        (other, one)
    };
    let high = short.iter().copied().chain(std::iter::repeat(0xFF));
    long.iter().zip(high).map(|(one, other)| one & other).collect()
}

impl SerialDevice for So101 {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.arm.counters.bytes += 1;
        if self.arm.answers.front().is_some_and(|answer| answer.sent > 0) {
            self.arm.counters.collided += 1;
            return;
        }
        if self.arm.faults.echoes {
            self.echo.push_back(byte);
        }
        if self.idle_at <= now {
            self.device.idle();
            self.process_requests(now);
        }
        self.idle_at = now + IDLE;
        // Each byte is decoded at once: there is room.
        let _full = self.device.receive(&[byte]);
        self.process_requests(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        let answer = self.arm.answers.front_mut();
        if answer.as_ref().is_none_or(|answer| answer.sent == 0)
            && let Some(byte) = self.echo.pop_front()
        {
            return Some(byte);
        }
        let answer = answer.filter(|answer| answer.due <= now)?;
        let byte = answer.bytes.get(answer.sent).copied();
        answer.sent += 1;
        if answer.sent == answer.bytes.len() {
            self.arm.answers.pop_front();
        }
        byte
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let echo = (!self.echo.is_empty()).then_some(Instant::ZERO);
        echo.or_else(|| self.arm.answers.front().map(|answer| answer.due))
    }

    fn set_baud(&mut self, baud: u32) {
        self.arm.baud = baud;
    }
}
