//! A virtual Alpha1 robot: the controller between USB or Bluetooth and the servos.
//!
//! The document says what can be asked, not what the robot then does. What is chosen here:
//!
//! * It is switched on standing: all servos hold in the middle.
//! * The last command wins. A debug action or another action ends the one that plays; what a servo is told by a frame
//!   of its own lasts until the next pose.
//! * A debug action that comes before the interval of the one before is over is refused, and so is one for a faulty
//!   servo, or with an angle that no servo can go to. Then nothing moves. Angles for servos that the robot does not
//!   have are ignored. The interval counts from the end of one frame to the end of the next.
//! * To stop ends an action and an interval, and lets every servo hold where it is. It succeeds also if nothing plays.
//! * An action that it does not know is refused, and the one that plays goes on.
//! * The offset tool's connection and the USB type are kept and can be seen; they change nothing on this line.

use std::slice;

use armwire::alpha1::{
    Action, Alpha1, FirmwareVersion, OLDEST_FIRMWARE, OffsetTool, Outcome, Request, Response, ServoId, ServoStates,
    Text, UsbType,
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};

use super::SERVOS;
use super::action::{NamedAction, Pose, STANDING};
use super::chain::{Chain, encode};
use super::port::{Kind, Port};
use super::servo::{Servo, micros};
use crate::serial::{Counters, SerialDevice};

/// What a virtual robot is, and how it answers.
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
    /// Firmware version, ten digits: the oldest that speaks this protocol is [`OLDEST_FIRMWARE`].
    pub firmware: [u8; 10],
    /// From the last stop bit of a request, or the last byte of the answer before, to the first start bit of its
    /// answer.
    pub turnaround: Duration,
    /// How long the line must be silent for a frame that waits for its end to be given up. The real robot's patience is
    /// not known. On USB a host that is held up pauses inside a request, so this is long: as long as a host waits for
    /// what a robot has at hand.
    pub idle: Duration,
    /// Whether each answer is in USB HID reports, filled up with zeros to 64 bytes. Requests may be so in any case.
    pub hid: bool,
}

impl Default for RobotConfig {
    /// Hardware `Alpha1_V2.0`, the oldest firmware, 1 ms of turnaround, 100 ms until a line is idle, no reports.
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

/// An action that plays.
#[derive(Debug)]
struct Playing {
    name: &'static str,
    /// The poses to come.
    poses: slice::Iter<'static, Pose>,
    /// When the next one is due, or the action is over.
    due: Instant,
}

/// A virtual Alpha1, switched on at time zero.
///
/// It is deterministic: what it does depends on the bytes it receives and when, and not on how often it is polled.
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
    config: RobotConfig,
    port: Port,
    chain: Chain,
    playing: Option<Playing>,
    /// Before this no debug action is taken.
    taken_from: Instant,
    offset_tool: OffsetTool,
    usb: UsbType,
}

impl Alpha1Robot {
    /// A standing robot.
    ///
    /// # Panics
    ///
    /// If its hardware version has more than 254 bytes.
    pub fn new(config: RobotConfig) -> Self {
        Text::new(&config.hardware).expect("the hardware version has 254 bytes at most");
        let kind = if config.hid { Kind::Reports } else { Kind::Serial };
        let ids = (1..=SERVOS as u8).filter_map(|id| ServoId::new(id).ok());
        let mut robot = Self {
            port: Port::new(kind, config.turnaround, config.idle),
            chain: Chain::new(ids),
            playing: None,
            taken_from: Instant::ZERO,
            offset_tool: OffsetTool::Disconnect,
            usb: if config.hid { UsbType::Hid } else { UsbType::SerialPort },
            config,
        };
        for (servo, angle) in robot.chain.servos_mut().iter_mut().zip(STANDING) {
            servo.go(Instant::ZERO, angle, Duration::ZERO, Duration::ZERO);
        }
        robot
    }

    /// Lets time pass, as [`receive`](SerialDevice::receive) and [`transmit`](SerialDevice::transmit) do: what the
    /// methods below tell is the state at the last time given.
    pub fn advance(&mut self, now: Instant) {
        if let Some(idle_at) = self.port.take_idle(now) {
            self.port.idle();
            self.hear(idle_at);
        }
        self.play(now);
    }

    /// Its servos. Their order does not change, whatever ids they are given.
    pub fn servos(&self) -> &[Servo] {
        self.chain.servos()
    }

    /// Its servos, to turn by hand.
    pub fn servos_mut(&mut self) -> &mut [Servo] {
        self.chain.servos_mut()
    }

    /// The name of the action that plays.
    pub fn playing(&self) -> Option<&'static str> {
        self.playing.as_ref().map(|playing| playing.name)
    }

    /// Whether the servo offset tool is connected.
    pub fn offset_tool(&self) -> OffsetTool {
        self.offset_tool
    }

    /// What it was last told to be on USB.
    pub fn usb(&self) -> UsbType {
        self.usb
    }

    /// What it has heard.
    pub fn counters(&self) -> Counters {
        self.port.counters
    }

    fn hear(&mut self, now: Instant) {
        self.play(now);
        while let Some(frame) = self.port.next_request() {
            let request = Alpha1.parse_request(&frame);
            let answer = request.ok().and_then(|request| self.obey(now, &request));
            self.port.reply(now, &frame, answer);
        }
    }

    /// Does what is asked and returns the answer, if there is one.
    fn obey(&mut self, now: Instant, request: &Request<'_>) -> Option<Vec<u8>> {
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
                let obeyed = self.act(now, &action);
                Response::Acted(self.port.outcome(obeyed))
            }
            Request::Play(name) => {
                let obeyed = self.start(now, name);
                Response::Playing(self.port.outcome(obeyed))
            }
            Request::SetOffsetTool(offset_tool) => {
                self.offset_tool = offset_tool;
                Response::OffsetTool(Outcome::Success)
            }
            Request::SetUsbType(usb) => {
                self.usb = usb;
                Response::UsbType(Outcome::Success)
            }
            Request::Servo(ref request) => return self.chain.obey(now, request),
            // A request of a later protocol version.
            _ => return None,
        };
        Some(encode(&response))
    }

    fn states(&self) -> ServoStates {
        let bit = |(i, servo): (usize, &Servo)| u32::from(servo.is_running()) << i;
        ServoStates::from_bits(self.servos().iter().enumerate().map(bit).sum())
    }

    /// Starts the debug action, if it may and can. Returns whether it does.
    fn act(&mut self, now: Instant, action: &Action) -> bool {
        let mut moves = self.servos().iter().zip(action.angles);
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

    /// Starts an action, if there is one of this name. Returns whether there is.
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

    /// Takes all poses that are due, each at its time.
    fn play(&mut self, now: Instant) {
        while let Some(playing) = self.playing.as_mut().filter(|playing| playing.due <= now) {
            let start = playing.due;
            let Some(pose) = playing.poses.next() else {
                self.playing = None;
                return;
            };
            playing.due = start + pose.interval;
            for (servo, angle) in self.chain.servos_mut().iter_mut().zip(pose.angles) {
                // A faulty servo does not go; the others do.
                servo.go(start, angle, pose.duration, pose.interval);
            }
        }
    }
}

impl SerialDevice for Alpha1Robot {
    fn receive(&mut self, now: Instant, byte: u8) {
        self.advance(now);
        self.port.receive(now, byte);
        self.hear(now);
    }

    fn transmit(&mut self, now: Instant) -> Option<u8> {
        self.advance(now);
        self.port.transmit(now)
    }

    fn poll_timeout(&self) -> Option<Instant> {
        self.port.poll_timeout()
    }
}
