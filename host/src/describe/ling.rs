//! The Ling arm.

use armwire::Config;
use armwire::ling::text::{Angle, Gripper, Thousandths, Velocity};
use armwire::ling::{
    ForceFeedback, JOINTS, JointForce, JointState, Kind, Ling, ModeState, Opening, Position, Request, Response,
    SelfCheck, TICKS_PER_TURN,
};
use armwire::time::Duration;
use serde_json::Value;

use super::arm::{Arm, Protocol};
use super::fact::{Fact, number};

impl Arm for Ling {
    const PROTOCOL: Protocol = Protocol::Ling;

    const NAME: &'static str = "a Ling arm";

    const OTHER: (&'static str, Protocol) = ("an Alpha1", Protocol::Alpha1);

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

    fn facts(response: &Response) -> Vec<Fact> {
        vec![match response {
            Response::Info(info) => {
                let arm = match info.serial.kind() {
                    Some(kind) => format!("Ling {kind}"),
                    None => "Ling, of unknown kind".to_owned(),
                };
                return vec![
                    Fact::words("arm", arm),
                    Fact::words("serial", info.serial),
                    Fact::words("hardware", info.hardware),
                    Fact::words("firmware", info.firmware),
                ];
            }
            Response::Joints(state) => return joint_state(state),
            Response::Stroke(stroke) => Fact::new("stroke", "stroke_mm", stroke.millimetres(), stroke),
            Response::Temperatures(celsius) => {
                let celsius = celsius.as_slice().iter();
                let celsius = celsius.map(|&celsius| (celsius.into(), celsius.to_string()));
                Fact::each(("temperatures", "temperature"), "celsius", " °C", celsius)
            }
            Response::Velocities(speeds) => {
                let speeds = speeds.as_slice().iter();
                let speeds = speeds.map(|&ticks| (number(degrees(ticks.into())), Velocity(ticks).to_string()));
                Fact::each(("velocities", "velocity"), "deg_per_s", " °/s", speeds)
            }
            Response::SelfCheck(check) => self_check(*check, None),
            Response::ModeReply(reply) => {
                return vec![
                    Fact::words("requested mode", reply.requested()),
                    Fact::words("result", reply.result),
                ];
            }
            Response::Mode(state) => return mode_state(state),
            Response::ForceFeedback(state) => return force_feedback(state),
            other => Fact::words("message", other),
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
    let percent = f64::from(state.gripper) / 10.0;
    // Also that of another robot: the status says so.
    let value = Opening::new(state.gripper).map_or(Value::Null, |_| number(percent));
    vec![
        joints(state.joints),
        Fact::new("gripper", "gripper_percent", value, Gripper(state.gripper)),
        Fact::words("status", state.status),
    ]
}

fn mode_state(state: &ModeState) -> Vec<Fact> {
    let each = |names: (&str, &str), unit: &str, shown: &str, value: fn(&JointForce) -> i16| {
        let values = state.joints.iter().map(value);
        let values = values.map(|value| (number(f64::from(value) / 1e3), Thousandths(value).to_string()));
        Fact::each(names, unit, shown, values)
    };
    let current = |names, value| each(names, "a", " A", value);
    vec![
        Fact::words("mode", state.mode),
        Fact::new("blocked", "blocked_mask", state.blocked.0, state.blocked),
        Fact::new("valid", "valid_mask", state.valid.0, state.valid),
        each(("residual torques", "residual_torque"), "nm", " Nm", |joint| {
            joint.residual_torque
        }),
        current(("requested currents", "requested_current"), |joint| {
            joint.requested_current
        }),
        current(("output currents", "output_current"), |joint| joint.output_current),
        current(("measured currents", "measured_current"), |joint| {
            joint.measured_current
        }),
    ]
}

fn force_feedback(state: &ForceFeedback) -> Vec<Fact> {
    let switch = |name: &str, key: &str, is_on: bool| Fact::new(name, key, is_on, if is_on { "on" } else { "off" });
    vec![
        switch("requested", "is_requested", state.is_requested),
        switch("effective", "is_effective", state.is_effective),
        Fact::new("inhibit", "inhibit_mask", state.inhibit.0, state.inhibit),
        switch("sync", "is_sync_active", state.is_sync_active),
        switch("torque", "is_torque_enabled", state.is_torque_enabled),
        switch("requested torque", "is_torque_requested", state.is_torque_requested),
        Fact::new("transition", "transition", state.transition, state.transition),
        Fact::new("raw grip", "grip_raw", state.grip, state.grip),
        Fact::new(
            "requested mode",
            "requested_mode",
            state.requested_mode,
            state.requested_mode,
        ),
    ]
}

/// Raw joint positions, in degrees.
pub(super) fn joints(ticks: [u16; JOINTS]) -> Fact {
    let joints = ticks.map(|ticks| {
        let value = Position::new(ticks).map_or(Value::Null, |position| {
            let from_centre = f64::from(position.ticks()) - f64::from(Position::CENTRE.ticks());
            number(degrees(from_centre))
        });
        (value, Angle(ticks).to_string())
    });
    Fact::each(("joints", "joint"), "deg", "", joints)
}

/// The servos in a normal state, of an arm whose type may be known.
fn self_check(check: SelfCheck, kind: Option<Kind>) -> Fact {
    let servos = kind.unwrap_or(Kind::Follower).servos();
    let faulty: Vec<_> = check.faulty(kind.unwrap_or(Kind::Follower)).collect();
    let is_normal = |id| match faulty.contains(&id) {
        // A leader may lack this servo.
        true if kind.is_none() && usize::from(id) > Kind::Leader.servos() => Value::Null,
        is_faulty => Value::from(!is_faulty),
    };
    let normal = (1..=servos as u8).map(|id| (is_normal(id), String::new()));
    let text = check.display(kind).to_string();
    let fact = Fact::each(("self-check", "servo"), "is_normal", "", normal);
    Fact { text, ..fact }
}

/// The angle of so many ticks.
fn degrees(ticks: f64) -> f64 {
    ticks * 360.0 / f64::from(TICKS_PER_TURN)
}
