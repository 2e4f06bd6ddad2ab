//! The xArm.

use armwire::Config;
use armwire::xarm::{Codes, Frame, Raw, Register, Reply, Request, Response, State, VersionText, XArm};
use serde_json::{Value, json};

use super::arm::{Arm, Protocol};
use super::fact::{Fact, number};
use super::printable::hex;

/// The register of joint positions, which the document does not have. It is read as the vendor's package does: seven
/// little-endian floating-point numbers in radians, of which an arm with fewer axes uses the first.
pub const POSITIONS: u8 = 42;
/// Number of joint positions in a message, for every model.
pub const JOINTS: usize = 7;

impl Arm for XArm {
    const PROTOCOL: Protocol = Protocol::Xarm;

    const NAME: &'static str = "an xArm";

    const OTHER: (&'static str, Protocol) = ("an arm on a serial port", Protocol::Ling);

    const CONFIG: Config = Config::TCP;

    /// Transaction and protocol id.
    const HEADER: usize = 4;

    fn info() -> Vec<Request<'static>> {
        vec![
            Request::ReadVersion,
            Request::ReadSerials,
            Request::ReadTorqueSource,
            Codes::READ,
        ]
    }

    /// The facts in a reply, and the state. A refusal of a register with a type has no value.
    fn facts(response: &Response<'_>) -> Vec<Fact> {
        match response {
            Response::Heartbeat => vec![Fact::words("heartbeat", "")],
            Response::Reply { state, reply } => {
                if let Some(register) = Register::from_code(reply.register()).filter(|_| state.contains(State::INVALID))
                {
                    let text = format!("not reported (state {state})");
                    return vec![Fact::words(&register.to_string(), text)];
                }
                let mut facts = self::reply(reply);
                facts.push(Fact::words("state", state));
                facts
            }
            Response::ModbusRefused { unit, function } => {
                let text = format!("no standard Modbus function {function}, unit {unit}");
                vec![Fact::words("refused", text)]
            }
            other => vec![Fact::words("message", other)],
        }
    }

    /// The codes of register 15 have a line each.
    fn facts_after(_known: &[Fact], response: &Response<'_>) -> Vec<Fact> {
        match response {
            Response::Reply { state, reply } if reply.register() == Codes::REGISTER => {
                let mut facts = codes(codes_in(response));
                if !state.contains(State::INVALID) {
                    facts.push(Fact::words("state", state));
                }
                facts
            }
            _ => Self::facts(response),
        }
    }

    fn follow_up(response: &Response<'_>) -> Option<Request<'static>> {
        match response {
            Response::Reply { state, reply } => {
                let is_explained = state.contains(State::INVALID) || state.has_codes();
                (is_explained && reply.register() != Codes::REGISTER).then_some(Codes::READ)
            }
            _ => None,
        }
    }

    fn explanation(response: &Response<'_>) -> Vec<Fact> {
        codes_in(response).map_or(Vec::new(), |known| codes(Some(known)))
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

fn reply(reply: &Reply<'_>) -> Vec<Fact> {
    vec![match reply {
        Reply::Empty(register) => {
            let name = &register.to_string();
            match register {
                Register::ReloadDynamics | Register::SystemControl => Fact::words(name, "done"),
                _ => Fact::words(name, "no value"),
            }
        }
        Reply::Version(text) => return version(text),
        Reply::Serials(serials) => {
            let values = [
                ("serial", json!(serials.arm())),
                ("control_box_serial", json!(serials.control_box())),
            ];
            Fact::of("serial", serials, values)
        }
        Reply::TorqueSource(source) => Fact::words("torque", source),
        Reply::RotationRadius(radius) => {
            let value = radius.metres().map_or(Value::Null, |metres| number(metres.into()));
            Fact::new("rotation radius", "rotation_radius_m", value, radius)
        }
        Reply::SystemControl(value) => Fact::words("system control", format_args!("value {value}")),
        Reply::Raw(raw) => return vec![self::raw(raw, reply)],
        other => Fact::words("message", other),
    }]
}

/// The parameters of a register without a type of its own, and the codes of register 15.
fn raw(raw: &Raw<'_>, reply: &Reply<'_>) -> Fact {
    let name = format!("register {}", raw.register());
    let key = name.replace(' ', "_");
    let values = json!(raw.values().to_string());
    match Codes::try_from(*reply) {
        Ok(codes) => Fact::of(
            &name,
            format_args!("{} ({codes})", raw.values()),
            [
                (key.as_str(), values),
                ("error", json!(codes.error.0)),
                ("warning", json!(codes.warning.0)),
            ],
        ),
        Err(_) => Fact::new(&name, &key, values, raw.values()),
    }
}

fn codes_in(response: &Response<'_>) -> Option<Codes> {
    match response {
        Response::Reply { state, reply } if !state.contains(State::INVALID) => Codes::try_from(*reply).ok(),
        _ => None,
    }
}

/// The error and the warning of an arm, each with its number and its meaning. Null if they are unknown.
pub fn codes(codes: Option<Codes>) -> Vec<Fact> {
    let fact = |name, known: Option<(u8, Option<&str>, String)>| {
        let (number, meaning, text) = match known {
            Some((number, meaning, text)) => (json!(number), json!(meaning), text),
            None => (Value::Null, Value::Null, "not reported".to_owned()),
        };
        Fact::of(name, text, [(name, number), (&format!("{name}_meaning"), meaning)])
    };
    let error = codes.map(|Codes { error, .. }| (error.0, error.meaning(), error.to_string()));
    let warning = codes.map(|Codes { warning, .. }| (warning.0, warning.meaning(), warning.to_string()));
    vec![fact("error", error), fact("warning", warning)]
}

/// A version in words, or unchanged if it cannot be parsed.
fn version(text: &VersionText<'_>) -> Vec<Fact> {
    match text.version() {
        Ok(version) => {
            let what = format!("xArm, {} axes, type {}", version.axes, version.kind);
            let values = [
                ("arm", json!("xArm")),
                ("axes", json!(version.axes)),
                ("type", json!(version.kind)),
            ];
            vec![
                Fact::of("arm", what, values),
                Fact::words("hardware", version.arm),
                Fact::words("control box", version.control_box),
                Fact::words("firmware", version.firmware),
            ]
        }
        Err(error) => vec![
            Fact::words("arm", "xArm"),
            Fact::words("version", format_args!("{text} ({error})")),
        ],
    }
}

/// The positions in the parameters of the register of [positions](POSITIONS), in radians. `None` for any other number.
pub(crate) fn positions_in(params: &[u8]) -> Option<[f32; JOINTS]> {
    let (positions, []) = params.as_chunks() else {
        return None;
    };
    Some(<[[u8; 4]; JOINTS]>::try_from(positions).ok()?.map(f32::from_le_bytes))
}

/// The joints of an arm with so many axes, if known, and its state, from the register of [positions](POSITIONS).
pub fn positions(state: State, params: &[u8], axes: Option<usize>) -> Vec<Fact> {
    let known = positions_in(params).filter(|_| axes.is_some());
    let joints = (0..axes.unwrap_or(JOINTS).min(JOINTS)).map(|joint| match known {
        Some(positions) => {
            let radians: f32 = positions[joint];
            (
                number(f64::from(radians).to_degrees()),
                format!("{:+.2}°", radians.to_degrees()),
            )
        }
        None => (Value::Null, "not reported".to_owned()),
    });
    let mut joints = Fact::each(("joints", "joint"), "deg", "", joints);
    if known.is_none() {
        joints.text = match params {
            [] => format!("register {POSITIONS} not reported"),
            params => format!("register {POSITIONS} {}", hex(params)),
        };
    }
    vec![joints, Fact::words("state", state)]
}
