//! A virtual Alpha1 robot: the controller between USB or Bluetooth and the servos.
//!
//! The document describes the requests, not the robot's behaviour. This model assumes:
//!
//! * At power-on the robot stands: all servos hold the middle position.
//! * The last command wins. A debug action or a named action ends the current one. A servo frame has effect until the
//!   next pose.
//! * A debug action is refused before the previous one's interval is over, for a faulty servo, or with an angle out of
//!   range. A refused action moves nothing. Angles for servos beyond 16 are ignored. The interval counts from the end
//!   of one frame to the end of the next.
//! * A stop ends the action and its interval; every servo holds its position. It succeeds also when nothing plays.
//! * An unknown action is refused, and the current one continues.
//! * The offset tool's connection is stored. It has no effect on this line.
//! * The USB types serial port and HID are stored. A robot that becomes a disk answers and leaves the line half a second
//!   later, unless it gets another type before.

use std::slice;

use armwire::alpha1::{
    Action, FirmwareVersion, OLDEST_FIRMWARE, OffsetTool, Outcome, Request, Response, ServoId, ServoStates, Text,
    UsbType,
};
use armwire::time::{Duration, Instant};

use super::SERVOS;
use super::action::{NamedAction, Pose, STANDING};
use super::chain::{Chain, encode};
use super::port::{Kind, Port};
use super::servo::{Servo, micros};
use crate::serial::{Counters, SerialDevice};

/// Identity and timing of a virtual robot.
///
/// ```
/// use armwire_sim::alpha1::RobotConfig;
///
/// let config = RobotConfig { hardware: b"Alpha1_V1.0".to_vec(), hid: true, ..RobotConfig::default() };
/// ```
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RobotConfig {
    /// Hardware version, at most 254 bytes.
    pub hardware: Vec<u8>,
    /// Firmware version, ten digits. The oldest with this protocol is [`OLDEST_FIRMWARE`].
    pub firmware: [u8; 10],
    /// Time from the last stop bit of a request, or the last byte of the previous answer, to the first start bit of its
    /// answer.
    pub turnaround: Duration,
    /// Idle time of the line after which an incomplete request is discarded. The real robot's timeout is not known. A
    /// USB host may pause inside a request, so the default is long.
    pub idle: Duration,
    /// Answers in USB HID reports, padded with zeros to 64 bytes. Requests may be padded in either mode.
    pub hid: bool,
}

impl Default for RobotConfig {
    /// Returns hardware `Alpha1_V2.0`, the oldest firmware, a turnaround of 1 ms, an idle time of 100 ms, no reports.
    fn default() -> Self {
        Self {
            hardware: b"Alpha1_V2.0".to_vec(),
            firmware: OLDEST_FIRMWARE,
            turnaround: Duration::from_millis(1),
            idle: Duration::from_millis(100),
            hid: false,
        }
    }
}

/// Time from a disk's last answer to the end of its port. The document gives none: a host must have the time to read it.
const LEAVING_TIME: Duration = Duration::from_millis(500);

/// The robot's presence on the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Presence {
    Here,
    /// It leaves at this time.
    Leaving(Instant),
    Gone,
}

/// An action in progress.
#[derive(Debug)]
struct Playing {
    name: &'static str,
    /// Remaining poses.
    poses: slice::Iter<'static, Pose>,
    /// Start of the next pose, or the end of the action.
    due: Instant,
}

/// A virtual Alpha1, switched on at time zero.
///
/// The robot is deterministic: its behaviour depends on the received bytes and their times, not on the polling rate.
///
/// ```
/// use armwire::time::Instant;
/// use armwire_sim::alpha1::{Alpha1Robot, RobotConfig};
/// use armwire_sim::serial::SerialDevice;
///
/// let mut robot = Alpha1Robot::new(RobotConfig::default());
/// for byte in [0xF2, 0x2F, 0, 0, 0, 0, 0, 0, 0, 0xED] {
///     robot.receive(Instant::ZERO, byte); // stop playing
/// }
/// assert_eq!(robot.transmit(Instant::from_micros(999)), None);
/// let answer: Vec<_> = std::iter::from_fn(|| robot.transmit(Instant::from_micros(1_000))).collect();
/// assert_eq!(answer, [0xF2, 0x2F, 0xAA, 0xED]);
/// ```
#[derive(Debug)]
pub struct Alpha1Robot {
    port: Port,
    controller: Controller,
}

/// The robot behind its port.
#[derive(Debug)]
struct Controller {
    config: RobotConfig,
    chain: Chain,
    playing: Option<Playing>,
    /// Earliest time of the next debug action.
    taken_from: Instant,
    offset_tool: OffsetTool,
    usb: UsbType,
    presence: Presence,
    /// Number of requests that were answered with a failure.
    refused: u64,
}

impl Alpha1Robot {
    /// Creates a standing robot.
    ///
    /// # Panics
    ///
    /// If its hardware version has more than 254 bytes.
    pub fn new(config: RobotConfig) -> Self {
        Text::new(&config.hardware).expect("the hardware version has 254 bytes at most");
        let kind = if config.hid { Kind::Reports } else { Kind::Serial };
        let ids = (1..=SERVOS as u8).filter_map(|id| ServoId::new(id).ok());
        let port = Port::new(kind, config.turnaround, config.idle);
        let mut controller = Controller {
            chain: Chain::new(ids),
            playing: None,
            taken_from: Instant::ZERO,
            offset_tool: OffsetTool::Disconnect,
            usb: if config.hid { UsbType::Hid } else { UsbType::SerialPort },
            presence: Presence::Here,
            refused: 0,
            config,
        };
        for (servo, angle) in controller.chain.servos_mut().iter_mut().zip(STANDING) {
            servo.go(Instant::ZERO, angle, Duration::ZERO, Duration::ZERO);
        }
        Self { port, controller }
    }

    /// Advances time, as [`receive`](SerialDevice::receive) and [`transmit`](SerialDevice::transmit) do. The methods
    /// below return the state at the last given time.
    pub fn advance(&mut self, now: Instant) {
        let heard_until = match self.controller.presence {
            Presence::Leaving(at) => at.min(now),
            Presence::Here | Presence::Gone => now,
        };
        if !self.is_gone()
            && let Some(idle_at) = self.port.take_idle(heard_until)
        {
            self.port.idle();
            self.process_requests(idle_at);
        }
        if let Presence::Leaving(at) = self.controller.presence
            && at <= now
        {
            self.controller.presence = Presence::Gone;
        }
        self.controller.play(now);
    }

    /// Returns the servos. Their order stays the same when ids change.
    pub fn servos(&self) -> &[Servo] {
        self.controller.chain.servos()
    }

    /// Returns the servos, to turn them by hand.
    pub fn servos_mut(&mut self) -> &mut [Servo] {
        self.controller.chain.servos_mut()
    }

    /// Returns the name of the action in progress.
    pub fn playing(&self) -> Option<&'static str> {
        self.controller.playing.as_ref().map(|playing| playing.name)
    }

    /// Returns the connection state of the servo offset tool.
    pub fn offset_tool(&self) -> OffsetTool {
        self.controller.offset_tool
    }

    /// Returns the USB type set last.
    pub fn usb(&self) -> UsbType {
        self.controller.usb
    }

    /// Returns the receive and answer counters.
    pub fn counters(&self) -> Counters {
        let mut counters = self.port.counters;
        counters.refused += self.controller.refused;
        counters
    }

    fn process_requests(&mut self, now: Instant) {
        self.controller.play(now);
        self.port.answer(now, |request| self.controller.execute(now, request));
    }
}

impl Controller {
    /// Executes a request and returns the answer, if it has one.
    fn execute(&mut self, now: Instant, request: &Request<'_>) -> Option<Vec<u8>> {
        let response = match *request {
            Request::ReadHardwareVersion => {
                let version = Text::new(&self.config.hardware).ok()?;
                return Some(encode(&Response::HardwareVersion(version)));
            }
            Request::ReadServoStates => Response::ServoStates(self.states()),
            Request::ReadFirmwareVersion => Response::FirmwareVersion(FirmwareVersion {
                outcome: Outcome::Success,
                text: self.config.firmware,
            }),
            Request::Stop => {
                self.stop(now);
                Response::Stopped(Outcome::Success)
            }
            Request::Act(action) => {
                let accepted = self.act(now, &action);
                Response::Acted(self.outcome(accepted))
            }
            Request::Play(name) => {
                let accepted = self.start(now, name);
                Response::Playing(self.outcome(accepted))
            }
            Request::SetOffsetTool(offset_tool) => {
                self.offset_tool = offset_tool;
                Response::OffsetTool(Outcome::Success)
            }
            Request::SetUsbType(usb) => {
                self.usb = usb;
                self.presence = match usb {
                    UsbType::Disk => Presence::Leaving(now + self.config.turnaround + LEAVING_TIME),
                    UsbType::SerialPort | UsbType::Hid => Presence::Here,
                };
                Response::UsbType(Outcome::Success)
            }
            Request::Servo(ref request) => return self.chain.execute(now, request),
            // A request of a later protocol version.
            _ => return None,
        };
        Some(encode(&response))
    }

    /// Returns the outcome for an answer, and counts refusals.
    fn outcome(&mut self, accepted: bool) -> Outcome {
        self.refused += u64::from(!accepted);
        if accepted { Outcome::Success } else { Outcome::Failure }
    }

    fn states(&self) -> ServoStates {
        let bit = |(i, servo): (usize, &Servo)| u32::from(servo.is_running()) << i;
        ServoStates::from_bits(self.chain.servos().iter().enumerate().map(bit).sum())
    }

    /// Starts a debug action. Returns true if it was accepted.
    fn act(&mut self, now: Instant, action: &Action) -> bool {
        let mut moves = self.chain.servos().iter().zip(action.angles);
        let can = moves.all(|(servo, angle)| angle.is_none_or(|angle| servo.can_go(angle)));
        if !can || now < self.taken_from {
            return false;
        }
        self.playing = None;
        let (span, interval) = (micros(action.time.duration()), micros(action.interval.duration()));
        self.taken_from = now + interval;
        for (servo, angle) in self.chain.servos_mut().iter_mut().zip(action.angles) {
            if let Some(angle) = angle {
                servo.go(now, angle, span, interval);
            }
        }
        true
    }

    fn stop(&mut self, now: Instant) {
        self.playing = None;
        self.taken_from = now;
        for servo in self.chain.servos_mut() {
            servo.stop(now);
        }
    }

    /// Starts the action of this name. Returns true if it exists.
    fn start(&mut self, now: Instant, name: Text<'_>) -> bool {
        let Some(action) = NamedAction::find(name.as_bytes()) else {
            return false;
        };
        self.playing = Some(Playing {
            name: action.name,
            poses: action.poses.iter(),
            due: now,
        });
        self.play(now);
        true
    }

    /// Starts all poses that are due, each at its time.
    fn play(&mut self, now: Instant) {
        while let Some(playing) = self.playing.as_mut().filter(|playing| playing.due <= now) {
            let start = playing.due;
            let Some(pose) = playing.poses.next() else {
                self.playing = None;
                return;
            };
            playing.due = start + pose.interval;
            for (servo, angle) in self.chain.servos_mut().iter_mut().zip(pose.angles) {
                // A faulty servo does not move; the others do.
                servo.go(start, angle, pose.duration, pose.interval);
            }
        }
    }
}

impl SerialDevice for Alpha1Robot {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        if self.is_gone() {
            return;
        }
        self.port.receive(now, byte);
        self.process_requests(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        if self.is_gone() {
            return None;
        }
        self.port.transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        match self.controller.presence {
            Presence::Here => self.port.poll_timeout(),
            Presence::Leaving(at) => Some(self.port.poll_timeout().map_or(at, |due| due.min(at))),
            Presence::Gone => None,
        }
    }

    fn is_gone(&self) -> bool {
        self.controller.presence == Presence::Gone
    }
}
