//! The xArm.

use armwire::Config;
use armwire::xarm::{Frame, Raw, Register, Reply, Request, Response, State, TorqueSource, VersionText, XArm};

use super::Arm;
use crate::hex;

impl Arm for XArm {
    const NAME: &'static str = "an xArm";

    const CONFIG: Config = Config::TCP;

    /// Transaction and protocol id.
    const HEADER: usize = 4;

    fn show_request(request: &Request<'_>) -> String {
        match request {
            Request::Heartbeat => "heartbeat".to_owned(),
            Request::ReadVersion => "read version".to_owned(),
            Request::ReadSerials => "read serial numbers".to_owned(),
            Request::ReloadDynamics => "reload dynamics".to_owned(),
            Request::ReadTorqueSource => "read torque source".to_owned(),
            Request::ReadRotationRadius(joint) => format!("read rotation radius of joint {}", joint.number()),
            Request::Shutdown => "shut down".to_owned(),
            Request::Reboot => "reboot".to_owned(),
            Request::Raw(raw) => self::raw(raw),
            other => format!("{other:?}"),
        }
    }

    fn show_response(response: &Response<'_>) -> String {
        match response {
            Response::Heartbeat => "heartbeat".to_owned(),
            Response::Reply { state, reply } => format!("{}, state {state}", self::reply(reply, *state)),
            Response::ModbusRefused { unit, function } => {
                format!("refused: no standard Modbus function {function}, unit {unit}")
            }
            other => format!("{other:?}"),
        }
    }

    fn refusal(response: &Response<'_>) -> Option<String> {
        match response {
            Response::Reply { state, reply } if state.contains(State::INVALID) => Some(format!(
                "the arm refused register {}, or failed at it (state {state})",
                reply.register()
            )),
            _ => None,
        }
    }

    fn envelope(frame: &[u8]) -> String {
        match Frame::parse(frame) {
            Some(Frame {
                transaction,
                protocol: 0,
                ..
            }) => format!(" (transaction {transaction})"),
            Some(Frame {
                transaction,
                protocol: protocol @ (2 | 3),
                ..
            }) => {
                format!(" (transaction {transaction}, protocol id {protocol})")
            }
            _ => String::new(),
        }
    }
}

fn reply(reply: &Reply<'_>, state: State) -> String {
    match reply {
        Reply::Empty(register) => {
            let what = match register {
                _ if state.contains(State::INVALID) => "refused or failed",
                Register::ReloadDynamics | Register::SystemControl => "done",
                _ => "no value",
            };
            format!("register {}, {what}", *register as u8)
        }
        Reply::Version(text) => version(text),
        Reply::Serials(serials) => format!("serial number {serials}"),
        Reply::TorqueSource(source) => format!("torque is {}", torque_source(*source)),
        Reply::RotationRadius(radius) => match radius.metres() {
            Ok(metres) => format!("rotation radius {metres} m"),
            Err(error) => error.to_string(),
        },
        Reply::SystemControl(value) => format!("register 10, value {value}"),
        Reply::Raw(raw) => self::raw(raw),
        other => format!("{other:?}"),
    }
}

fn raw(raw: &Raw<'_>) -> String {
    match raw.params() {
        [] => format!("register {}, no value", raw.register()),
        params => format!("register {}, {}", raw.register(), hex::show(params)),
    }
}

/// A version in words, or as it is if it does not say what a version says.
fn version(text: &VersionText<'_>) -> String {
    match text.version() {
        Ok(version) => format!(
            "{} axes, type {}, arm {}, control box {}, firmware {}",
            version.axes, version.kind, version.arm, version.control_box, version.firmware
        ),
        Err(_) => format!("version {text}"),
    }
}

/// What is reported as torque.
pub(crate) const fn torque_source(source: TorqueSource) -> &'static str {
    match source {
        TorqueSource::Torque => "the joints' torque, computed",
        TorqueSource::Current => "the servos' current, measured",
    }
}
