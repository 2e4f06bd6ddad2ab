//! Messages and their values as text.
//!
//! Texts from the arm are escaped.

use core::fmt::{self, Display, Formatter};

use super::{
    Codes, Joint, Raw, Register, Reply, Request, Response, RotationRadius, State, TorqueSource, Version, VersionText,
};
use crate::hex::Hex;
use crate::named::Named;

/// For example `joint 6`.
impl Display for Joint {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "joint {}", self.number())
    }
}

/// The name of its value, for example `rotation radius`.
impl Display for Register {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Version => "version",
            Self::Serials => "serial",
            Self::ReloadDynamics => "reload dynamics",
            Self::TorqueSource => "torque",
            Self::RotationRadius => "rotation radius",
            Self::SystemControl => "system control",
        })
    }
}

impl Display for TorqueSource {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Torque => "the joints' torque, computed",
            Self::Current => "the servos' current, measured",
        })
    }
}

/// Metres, for example `0.076 m`, or the error of a radius that is out of range.
impl Display for RotationRadius {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.metres() {
            Ok(_) => {
                // A float has no more digits of an arm's length.
                let micrometres = (f64::from(self.millimetres) * 1e3 + 0.5) as u64;
                write!(f, "{} m", micrometres as f64 / 1e6)
            }
            Err(error) => error.fmt(f),
        }
    }
}

impl Raw<'_> {
    /// The parameters as text, without the register: `AA 06`, or `no value`.
    ///
    /// ```
    /// use armwire::xarm::Raw;
    ///
    /// assert_eq!(Raw::new(19, &[0xAA, 0x06])?.values().to_string(), "AA 06");
    /// assert_eq!(Raw::new(19, &[])?.values().to_string(), "no value");
    /// # Ok::<(), armwire::xarm::RawError>(())
    /// ```
    pub const fn values(&self) -> impl Display {
        Values(self.params())
    }
}

/// Parameters of an undocumented register.
struct Values<'a>(&'a [u8]);

impl Display for Values<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self.0 {
            [] => f.write_str("no value"),
            params => Hex(params).fmt(f),
        }
    }
}

/// For example `read rotation radius of joint 6`.
///
/// ```
/// use armwire::xarm::{Raw, Request};
///
/// assert_eq!(Request::Shutdown.to_string(), "shut down");
/// assert_eq!(Request::Raw(Raw::new(19, &[1])?).to_string(), "register 19, 01");
/// # Ok::<(), armwire::xarm::RawError>(())
/// ```
impl Display for Request<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Heartbeat => f.write_str("heartbeat"),
            Self::ReadVersion => f.write_str("read version"),
            Self::ReadSerials => f.write_str("read serial numbers"),
            Self::ReloadDynamics => f.write_str("reload dynamics"),
            Self::ReadTorqueSource => f.write_str("read torque source"),
            Self::ReadRotationRadius(joint) => write!(f, "read rotation radius of {joint}"),
            Self::Shutdown => f.write_str("shut down"),
            Self::Reboot => f.write_str("reboot"),
            Self::Raw(raw) => write!(f, "register {}, {}", raw.register(), raw.values()),
        }
    }
}

/// The kind of the arm and its versions, for example
/// `arm: xArm, 6 axes, type 6, hardware: XI1202, control box: AC1302, firmware: v1.12.10`.
impl Display for Version<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        let Self {
            axes,
            kind,
            arm,
            control_box,
            firmware,
        } = self;
        let hardware = Named("hardware", arm.as_bytes());
        let control_box = Named("control box", control_box.as_bytes());
        let firmware = Named("firmware", firmware.as_bytes());
        write!(
            f,
            "arm: xArm, {axes} axes, type {kind}, {hardware}, {control_box}, {firmware}"
        )
    }
}

/// The name and value, for example `rotation radius: 0.25 m`. Register 15 has the meaning of its codes.
impl Display for Reply<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Empty(register @ (Register::ReloadDynamics | Register::SystemControl)) => {
                write!(f, "{register}: done")
            }
            Self::Empty(register) => write!(f, "{register}: no value"),
            Self::Version(text) => version(f, *text),
            Self::Serials(serials) => write!(f, "serial: {serials}"),
            Self::TorqueSource(source) => write!(f, "torque: {source}"),
            Self::RotationRadius(radius) => write!(f, "rotation radius: {radius}"),
            Self::SystemControl(value) => write!(f, "system control: value {value}"),
            Self::Raw(raw) => {
                write!(f, "register {}: {}", raw.register(), raw.values())?;
                Codes::of(raw).map_or(Ok(()), |codes| write!(f, " ({codes})"))
            }
        }
    }
}

/// Writes a version, or its text and the reason why it is none.
fn version(f: &mut Formatter<'_>, text: VersionText<'_>) -> fmt::Result {
    match text.version() {
        Ok(version) => version.fmt(f),
        Err(error) => write!(f, "arm: xArm, version: {text} ({error})"),
    }
}

/// The name and value, and the state of the arm. A refusal of a register with a type has no value, whatever its
/// parameters are.
///
/// ```
/// use armwire::xarm::{Register, Reply, Response, State, TorqueSource};
///
/// let reply = Reply::TorqueSource(TorqueSource::Current);
/// let response = Response::Reply { state: State::OK, reply };
/// assert_eq!(response.to_string(), "torque: the servos' current, measured, state: ok");
/// let response = Response::Reply { state: State::INVALID, reply: Reply::Empty(Register::Version) };
/// assert_eq!(response.to_string(), "version: not reported (state invalid)");
/// ```
impl Display for Response<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        match self {
            Self::Heartbeat => f.write_str("heartbeat"),
            Self::Reply { state, reply } => match Register::from_code(reply.register()) {
                Some(register) if state.contains(State::INVALID) => {
                    write!(f, "{register}: not reported (state {state})")
                }
                _ => write!(f, "{reply}, state: {state}"),
            },
            Self::ModbusRefused { unit, function } => {
                write!(f, "refused: no standard Modbus function {function}, unit {unit}")
            }
        }
    }
}
