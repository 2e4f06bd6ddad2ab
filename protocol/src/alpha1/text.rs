//! Messages and their values as text, in degrees and seconds.
//!
//! Texts from the robot are escaped.

use core::fmt::{self, Display, Formatter};
use core::time::Duration;

use super::{
    Action, Address, Angle, FirmwareVersion, Interval, Led, MoveTime, OLDEST_FIRMWARE, Offset, OffsetTool, Outcome,
    Request, Response, ServoId, ServoRequest, ServoResponse, ServoStates, UsbType,
};
use crate::hex::Hex;
use crate::named::Named;

/// Degrees; the byte of an angle that is out of range.
impl Display for Angle {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.degrees() {
            Some(degrees) => write!(f, "{degrees}°"),
            None => write!(f, "{} (out of range)", self.raw()),
        }
    }
}

/// Seconds, for example `0.5 s`.
impl Display for MoveTime {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        seconds(f, self.duration())
    }
}

/// Seconds, for example `1310.7 s`.
impl Display for Interval {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        seconds(f, self.duration())
    }
}

/// Writes hundredths of a second without trailing zeros.
fn seconds(f: &mut Formatter<'_>, duration: Duration) -> fmt::Result {
    let whole = duration.as_secs();
    match duration.subsec_millis() / 10 {
        0 => write!(f, "{whole} s"),
        hundredths if hundredths % 10 == 0 => write!(f, "{whole}.{} s", hundredths / 10),
        hundredths => write!(f, "{whole}.{hundredths:02} s"),
    }
}

/// Degrees, for example `-3.00°`.
impl Display for Offset {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{:+.2}°", self.degrees())
    }
}

/// For example `servo 3`.
impl Display for ServoId {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "servo {}", self.get())
    }
}

impl Display for Address {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::All => f.write_str("all servos"),
            Self::One(servo) => servo.fmt(f),
        }
    }
}

/// The byte on the wire.
impl Display for Led {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// `done` or `failed`.
impl Display for Outcome {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(if self.is_success() { "done" } else { "failed" })
    }
}

impl Display for UsbType {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Disk => "disk",
            Self::SerialPort => "serial port",
            Self::Hid => "HID device",
        })
    }
}

/// The numbers of the running servos.
impl Display for ServoStates {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if self.bits() == 0 {
            return f.write_str("none");
        }
        for (nth, servo) in self.running().enumerate() {
            write!(f, "{}{servo}", if nth == 0 { "" } else { " " })?;
        }
        Ok(())
    }
}

/// The version, and whether it is too old for this protocol.
impl Display for FirmwareVersion {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (text, oldest) = (self.text.escape_ascii(), OLDEST_FIRMWARE.escape_ascii());
        match self.outcome {
            Outcome::Failure => f.write_str("not reported, the robot failed"),
            Outcome::Success if self.text < OLDEST_FIRMWARE => {
                write!(f, "{text}, before {oldest}, the first for this protocol")
            }
            Outcome::Success => write!(f, "{text}"),
        }
    }
}

/// The target of each servo, `-` for none, and the times.
impl Display for Action {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (nth, angle) in self.angles.iter().enumerate() {
            f.write_str(if nth == 0 { "" } else { " " })?;
            match angle {
                Some(angle) => angle.fmt(f)?,
                None => f.write_str("-")?,
            }
        }
        write!(f, " in {}, next after {}", self.time, self.interval)
    }
}

/// For example `move servo 1 to 90° in 1 s, completion time 1 s`.
impl Display for ServoRequest {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Move { to, angle, time, lock } => write!(f, "move {to} to {angle} in {time}, completion time {lock}"),
            Self::Release(to) => write!(f, "release {to}"),
            Self::SetLed { to, led } => write!(f, "light of {to} to {led}"),
            Self::ReadAngles(servo) => write!(f, "read angles of {servo}, and release it"),
            Self::ChangeId { from, to } => write!(f, "change id of {from} to {}", to.get()),
            Self::SetOffset(servo, offset) => write!(f, "set offset of {servo} to {offset}"),
            Self::ReadOffset(servo) => write!(f, "read offset of {servo}"),
            Self::ReadVersion(servo) => write!(f, "read version of {servo}"),
        }
    }
}

/// For example `play 'dance'`.
///
/// ```
/// use armwire::alpha1::{Request, Text};
///
/// assert_eq!(Request::Play(Text::new(b"dance")?).to_string(), "play 'dance'");
/// # Ok::<(), armwire::OutOfRange>(())
/// ```
impl Display for Request<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::ReadHardwareVersion => f.write_str("read hardware version"),
            Self::ReadServoStates => f.write_str("read servo states"),
            Self::Stop => f.write_str("stop"),
            Self::ReadFirmwareVersion => f.write_str("read firmware version"),
            Self::Act(action) => write!(f, "act {action}"),
            Self::SetOffsetTool(OffsetTool::Connect) => f.write_str("connect the offset tool"),
            Self::SetOffsetTool(OffsetTool::Disconnect) => f.write_str("disconnect the offset tool"),
            Self::SetUsbType(usb) => write!(f, "be a {usb} on USB"),
            Self::Play(name) => write!(f, "play '{name}'"),
            Self::Servo(request) => request.fmt(f),
        }
    }
}

impl Response<'_> {
    /// The result of the request. `None` for a response without one, whose request has succeeded.
    ///
    /// ```
    /// use armwire::alpha1::{Outcome, Response, ServoStates};
    ///
    /// assert_eq!(Response::Acted(Outcome::Failure).outcome(), Some(Outcome::Failure));
    /// assert_eq!(Response::ServoStates(ServoStates::from_bits(1)).outcome(), None);
    /// ```
    pub const fn outcome(&self) -> Option<Outcome> {
        match self {
            Self::HardwareVersion(_) | Self::ServoStates(_) => None,
            Self::Stopped(outcome)
            | Self::FirmwareVersion(FirmwareVersion { outcome, .. })
            | Self::Acted(outcome)
            | Self::OffsetTool(outcome)
            | Self::UsbType(outcome)
            | Self::Playing(outcome) => Some(*outcome),
            Self::Servo(response) => Some(response.outcome().1),
        }
    }
}

impl ServoResponse {
    /// The values of the answer as text, without the servo: `released, at 90°, sent to 91°`.
    ///
    /// ```
    /// use armwire::alpha1::{ServoId, ServoResponse};
    ///
    /// let response = ServoResponse::Acknowledged(ServoId::new(3)?);
    /// assert_eq!(response.values().to_string(), "understood");
    /// assert_eq!(response.to_string(), "servo 3: understood");
    /// # Ok::<(), armwire::OutOfRange>(())
    /// ```
    pub const fn values(&self) -> impl Display {
        Values(self)
    }

    /// The servo, and its result.
    ///
    /// ```
    /// use armwire::alpha1::{Outcome, ServoId, ServoResponse};
    ///
    /// let servo = ServoId::new(3)?;
    /// assert_eq!(ServoResponse::Acknowledged(servo).outcome(), (servo, Outcome::Success));
    /// # Ok::<(), armwire::OutOfRange>(())
    /// ```
    pub const fn outcome(&self) -> (ServoId, Outcome) {
        match *self {
            Self::Acknowledged(servo) => (servo, Outcome::Success),
            Self::Angles { servo, outcome, .. }
            | Self::IdChanged { servo, outcome, .. }
            | Self::OffsetSet { servo, outcome }
            | Self::Offset { servo, outcome, .. }
            | Self::Version { servo, outcome, .. } => (servo, outcome),
        }
    }
}

/// The values of a servo's answer.
struct Values<'a>(&'a ServoResponse);

impl Display for Values<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        if !self.0.outcome().1.is_success() {
            return f.write_str("failed");
        }
        match self.0 {
            ServoResponse::Acknowledged(_) => f.write_str("understood"),
            ServoResponse::Angles { target, actual, .. } => write!(f, "released, at {actual}°, sent to {target}°"),
            ServoResponse::IdChanged { was, .. } => write!(f, "was {was}"),
            ServoResponse::OffsetSet { .. } => f.write_str("offset set"),
            ServoResponse::Offset { thirds, .. } => write!(f, "offset {:+.2}°", f32::from(*thirds) / 3.0),
            ServoResponse::Version { version, .. } => write!(f, "version {}", Hex(version)),
        }
    }
}

/// For example `servo 3: offset set`.
impl Display for ServoResponse {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}: {}", self.outcome().0, self.values())
    }
}

/// The names and values of the message, for example `stop: done`.
///
/// ```
/// use armwire::alpha1::{Outcome, Response, ServoStates};
///
/// assert_eq!(Response::Stopped(Outcome::Success).to_string(), "stop: done");
/// assert_eq!(Response::ServoStates(ServoStates::from_bits(0x8005)).to_string(), "servos that run: 1 3 16");
/// ```
impl Display for Response<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::HardwareVersion(version) => {
                write!(f, "arm: Alpha1, {}", Named("hardware", version.as_bytes()))
            }
            Self::ServoStates(states) => write!(f, "servos that run: {states}"),
            Self::Stopped(outcome) => write!(f, "stop: {outcome}"),
            Self::FirmwareVersion(version) => write!(f, "firmware: {version}"),
            Self::Acted(outcome) => write!(f, "act: {outcome}"),
            Self::OffsetTool(outcome) => write!(f, "offset tool: {outcome}"),
            Self::UsbType(outcome) => write!(f, "USB type: {outcome}"),
            Self::Playing(outcome) => write!(f, "play: {outcome}"),
            Self::Servo(response) => response.fmt(f),
        }
    }
}
