//! A virtual Ling arm.
//!
//! [`LingArm`] is the electronics: it executes requests and returns the real arm's answers. `body.rs` has joint motion
//! and servo temperatures, [`Plant`] the weight, lag and friction of the joints, [`Leader`] the control mode of a
//! force-feedback leader. [`legacy`] has an arm of the older generation, which only transmits.

mod axis;
mod body;
mod leader;
pub mod legacy;
mod mechanics;
mod plant;
#[cfg(test)]
mod tests;
mod trajectory;

use std::array;
use std::collections::VecDeque;

use armwire::ling::{
    Info, JOINTS, JointState, Kind, Ling, MAX_FRAME, MotionStatus, Move, Opening, PerServo, Position, Request,
    Response, SelfCheck, SerialNumber, Stroke, Torque, Version,
};
use armwire::time::{Duration, Instant};
use armwire::{Device, DeviceEvent};
use oorandom::Rand32;

pub use self::leader::{Leader, LeaderError};
pub use self::plant::{Plant, PlantError};
pub use crate::serial::Counters;
use crate::serial::SerialDevice;
use body::{Body, Drive};
use leader::Electronics;

/// Maximum number of queued answers. Further answers are dropped.
const MAX_REPLIES: usize = 8;

/// Identity and timing of a virtual arm.
///
/// ```
/// use armwire::time::Duration;
/// use armwire::ling::Stroke;
/// use armwire_sim::ling::Config;
///
/// let config = Config { stroke: Stroke::Mm100, turnaround: Duration::from_micros(50), ..Config::follower() };
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Config {
    /// Leader or follower.
    pub kind: Kind,
    /// Serial number. Its prefix should match `kind`.
    pub serial: SerialNumber,
    /// Hardware version.
    pub hardware: Version,
    /// Firmware version.
    pub firmware: Version,
    /// Configured gripper.
    pub stroke: Stroke,
    /// Ambient temperature, in °C.
    pub ambient: u8,
    /// Time from the last stop bit of a request, or the last byte of the previous answer, to the first start bit of its
    /// answer.
    pub turnaround: Duration,
    /// Idle time of the line after which an incomplete frame is discarded.
    ///
    /// The real arm's timeout is not known. A link that forwards packets leaves gaps within frames, up to one
    /// millisecond on full-speed USB. The default is longer than that, and shorter than a host's response timeout.
    pub idle: Duration,
    /// Echo of every received byte, as from a half-duplex adapter.
    pub echo: bool,
    /// Lag, sag, friction and noise of the joints. A leader, moved by hand, has the noise only.
    pub plant: Plant,
    /// A force-feedback leader. Without it the arm does not answer requests for a control mode or for force feedback.
    pub force_feedback: Option<Leader>,
}

impl Config {
    /// Returns a follower with the versions of the document's example (section 2.1), a 50 mm gripper, at 25 °C.
    pub const fn follower() -> Self {
        Self {
            kind: Kind::Follower,
            serial: SerialNumber(*b"ADFS251205123456"),
            hardware: Version(110),
            firmware: Version(610),
            stroke: Stroke::Mm50,
            ambient: 25,
            turnaround: Duration::from_micros(200),
            idle: Duration::from_millis(2),
            echo: false,
            plant: Plant::DEFAULT,
            force_feedback: None,
        }
    }

    /// Returns a leader with the serial number of the document's example, otherwise as [`follower`](Self::follower).
    pub const fn leader() -> Self {
        Self {
            kind: Kind::Leader,
            serial: SerialNumber(*b"ADLS251205123456"),
            ..Self::follower()
        }
    }
}

/// An answer that is queued or in transmission.
#[derive(Debug)]
struct Reply {
    due: Instant,
    bytes: [u8; MAX_FRAME],
    len: usize,
    sent: usize,
}

/// A virtual Ling arm, switched on at time zero.
///
/// The arm is deterministic: its behaviour depends on the received bytes and their times, not on the polling rate.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::ling::{Config, LingArm};
/// use armwire_sim::serial::SerialDevice;
///
/// let mut arm = LingArm::new(Config::follower());
/// for (i, byte) in [0xAA, 0x04, 0x0E, 0x01, 0xFE, 0x1B, 0xFF].into_iter().enumerate() {
///     arm.receive(Instant::from_micros(10 * (i as u64 + 1)), byte);
/// }
/// assert_eq!(arm.transmit(Instant::from_micros(269)), None);
/// assert_eq!(arm.transmit(Instant::from_micros(270)), Some(0xAA)); // 200 µs after the request's end
/// ```
#[derive(Debug)]
pub struct LingArm {
    config: Config,
    body: Body,
    electronics: Option<Electronics>,
    device: Device<Ling, MAX_FRAME>,
    /// Time at which the line becomes idle, `None` after that.
    idle_at: Option<Instant>,
    echo: VecDeque<u8>,
    replies: VecDeque<Reply>,
    counters: Counters,
    noise: Rand32,
}

impl LingArm {
    /// Creates an arm at its zero position with a closed gripper. A follower's torque is on, a leader's is off.
    pub fn new(config: Config) -> Self {
        let mut body = Body::new(config.kind, config.ambient, &config.plant);
        if config.force_feedback.is_some() {
            body.set_drive(Drive::Position);
        }
        Self {
            body,
            electronics: config.force_feedback.map(Electronics::new),
            noise: Rand32::new(config.plant.seed),
            config,
            device: Device::new(Ling),
            idle_at: None,
            echo: VecDeque::new(),
            replies: VecDeque::new(),
            counters: Counters::default(),
        }
    }

    /// Advances time, as [`receive`](SerialDevice::receive) and [`transmit`](SerialDevice::transmit) do. The methods
    /// below return the state at the last given time.
    pub fn advance(&mut self, now: Instant) {
        if let Some(idle_at) = self.idle_at
            && idle_at <= now
        {
            self.idle_at = None;
            self.device.idle();
            self.process_requests(idle_at);
        }
        self.advance_body(now);
    }

    fn advance_body(&mut self, now: Instant) {
        if let Some(electronics) = &mut self.electronics {
            electronics.advance(now, &mut self.body);
        }
        self.body.advance(now);
    }

    /// Returns the true joint positions, in ticks, without the noise of a reading.
    pub fn joints(&self) -> [u16; JOINTS] {
        self.body.joints()
    }

    /// Returns the gripper opening, in thousandths of the stroke.
    pub fn gripper(&self) -> u16 {
        self.body.gripper()
    }

    /// Returns the configured gripper.
    pub fn stroke(&self) -> Stroke {
        self.config.stroke
    }

    /// Returns the reported motion status.
    pub fn status(&self) -> MotionStatus {
        self.body.status()
    }

    /// Returns true if the torque is on.
    pub fn is_holding(&self) -> bool {
        self.body.is_holding()
    }

    /// Returns true if a joint or the gripper moves.
    pub fn is_moving(&self) -> bool {
        self.body.is_moving()
    }

    /// Returns the servo temperatures, in °C.
    pub fn temperatures(&self) -> PerServo<u8> {
        per_servo(self.config.kind, self.body.temperatures())
    }

    /// Returns the servo velocities, in ticks per second.
    pub fn velocities(&self) -> PerServo<u16> {
        per_servo(self.config.kind, self.body.velocities())
    }

    /// Returns the counters. Motion without torque, motion of a leader, and torque during overheat protection are
    /// refused.
    pub fn counters(&self) -> Counters {
        self.counters
    }

    /// Starts a move of another program, which is not on this line. Returns true if it was accepted.
    pub fn move_by_other(&mut self, target: &Move) -> bool {
        self.body.go(target)
    }

    /// Moves a joint, 0 to 5, by hand, as far as nothing is in its way, and lets go. Returns true if it moved: with
    /// torque on it does not.
    pub fn push_joint(&mut self, joint: usize, position: Position) -> bool {
        joint < JOINTS && self.body.push(joint, position.ticks())
    }

    /// Moves the gripper by hand. Returns true if it moved: with torque on, a follower's does not.
    pub fn push_gripper(&mut self, opening: Opening) -> bool {
        self.body.push_gripper(opening.per_mille())
    }

    /// Removes the obstacle of the [`Plant`].
    pub fn remove_obstacle(&mut self) {
        self.body.remove_obstacle();
    }

    /// Sets whether the self-check reports a servo, by its id from 1, as faulty.
    ///
    /// An unknown id is ignored.
    pub fn set_faulty(&mut self, id: u8, faulty: bool) {
        self.body.set_faulty(id, faulty);
    }

    fn process_requests(&mut self, now: Instant) {
        self.advance_body(now);
        while let Some(event) = self.device.poll() {
            match event {
                DeviceEvent::Request { request, .. } => {
                    self.counters.requests += 1;
                    if let Some(response) = self.execute(&request, now) {
                        self.reply(now, &response);
                    }
                }
                DeviceEvent::Unknown { .. } => self.counters.unknown += 1,
                DeviceEvent::Noise { bytes, .. } => self.counters.noise_bytes += bytes.len() as u64,
                DeviceEvent::Broken { .. } => {}
            }
        }
    }

    /// Executes a request and returns the answer, if it has one.
    fn execute(&mut self, request: &Request, now: Instant) -> Option<Response> {
        let accepted = match *request {
            Request::ReadInfo => {
                return Some(Response::Info(Info {
                    serial: self.config.serial,
                    hardware: self.config.hardware,
                    firmware: self.config.firmware,
                }));
            }
            Request::ReadStroke => return Some(Response::Stroke(self.config.stroke)),
            Request::ReadJoints => {
                return Some(Response::Joints(JointState {
                    joints: self.read_joints(),
                    gripper: self.gripper(),
                    status: self.status(),
                }));
            }
            Request::ReadTemperatures => return Some(Response::Temperatures(self.temperatures())),
            Request::ReadVelocities => return Some(Response::Velocities(self.velocities())),
            Request::SelfCheck => return Some(Response::SelfCheck(SelfCheck(self.body.normal()))),
            Request::SetZero => {
                self.body.set_zero();
                true
            }
            Request::SetStroke(stroke) => {
                self.config.stroke = stroke;
                true
            }
            Request::SetTorque(torque) => self.body.set_torque(torque == Torque::On),
            Request::SetTemperatureLimit(limit) => {
                self.body.set_limit(limit);
                true
            }
            Request::Move(target) => self.body.go(&target),
            // A request to a force-feedback leader, or of a later protocol version.
            ref request => {
                let electronics = self.electronics.as_mut();
                let answer = electronics.and_then(|electronics| electronics.execute(request, now, &self.body));
                if answer.is_some() {
                    return answer;
                }
                false
            }
        };
        self.counters.refused += u64::from(!accepted);
        None
    }

    /// Returns the joint positions with the noise of a reading.
    fn read_joints(&mut self) -> [u16; JOINTS] {
        let noise = u16::from(self.config.plant.noise);
        self.joints().map(|ticks| {
            let error = self.noise.rand_range(0..u32::from(2 * noise + 1)) as u16;
            (ticks + error).saturating_sub(noise).min(Position::MAX.ticks())
        })
    }

    fn reply(&mut self, now: Instant, response: &Response) {
        let mut bytes = [0; MAX_FRAME];
        let room = self.replies.len() < MAX_REPLIES;
        match self.device.respond(response, None, &mut bytes) {
            Ok(len) if room => {
                self.counters.answered += 1;
                self.replies.push_back(Reply {
                    due: now + self.config.turnaround,
                    bytes,
                    len,
                    sent: 0,
                });
            }
            _ => self.counters.overrun += 1,
        }
    }
}

impl SerialDevice for LingArm {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        self.counters.bytes += 1;
        if self.config.echo {
            self.echo.push_back(byte);
        }
        self.idle_at = Some(now + self.config.idle);
        // All earlier frames have been taken out: there is room.
        let _ = self.device.receive(&[byte]);
        self.process_requests(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        let begun = self.replies.front().is_some_and(|reply| reply.sent > 0);
        // An echo waits for the end of the answer in transmission.
        if !begun && let Some(byte) = self.echo.pop_front() {
            return Some(byte);
        }
        let reply = self.replies.front_mut().filter(|reply| reply.due <= now)?;
        let byte = reply.bytes[reply.sent];
        reply.sent += 1;
        if reply.sent == reply.len {
            self.replies.pop_front();
            // The next answer starts one turnaround after this one.
            if let Some(next) = self.replies.front_mut() {
                next.due = next.due.max(now + self.config.turnaround);
            }
        }
        Some(byte)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        let echo = (!self.echo.is_empty()).then_some(Instant::ZERO);
        let reply = self.replies.front().map(|reply| reply.due);
        [echo, reply, self.idle_at].into_iter().flatten().min()
    }
}

/// Returns one reading per servo of this kind of arm.
fn per_servo<T: Copy + Default>(kind: Kind, mut readings: impl Iterator<Item = T>) -> PerServo<T> {
    match kind {
        Kind::Leader => PerServo::Leader(array::from_fn(|_| readings.next().unwrap_or_default())),
        Kind::Follower => PerServo::Follower(array::from_fn(|_| readings.next().unwrap_or_default())),
    }
}
