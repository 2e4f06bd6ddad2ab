//! The Ling arm.

use armwire::Config;
use armwire::ling::{
    JOINTS, JointState, Kind, Ling, Move, Opening, Position, Request, Response, SelfCheck, TICKS_PER_TURN, Torque,
};
use armwire::time::Duration;
use serde_json::Value;

use super::arm::{Arm, Protocol};
use super::fact::{Fact, number};

impl Arm for Ling {
    const PROTOCOL: Protocol = Protocol::Ling;

    const NAME: &'static str = "a Ling arm";

    const OTHER: &'static str = "an Alpha1 ('alpha1' instead of 'ling')";

    const CONFIG: Config = Config {
        // The system may be busy, and only a person waits for the answer.
        latency: Duration::from_millis(50),
        ..Config::DEFAULT
    };

    const HEADER: usize = 3;

    fn info() -> Vec<Request> {
        vec![
            Request::ReadInfo,
            Request::ReadJoints,
            Request::ReadStroke,
            Request::ReadTemperatures,
            Request::ReadVelocities,
            Request::SelfCheck,
        ]
    }

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

    fn facts(response: &Response) -> Vec<Fact> {
        vec![match response {
            Response::Info(info) => {
                let arm = match info.serial.kind() {
                    Some(Kind::Leader) => "Ling leader",
                    Some(Kind::Follower) => "Ling follower",
                    None => "Ling, of unknown kind",
                };
                return vec![
                    Fact::words("arm", arm),
                    Fact::words("serial", info.serial),
                    Fact::words("hardware", info.hardware),
                    Fact::words("firmware", info.firmware),
                ];
            }
            Response::Joints(state) => return joint_state(state),
            Response::Stroke(stroke) => {
                let mm = stroke.millimetres();
                Fact::new("stroke", "stroke_mm", mm, format_args!("{mm} mm"))
            }
            Response::Temperatures(celsius) => {
                let celsius = celsius.as_slice().iter();
                let celsius = celsius.map(|&celsius| (celsius.into(), celsius.to_string()));
                Fact::each(("temperatures", "temperature"), "celsius", " °C", celsius)
            }
            Response::Velocities(speeds) => {
                let speeds = speeds.as_slice().iter().map(|&ticks| degrees(ticks.into()));
                let speeds = speeds.map(|degrees| (number(degrees.to_radians()), format!("{degrees:.1}")));
                Fact::each(("velocities", "velocity"), "rad_per_s", " °/s", speeds)
            }
            Response::SelfCheck(check) => self_check(*check, None),
            other => Fact::words("message", format_args!("{other:?}")),
        }]
    }

    /// The number of temperatures is the number of servos in a self-check.
    fn facts_after(known: &[Fact], response: &Response) -> Vec<Fact> {
        let servos = known
            .iter()
            .find(|fact| fact.name == "temperatures")
            .map(|fact| fact.items.len());
        let mut kinds = [Kind::Leader, Kind::Follower].into_iter();
        let kind = kinds.find(|kind| Some(kind.servos()) == servos);
        match response {
            Response::SelfCheck(check) => vec![self_check(*check, kind)],
            response => Self::facts(response),
        }
    }
}

fn joint_state(state: &JointState) -> Vec<Fact> {
    let opening = Opening::new(state.gripper);
    let percent = f64::from(state.gripper) / 10.0;
    let value = opening.map_or(Value::Null, |_| number(percent));
    let what = if opening.is_ok() { "open" } else { "(out of range)" };
    let text = format!("{percent:.1} % {what}");
    vec![
        joints(state.joints),
        Fact::new("gripper", "gripper_percent", value, text),
        Fact::words("status", state.status),
    ]
}

/// Raw joint positions: radians for programs, degrees for people.
pub(super) fn joints(ticks: [u16; JOINTS]) -> Fact {
    let joints = ticks.map(|ticks| match Position::new(ticks) {
        Ok(position) => (number(position.radians().into()), angle(ticks)),
        Err(_) => (Value::Null, format!("{} (out of range)", angle(ticks))),
    });
    Fact::each(("joints", "joint"), "rad", "", joints)
}

/// The servos in a normal state, of an arm whose type may be known.
fn self_check(check: SelfCheck, kind: Option<Kind>) -> Fact {
    let servos = kind.unwrap_or(Kind::Follower).servos();
    let faulty: Vec<_> = check.faulty(kind.unwrap_or(Kind::Follower)).collect();
    let numbers: Vec<_> = faulty.iter().map(u8::to_string).collect();
    let mut text = match faulty.as_slice() {
        [] => format!("all {servos} servos normal"),
        _ => format!("servos not normal: {}", numbers.join(", ")),
    };
    if kind.is_none() && faulty.ends_with(&[7, 8, 9, 10]) {
        text += " (a leader has none of 7 to 10)";
    }
    let is_normal = |id| match faulty.contains(&id) {
        // A leader may lack this servo.
        true if kind.is_none() && usize::from(id) > Kind::Leader.servos() => Value::Null,
        is_faulty => Value::from(!is_faulty),
    };
    let normal = (1..=servos as u8).map(|id| (is_normal(id), String::new()));
    let fact = Fact::each(("self-check", "servo"), "is_normal", "", normal);
    Fact { text, ..fact }
}

fn motion(target: &Move) -> String {
    let joints = target.joints.map(|(position, speed)| {
        let speed = degrees(speed.ticks_per_second().into());
        format!("{} at {speed:.1}°/s", angle(position.ticks()))
    });
    let (opening, speed) = target.gripper;
    let percent = f64::from(opening.per_mille()) / 10.0;
    format!("{}, gripper {percent:.1} % at {} ticks/s", joints.join(" "), speed.0)
}

/// A raw joint position as an angle.
fn angle(ticks: u16) -> String {
    format!(
        "{:+.2}°",
        degrees(f64::from(ticks) - f64::from(Position::CENTRE.ticks()))
    )
}

fn degrees(ticks: f64) -> f64 {
    ticks * 360.0 / f64::from(TICKS_PER_TURN)
}
