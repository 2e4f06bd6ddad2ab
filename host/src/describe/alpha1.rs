//! The Alpha1.

use std::num::NonZeroU32;

use armwire::alpha1::{Alpha1, INSTALLED, Outcome, Request, Response, ServoResponse, ServoStates};
use armwire::{Config, time};
use serde_json::{Value, json};

use super::arm::{Arm, Protocol};
use super::fact::{Fact, number};
use super::printable::hex;

impl Arm for Alpha1 {
    const PROTOCOL: Protocol = Protocol::Alpha1;

    const NAME: &'static str = "an Alpha1";

    const OTHER: (&'static str, Protocol) = ("a Ling arm", Protocol::Ling);

    const CONFIG: Config = Config {
        baud: NonZeroU32::new(115_200),
        // The system may be busy, or there is Bluetooth between, and motion is not requested twice.
        latency: time::Duration::from_millis(250),
        ..Config::DEFAULT
    };

    const ON_HID: bool = true;

    /// The two bytes of the header.
    const HEADER: usize = 2;

    fn info() -> Vec<Request<'static>> {
        vec![
            Request::ReadHardwareVersion,
            Request::ReadFirmwareVersion,
            Request::ReadServoStates,
        ]
    }

    fn facts(response: &Response<'_>) -> Vec<Fact> {
        vec![match response {
            Response::HardwareVersion(version) => {
                return vec![Fact::words("arm", "Alpha1"), Fact::words("hardware", version)];
            }
            Response::ServoStates(states) => running(*states),
            Response::FirmwareVersion(version) => Fact::words("firmware", version),
            Response::Stopped(outcome) => done("stop", *outcome),
            Response::Acted(outcome) => done("act", *outcome),
            Response::OffsetTool(outcome) => done("offset tool", *outcome),
            Response::UsbType(outcome) => done("USB type", *outcome),
            Response::Playing(outcome) => done("play", *outcome),
            Response::Servo(response) => servo_response(response),
            other => Fact::words("message", other),
        }]
    }

    fn refusal(response: &Response<'_>) -> Option<String> {
        let who = match response {
            Response::Servo(response) => response.outcome().0.to_string(),
            _ => "the robot".to_owned(),
        };
        (response.outcome() == Some(Outcome::Failure)).then(|| format!("{who} reported failure without a reason"))
    }
}

fn done(what: &str, outcome: Outcome) -> Fact {
    Fact::words(what, outcome)
}

/// The numbers of the servos that run: a value for each bit of the answer. The bit of a servo that is not there is that of
/// one that is powered off: it has no value if an Alpha1 does not have this servo.
fn running(states: ServoStates) -> Fact {
    let each = (0..u32::BITS as usize).map(|i| match states.bits() >> i & 1 {
        1 => (json!(1), "runs".to_owned()),
        _ if i < INSTALLED => (json!(0), "off".to_owned()),
        _ => (Value::Null, "-".to_owned()),
    });
    let fact = Fact::each(("servos that run", "servo"), "runs", "", each);
    Fact {
        text: states.to_string(),
        ..fact
    }
}

fn servo_response(response: &ServoResponse) -> Fact {
    let (servo, outcome) = response.outcome();
    let mut values = vec![("servo", json!(servo.get()))];
    match response {
        _ if !outcome.is_success() => {}
        ServoResponse::Angles { target, actual, .. } => {
            values.extend([("actual_degrees", json!(actual)), ("target_degrees", json!(target))]);
        }
        ServoResponse::IdChanged { was, .. } => values.push(("was", json!(was))),
        ServoResponse::Offset { thirds, .. } => {
            values.push(("offset_degrees", number(f64::from(*thirds) / 3.0)));
        }
        ServoResponse::Version { version, .. } => values.push(("version", json!(hex(version)))),
        _ => {}
    }
    Fact::of(&servo.to_string(), response.values(), values)
}
