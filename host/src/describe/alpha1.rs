//! The Alpha1.

use std::num::NonZeroU32;
use std::time::Duration;

use armwire::alpha1::{
    Action, Address, Alpha1, Angle, FirmwareVersion, OLDEST_FIRMWARE, OffsetTool, Outcome, Request, Response, SERVOS,
    ServoId, ServoRequest, ServoResponse, ServoStates, UsbType,
};
use armwire::{Config, time};
use serde_json::{Value, json};

use super::arm::{Arm, Protocol};
use super::fact::{Fact, number};
use crate::hex;

impl Arm for Alpha1 {
    const PROTOCOL: Protocol = Protocol::Alpha1;

    const NAME: &'static str = "an Alpha1";

    const OTHER: &'static str = "a Ling arm ('ling' instead of 'alpha1')";

    const CONFIG: Config = Config {
        baud: NonZeroU32::new(115_200).unwrap(),
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

    fn show_request(request: &Request<'_>) -> String {
        match request {
            Request::ReadHardwareVersion => "read hardware version".to_owned(),
            Request::ReadServoStates => "read servo states".to_owned(),
            Request::Stop => "stop".to_owned(),
            Request::ReadFirmwareVersion => "read firmware version".to_owned(),
            Request::Act(action) => format!("act {}", act(action)),
            Request::SetOffsetTool(OffsetTool::Connect) => "connect the offset tool".to_owned(),
            Request::SetOffsetTool(OffsetTool::Disconnect) => "disconnect the offset tool".to_owned(),
            Request::SetUsbType(UsbType::Disk) => "be a disk on USB".to_owned(),
            Request::SetUsbType(UsbType::SerialPort) => "be a serial port on USB".to_owned(),
            Request::SetUsbType(UsbType::Hid) => "be a HID device on USB".to_owned(),
            Request::Play(name) => format!("play '{name}'"),
            Request::Servo(request) => servo_request(request),
            other => format!("{other:?}"),
        }
    }

    fn facts(response: &Response<'_>) -> Vec<Fact> {
        vec![match response {
            Response::HardwareVersion(version) => {
                return vec![Fact::words("arm", "Alpha1"), Fact::words("hardware", version)];
            }
            Response::ServoStates(states) => running(*states),
            Response::FirmwareVersion(version) => firmware(version),
            Response::Stopped(outcome) => done("stop", *outcome),
            Response::Acted(outcome) => done("act", *outcome),
            Response::OffsetTool(outcome) => done("offset tool", *outcome),
            Response::UsbType(outcome) => done("USB type", *outcome),
            Response::Playing(outcome) => done("play", *outcome),
            Response::Servo(response) => servo_response(response),
            other => Fact::words("message", format_args!("{other:?}")),
        }]
    }

    fn refusal(response: &Response<'_>) -> Option<String> {
        let (who, outcome) = match response {
            Response::Stopped(outcome)
            | Response::FirmwareVersion(FirmwareVersion { outcome, .. })
            | Response::Acted(outcome)
            | Response::OffsetTool(outcome)
            | Response::UsbType(outcome)
            | Response::Playing(outcome) => ("the robot".to_owned(), *outcome),
            Response::Servo(response) => {
                let (servo, outcome) = servo_outcome(response)?;
                (format!("servo {}", servo.get()), outcome)
            }
            _ => return None,
        };
        (!outcome.is_success()).then(|| format!("{who} reported failure without a reason"))
    }
}

fn done(what: &str, outcome: Outcome) -> Fact {
    Fact::words(what, if outcome.is_success() { "done" } else { "failed" })
}

fn firmware(version: &FirmwareVersion) -> Fact {
    let (text, oldest) = (version.text.escape_ascii(), OLDEST_FIRMWARE.escape_ascii());
    match version.outcome {
        Outcome::Failure => Fact::words("firmware", "not reported, the robot failed"),
        Outcome::Success if version.text < OLDEST_FIRMWARE => Fact::words(
            "firmware",
            format_args!("{text}, before {oldest}, the first for this protocol"),
        ),
        Outcome::Success => Fact::words("firmware", text),
    }
}

/// The numbers of the servos that run.
fn running(states: ServoStates) -> Fact {
    let numbers: Vec<_> = states.running().map(|number| number.to_string()).collect();
    let text = match numbers.as_slice() {
        [] => "none".to_owned(),
        numbers => numbers.join(" "),
    };
    let each = (1..=SERVOS as u8).map(|n| match states.running().any(|servo| servo == n) {
        true => (json!(1), "runs".to_owned()),
        false => (json!(0), "-".to_owned()),
    });
    let fact = Fact::each(("servos that run", "servo"), "runs", "", each);
    Fact { text, ..fact }
}

fn angle(angle: Angle) -> String {
    match angle.degrees() {
        Some(degrees) => format!("{degrees}°"),
        None => format!("{} (out of range)", angle.raw()),
    }
}

fn seconds(duration: Duration) -> String {
    format!("{} s", duration.as_secs_f64())
}

fn act(action: &Action) -> String {
    let angles = action.angles.map(|target| target.map_or("-".to_owned(), angle));
    format!(
        "{} in {}, next after {}",
        angles.join(" "),
        seconds(action.time.duration()),
        seconds(action.interval.duration())
    )
}

fn address(address: Address) -> String {
    match address {
        Address::All => "all servos".to_owned(),
        Address::One(servo) => format!("servo {}", servo.get()),
    }
}

fn servo_request(request: &ServoRequest) -> String {
    match request {
        ServoRequest::Move { to, angle, time, lock } => format!(
            "move {} to {} in {}, completion time {}",
            address(*to),
            self::angle(*angle),
            seconds(time.duration()),
            seconds(lock.duration())
        ),
        ServoRequest::Release(to) => format!("release {}", address(*to)),
        ServoRequest::SetLed { to, led } => format!("light of {} to {}", address(*to), led.0),
        ServoRequest::ReadAngles(servo) => format!("read angles of servo {}, and release it", servo.get()),
        ServoRequest::ChangeId { from, to } => format!("change id of servo {} to {}", from.get(), to.get()),
        ServoRequest::SetOffset(servo, offset) => {
            format!("set offset of servo {} to {:+.2}°", servo.get(), offset.degrees())
        }
        ServoRequest::ReadOffset(servo) => format!("read offset of servo {}", servo.get()),
        ServoRequest::ReadVersion(servo) => format!("read version of servo {}", servo.get()),
        other => format!("{other:?}"),
    }
}

/// The servo that answers, and its result.
fn servo_outcome(response: &ServoResponse) -> Option<(ServoId, Outcome)> {
    match *response {
        ServoResponse::Acknowledged(servo) => Some((servo, Outcome::Success)),
        ServoResponse::Angles { servo, outcome, .. }
        | ServoResponse::IdChanged { servo, outcome, .. }
        | ServoResponse::OffsetSet { servo, outcome }
        | ServoResponse::Offset { servo, outcome, .. }
        | ServoResponse::Version { servo, outcome, .. } => Some((servo, outcome)),
        _ => None,
    }
}

fn servo_response(response: &ServoResponse) -> Fact {
    let Some((servo, outcome)) = servo_outcome(response) else {
        return Fact::words("message", format_args!("{response:?}"));
    };
    let mut values = vec![("servo", json!(servo.get()))];
    let text = match response {
        _ if !outcome.is_success() => "failed".to_owned(),
        ServoResponse::Angles { target, actual, .. } => {
            values.extend([("actual_degrees", json!(actual)), ("target_degrees", json!(target))]);
            format!("released, at {actual}°, sent to {target}°")
        }
        ServoResponse::IdChanged { was, .. } => {
            values.push(("was", json!(was)));
            format!("was {was}")
        }
        ServoResponse::Offset { thirds, .. } => {
            let degrees = f64::from(*thirds) / 3.0;
            values.push(("offset_degrees", number(degrees)));
            format!("offset {degrees:+.2}°")
        }
        ServoResponse::Version { version, .. } => {
            let version = hex::show(version);
            values.push(("version", Value::from(version.as_str())));
            format!("version {version}")
        }
        ServoResponse::OffsetSet { .. } => "offset set".to_owned(),
        _ => "understood".to_owned(),
    };
    Fact::of(&format!("servo {}", servo.get()), text, values)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn times_are_in_seconds() {
        for (millis, text) in [(0, "0 s"), (20, "0.02 s"), (1_000, "1 s"), (1_310_700, "1310.7 s")] {
            assert_eq!(seconds(Duration::from_millis(millis)), text);
        }
    }
}
