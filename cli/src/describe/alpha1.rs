//! The Alpha1.

use std::num::NonZeroU32;
use std::time::Duration;

use armwire::alpha1::{
    Action, Address, Alpha1, Angle, FirmwareVersion, OffsetTool, Outcome, Request, Response, ServoRequest,
    ServoResponse, ServoStates, UsbType,
};
use armwire::{Config, time};

use super::Arm;
use crate::hex;

impl Arm for Alpha1 {
    const NAME: &'static str = "an Alpha1";

    const CONFIG: Config = Config {
        baud: NonZeroU32::new(115_200).unwrap(),
        // The system may be busy, or there is Bluetooth between, and what moves is not asked for twice.
        latency: time::Duration::from_millis(250),
        ..Config::DEFAULT
    };

    /// The two bytes of the header.
    const HEADER: usize = 2;

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

    fn show_response(response: &Response<'_>) -> String {
        match response {
            Response::HardwareVersion(version) => format!("hardware version {version}"),
            Response::ServoStates(states) => format!("servos that run: {}", running(*states)),
            Response::Stopped(outcome) => format!("stop: {}", self::outcome(*outcome)),
            Response::FirmwareVersion(FirmwareVersion { outcome, text }) => {
                let (text, outcome) = (text.escape_ascii(), self::outcome(*outcome));
                format!("firmware version {text}: {outcome}")
            }
            Response::Acted(outcome) => format!("act: {}", self::outcome(*outcome)),
            Response::OffsetTool(outcome) => format!("offset tool: {}", self::outcome(*outcome)),
            Response::UsbType(outcome) => format!("USB type: {}", self::outcome(*outcome)),
            Response::Playing(outcome) => format!("play: {}", self::outcome(*outcome)),
            Response::Servo(response) => servo_response(response),
            other => format!("{other:?}"),
        }
    }

    fn refusal(response: &Response<'_>) -> Option<String> {
        let (who, outcome) = match response {
            Response::Stopped(outcome)
            | Response::FirmwareVersion(FirmwareVersion { outcome, .. })
            | Response::Acted(outcome)
            | Response::OffsetTool(outcome)
            | Response::UsbType(outcome)
            | Response::Playing(outcome) => ("the robot".to_owned(), outcome),
            Response::Servo(
                ServoResponse::Angles { servo, outcome, .. }
                | ServoResponse::IdChanged { servo, outcome, .. }
                | ServoResponse::OffsetSet { servo, outcome }
                | ServoResponse::Offset { servo, outcome, .. }
                | ServoResponse::Version { servo, outcome, .. },
            ) => (format!("servo {}", servo.get()), outcome),
            _ => return None,
        };
        (!outcome.is_success()).then(|| format!("{who} answers that it failed, not why"))
    }
}

const fn outcome(outcome: Outcome) -> &'static str {
    match outcome {
        Outcome::Success => "done",
        Outcome::Failure => "failed",
    }
}

/// The numbers of the servos that run.
pub(crate) fn running(states: ServoStates) -> String {
    let numbers: Vec<_> = states.running().map(|number| number.to_string()).collect();
    match numbers.as_slice() {
        [] => "none".to_owned(),
        numbers => numbers.join(" "),
    }
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

fn servo_response(response: &ServoResponse) -> String {
    let (servo, outcome, what) = match response {
        ServoResponse::Acknowledged(servo) => (servo, &Outcome::Success, "understood".to_owned()),
        ServoResponse::Angles {
            servo,
            outcome,
            target,
            actual,
        } => (servo, outcome, format!("released, at {actual}°, sent to {target}°")),
        ServoResponse::IdChanged { servo, outcome, was } => (servo, outcome, format!("was {was}")),
        ServoResponse::OffsetSet { servo, outcome } => (servo, outcome, "offset set".to_owned()),
        ServoResponse::Offset { servo, outcome, thirds } => {
            (servo, outcome, format!("offset {:+.2}°", f32::from(*thirds) / 3.0))
        }
        ServoResponse::Version {
            servo,
            outcome,
            version,
        } => (servo, outcome, format!("version {}", hex::show(version))),
        other => return format!("{other:?}"),
    };
    match outcome {
        Outcome::Success => format!("servo {}: {what}", servo.get()),
        Outcome::Failure => format!("servo {}: failed", servo.get()),
    }
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
