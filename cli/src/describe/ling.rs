//! The Ling arm.

use armwire::Config;
use armwire::ling::{JointState, Ling, Move, Opening, PerServo, Position, Request, Response, Torque};
use armwire::time::Duration;

use super::{Arm, angle};

impl Arm for Ling {
    const NAME: &'static str = "a Ling arm";

    const CONFIG: Config = Config {
        // The system may be busy, and nobody waits for us but a person.
        latency: Duration::from_millis(50),
        ..Config::DEFAULT
    };

    const HEADER: usize = 3;

    fn show_request(request: &Request) -> String {
        match request {
            Request::ReadInfo => "read information".to_owned(),
            Request::SetZero => "set zero position".to_owned(),
            Request::SetStroke(stroke) => format!("set gripper stroke {} mm", stroke.millimetres()),
            Request::ReadStroke => "read gripper stroke".to_owned(),
            Request::SetTorque(Torque::On) => "torque on".to_owned(),
            Request::SetTorque(Torque::Off) => "torque off".to_owned(),
            Request::ReadJoints => "read joints".to_owned(),
            Request::ReadTemperatures => "read temperatures".to_owned(),
            Request::SetTemperatureLimit(limit) => format!("set temperature limit {} °C", limit.celsius()),
            Request::ReadVelocities => "read velocities".to_owned(),
            Request::Move(target) => format!("move {}", motion(target)),
            Request::SelfCheck => "self-check".to_owned(),
            other => format!("{other:?}"),
        }
    }

    fn show_response(response: &Response) -> String {
        match response {
            Response::Info(info) => format!(
                "serial number {}, hardware {}, firmware {}",
                info.serial, info.hardware, info.firmware
            ),
            Response::Stroke(stroke) => format!("gripper stroke {} mm", stroke.millimetres()),
            Response::Joints(state) => joints(state),
            Response::Temperatures(celsius) => format!("temperatures {} °C", list(celsius)),
            Response::Velocities(speeds) => format!("velocities {} ticks/s", list(speeds)),
            Response::SelfCheck(check) => format!("self-check {:#012b}, servo 1 last, 1 = normal", check.0),
            other => format!("{other:?}"),
        }
    }

    /// A Ling arm never says no.
    fn refusal(_: &Response) -> Option<String> {
        None
    }
}

/// A raw joint position as `+0.7854 rad  +45.00°`, if it is one.
pub(crate) fn joint(ticks: u16) -> String {
    match Position::new(ticks).map(Position::radians) {
        Ok(radians) => angle(radians),
        Err(_) => format!("{ticks} ticks (out of range)"),
    }
}

/// A raw gripper opening as `25.0 % open`, if it is one.
pub(crate) fn gripper(per_mille: u16) -> String {
    match Opening::new(per_mille) {
        Ok(opening) => format!("{:.1} % open", 100.0 * opening.fraction()),
        Err(_) => format!("{per_mille} ‰ (out of range)"),
    }
}

/// A raw joint position as an angle in degrees, if it is one.
pub(super) fn degrees(ticks: u16) -> String {
    match Position::new(ticks) {
        Ok(position) => format!("{:+.2}°", position.radians().to_degrees()),
        Err(_) => format!("{ticks} (out of range)"),
    }
}

/// Readings with a space between.
pub(crate) fn list<T: ToString>(readings: &PerServo<T>) -> String {
    let readings: Vec<_> = readings.as_slice().iter().map(T::to_string).collect();
    readings.join(" ")
}

fn motion(target: &Move) -> String {
    let joints = target
        .joints
        .map(|(position, speed)| format!("{} at {}", degrees(position.ticks()), speed.ticks_per_second()));
    let (opening, speed) = target.gripper;
    format!(
        "{}, gripper {} ‰ at {} ticks/s",
        joints.join(" "),
        opening.per_mille(),
        speed.0
    )
}

fn joints(state: &JointState) -> String {
    let JointState {
        joints,
        gripper,
        status,
    } = state;
    format!(
        "joints {}, gripper {gripper} ‰, {status}",
        joints.map(degrees).join(" ")
    )
}
