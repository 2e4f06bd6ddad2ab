//! Messages and their values as text, in degrees, percent and °C.
//!
//! A message is a list of its values: `joints: +0.00° …, gripper: 50.0 % open, status: locked`. The types of this
//! module are single readings in the same form, for programs that show them one by one. Numbers are formatted as
//! integers, without the large code that formats floating-point numbers.

use core::fmt::{self, Display, Formatter};

use super::{
    ControlMode, ForceFeedback, GripperSpeed, Info, Inhibit, JointMask, JointState, Kind, ModeReply, ModeResult,
    ModeState, Move, Opening, Position, Request, Response, SelfCheck, Speed, Stroke, TemperatureLimit, Torque,
};
use crate::named::Named;

/// A joint reading in ticks: degrees from the centre, to two decimals.
///
/// ```
/// use armwire::ling::text::Angle;
///
/// assert_eq!(Angle(3072).to_string(), "+90.00°");
/// assert_eq!(Angle(4096).to_string(), "+180.00° (out of range)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Angle(pub u16);

/// A gripper reading in thousandths of the stroke: percent, to one decimal.
///
/// ```
/// use armwire::ling::text::Gripper;
///
/// assert_eq!(Gripper(500).to_string(), "50.0 % open");
/// assert_eq!(Gripper(2051).to_string(), "205.1 % (out of range)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Gripper(pub u16);

/// A velocity in ticks per second: degrees per second, to one decimal and without the unit.
///
/// ```
/// assert_eq!(armwire::ling::text::Velocity(1000).to_string(), "87.9");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Velocity(pub u16);

impl Display for Angle {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let centre = Position::CENTRE.ticks();
        let sign = if self.0 < centre { '-' } else { '+' };
        // 360° are 4096 ticks.
        let hundredths = nearest::<128>(u32::from(self.0.abs_diff(centre)) * 1125);
        write!(f, "{sign}{}.{:02}°", hundredths / 100, hundredths % 100)?;
        match self.0 > Position::MAX.ticks() {
            true => f.write_str(" (out of range)"),
            false => Ok(()),
        }
    }
}

impl Display for Gripper {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let remark = match Opening::new(self.0) {
            Ok(_) => "open",
            Err(_) => "(out of range)",
        };
        write!(f, "{}.{} % {remark}", self.0 / 10, self.0 % 10)
    }
}

impl Display for Velocity {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let tenths = nearest::<256>(u32::from(self.0) * 225);
        write!(f, "{}.{}", tenths / 10, tenths % 10)
    }
}

/// The integer nearest to `numerator / D`, the even one of two, as for floating-point numbers in `core`.
const fn nearest<const D: u32>(numerator: u32) -> u32 {
    let (quotient, twice) = (numerator / D, numerator % D * 2);
    if twice > D || twice == D && quotient % 2 == 1 {
        quotient + 1
    } else {
        quotient
    }
}

/// Degrees from the centre, for example `+90.00°`.
impl Display for Position {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        Angle(self.ticks()).fmt(f)
    }
}

/// Degrees per second, for example `87.9°/s`.
impl Display for Speed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}°/s", Velocity(self.ticks_per_second()))
    }
}

/// Percent of the stroke, for example `50.0 %`.
impl Display for Opening {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{}.{} %", self.per_mille() / 10, self.per_mille() % 10)
    }
}

/// Ticks per second.
impl Display for GripperSpeed {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} ticks/s", self.0)
    }
}

impl Display for Stroke {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} mm", self.millimetres())
    }
}

impl Display for TemperatureLimit {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "{} °C", self.celsius())
    }
}

impl Display for Torque {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Off => "off",
            Self::On => "on",
        })
    }
}

impl Display for Kind {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Leader => "leader",
            Self::Follower => "follower",
        })
    }
}

/// Every target with its speed.
impl Display for Move {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for (nth, (position, speed)) in self.joints.iter().enumerate() {
            write!(f, "{}{position} at {speed}", if nth == 0 { "" } else { " " })?;
        }
        let (opening, speed) = self.gripper;
        write!(f, ", gripper {opening} at {speed}")
    }
}

/// For example `set gripper stroke 50 mm`.
///
/// ```
/// use armwire::ling::{Request, Stroke, Torque};
///
/// assert_eq!(Request::SetTorque(Torque::Off).to_string(), "torque off");
/// assert_eq!(Request::SetStroke(Stroke::Mm50).to_string(), "set gripper stroke 50 mm");
/// ```
impl Display for Request {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::ReadInfo => f.write_str("read information"),
            Self::SetZero => f.write_str("set zero position"),
            Self::SetStroke(stroke) => write!(f, "set gripper stroke {stroke}"),
            Self::ReadStroke => f.write_str("read gripper stroke"),
            Self::SetTorque(torque) => write!(f, "torque {torque}"),
            Self::ReadJoints => f.write_str("read joints"),
            Self::ReadTemperatures => f.write_str("read temperatures"),
            Self::SetTemperatureLimit(limit) => write!(f, "set temperature limit {limit}"),
            Self::ReadVelocities => f.write_str("read velocities"),
            Self::Move(target) => write!(f, "move {target}"),
            Self::SelfCheck => f.write_str("self-check"),
            Self::SetMode(mode) => write!(f, "set control mode {mode}"),
            Self::ReadMode => f.write_str("read control mode"),
            Self::SetForceFeedback(is_on) => write!(f, "force feedback {}", switch(*is_on)),
            Self::ReadForceFeedback => f.write_str("read force feedback"),
        }
    }
}

/// For example `arm: Ling follower, serial: ADFS251205123456, hardware: v6.10, firmware: v6.10`.
impl Display for Info {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.serial.kind() {
            Some(kind) => write!(f, "arm: Ling {kind}")?,
            None => f.write_str("arm: Ling, of unknown kind")?,
        }
        let (serial, hardware, firmware) = (Named("serial", self.serial.text()), self.hardware, self.firmware);
        write!(f, ", {serial}, hardware: {hardware}, firmware: {firmware}")
    }
}

/// Degrees, percent, and the motion status.
///
/// ```
/// use armwire::ling::{JointState, MotionStatus};
///
/// let state = JointState {
///     joints: [2048, 3072, 1024, 2048, 2048, 4096],
///     gripper: 500,
///     status: MotionStatus::Locked,
/// };
/// assert_eq!(
///     state.to_string(),
///     "joints: +0.00° +90.00° -90.00° +0.00° +0.00° +180.00° (out of range), gripper: 50.0 % open, status: locked"
/// );
/// ```
impl Display for JointState {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        list(f, "joints: ", self.joints.map(Angle))?;
        write!(f, ", gripper: {}, status: {}", Gripper(self.gripper), self.status)
    }
}

impl SelfCheck {
    /// The result as text, for an arm whose kind may be known. Without it, servos 7 to 10 of a leader seem faulty, and
    /// the text says so.
    ///
    /// ```
    /// use armwire::ling::{Kind, SelfCheck};
    ///
    /// let check = SelfCheck(0x03F);
    /// assert_eq!(check.display(Some(Kind::Leader)).to_string(), "all 6 servos normal");
    /// assert_eq!(check.to_string(), "servos not normal: 7, 8, 9, 10 (a leader has none of 7 to 10)");
    /// ```
    pub const fn display(self, kind: Option<Kind>) -> impl Display {
        CheckOf { check: self, kind }
    }
}

/// A self-check of an arm whose kind may be known.
struct CheckOf {
    check: SelfCheck,
    kind: Option<Kind>,
}

impl Display for CheckOf {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let kind = self.kind.unwrap_or(Kind::Follower);
        if self.check.all_normal(kind) {
            return write!(f, "all {} servos normal", kind.servos());
        }
        f.write_str("servos not normal: ")?;
        for (nth, id) in self.check.faulty(kind).enumerate() {
            write!(f, "{}{id}", if nth == 0 { "" } else { ", " })?;
        }
        let may_be_leader = self.check.faulty(kind).filter(|id| (7..=10).contains(id)).count() == 4;
        match self.kind {
            None if may_be_leader => f.write_str(" (a leader has none of 7 to 10)"),
            _ => Ok(()),
        }
    }
}

/// As [`display`](SelfCheck::display) for an arm of unknown kind.
impl Display for SelfCheck {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.display(None).fmt(f)
    }
}

/// A value in thousandths, in its unit.
///
/// ```
/// assert_eq!(armwire::ling::text::Thousandths(-1250).to_string(), "-1.250");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Thousandths(pub i16);

impl Display for Thousandths {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let sign = if self.0 < 0 { "-" } else { "" };
        let value = self.0.unsigned_abs();
        write!(f, "{sign}{}.{:03}", value / 1000, value % 1000)
    }
}

const fn switch(is_on: bool) -> &'static str {
    if is_on { "on" } else { "off" }
}

impl Display for ControlMode {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Position => "position",
            Self::Current => "current",
        })
    }
}

impl Display for ModeResult {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Accepted => "accepted",
            Self::Invalid => "invalid",
            Self::Unsupported => "unsupported or not queued",
        })
    }
}

/// The numbers of the joints, or `none`.
impl Display for JointMask {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            0 => f.write_str("none"),
            _ => list(f, "", (1..=8_u8).filter(|joint| self.has(*joint))),
        }
    }
}

impl Display for Inhibit {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        const REASONS: [(u8, &str); 4] = [
            (Inhibit::NO_TELEOPERATION, "not in teleoperation"),
            (Inhibit::STALE, "link or sample older than 30 ms"),
            (Inhibit::FAULT, "hardware fault"),
            (Inhibit::UNSUPPORTED, "unsupported"),
        ];
        let (mut rest, mut separator) = (self.0, "");
        for (bit, reason) in REASONS {
            if rest & bit != 0 {
                write!(f, "{separator}{reason}")?;
                (rest, separator) = (rest & !bit, "; ");
            }
        }
        match (self.0, rest) {
            (0, _) => f.write_str("none"),
            (_, 0) => Ok(()),
            _ => write!(f, "{separator}unknown {rest:#04x}"),
        }
    }
}

/// For example `requested mode: current, result: accepted`.
impl Display for ModeReply {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "requested mode: {}, result: {}", self.requested(), self.result)
    }
}

impl ModeReply {
    /// The requested mode as text: its number, if there is no such mode.
    pub const fn requested(&self) -> impl Display + use<> {
        RequestedMode(self.requested)
    }
}

struct RequestedMode(u8);

impl Display for RequestedMode {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match ControlMode::from_code(self.0) {
            Ok(mode) => mode.fmt(f),
            Err(_) => write!(f, "{:#04x}", self.0),
        }
    }
}

/// The mode, and the values of joints 1 to 6.
impl Display for ModeState {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            mode, blocked, valid, ..
        } = self;
        write!(f, "mode: {mode}, blocked: {blocked}, valid: {valid}")?;
        let joints = self.joints;
        list(
            f,
            ", residual torques: ",
            joints.map(|joint| Thousandths(joint.residual_torque)),
        )?;
        list(
            f,
            " Nm, requested currents: ",
            joints.map(|joint| Thousandths(joint.requested_current)),
        )?;
        list(
            f,
            " A, output currents: ",
            joints.map(|joint| Thousandths(joint.output_current)),
        )?;
        list(
            f,
            " A, measured currents: ",
            joints.map(|joint| Thousandths(joint.measured_current)),
        )?;
        f.write_str(" A")
    }
}

/// For example `requested: on, effective: off, inhibit: not in teleoperation, …`.
impl Display for ForceFeedback {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let (requested, effective) = (switch(self.is_requested), switch(self.is_effective));
        write!(
            f,
            "requested: {requested}, effective: {effective}, inhibit: {}",
            self.inhibit
        )?;
        let (sync, torque) = (switch(self.is_sync_active), switch(self.is_torque_enabled));
        write!(
            f,
            ", sync: {sync}, torque: {torque}, requested torque: {}",
            switch(self.is_torque_requested)
        )?;
        let Self {
            transition,
            grip,
            requested_mode,
            ..
        } = self;
        write!(
            f,
            ", transition: {transition}, raw grip: {grip}, requested mode: {requested_mode}"
        )
    }
}

/// The names and values of the message, for example `stroke: 50 mm`.
///
/// ```
/// use armwire::ling::{PerServo, Response, Stroke};
///
/// assert_eq!(Response::Stroke(Stroke::Mm50).to_string(), "stroke: 50 mm");
/// let velocities = Response::Velocities(PerServo::Leader([0, 100, 0, 0, 0, 1000]));
/// assert_eq!(velocities.to_string(), "velocities: 0.0 8.8 0.0 0.0 0.0 87.9 °/s");
/// ```
impl Display for Response {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Info(info) => info.fmt(f),
            Self::Stroke(stroke) => write!(f, "stroke: {stroke}"),
            Self::Joints(state) => state.fmt(f),
            Self::Temperatures(celsius) => {
                list(f, "temperatures: ", celsius.as_slice())?;
                f.write_str(" °C")
            }
            Self::Velocities(ticks) => {
                list(f, "velocities: ", ticks.as_slice().iter().map(|&ticks| Velocity(ticks)))?;
                f.write_str(" °/s")
            }
            Self::SelfCheck(check) => write!(f, "self-check: {check}"),
            Self::ModeReply(reply) => reply.fmt(f),
            Self::Mode(state) => state.fmt(f),
            Self::ForceFeedback(state) => state.fmt(f),
        }
    }
}

/// Writes a name, and the values with spaces between.
pub(super) fn list(f: &mut Formatter<'_>, name: &str, values: impl IntoIterator<Item: Display>) -> fmt::Result {
    f.write_str(name)?;
    for (nth, value) in values.into_iter().enumerate() {
        write!(f, "{}{value}", if nth == 0 { "" } else { " " })?;
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::{format, string::ToString};

    use super::*;

    #[test]
    fn every_angle_is_rounded_as_a_float() {
        for ticks in 0..=u16::MAX {
            let degrees = (f64::from(ticks) - 2048.0) * 360.0 / 4096.0;
            let remark = if ticks > 4095 { " (out of range)" } else { "" };
            assert_eq!(Angle(ticks).to_string(), format!("{degrees:+.2}°{remark}"));
        }
    }

    #[test]
    fn every_velocity_is_rounded_as_a_float() {
        for ticks in 0..=u16::MAX {
            let degrees = f64::from(ticks) * 360.0 / 4096.0;
            assert_eq!(Velocity(ticks).to_string(), format!("{degrees:.1}"));
        }
    }
}
