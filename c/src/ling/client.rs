//! The host's side.

use armwire::Config;
use armwire::ling::{Ling, MAX_FRAME, Request, Speed};

use super::message::{ArmwireLingMove, ArmwireLingResponse, control_mode, stroke, switch, temperature_limit, torque};
use crate::client::State;
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::functions::{client, requests};
use crate::memory;
use crate::status::ArmwireStatus;

client! {
    /// A client of a Ling arm: one request at a time. The caller owns its memory. The content is private.
    ArmwireLingClient: State<Ling, MAX_FRAME>, ARMWIRE_LING_CLIENT_WORDS = 160, tag 1, response ArmwireLingResponse;
    /// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_serial`.
    armwire_ling_client_init(Config::DEFAULT, Ling);
    armwire_ling_client_poll;
    armwire_ling_client_transmitted;
    armwire_ling_client_space;
    armwire_ling_client_received;
    armwire_ling_client_receive;
    armwire_ling_client_idle;
    /// Cancels the request in flight, if there is one. A partly transmitted request is never executed: zeros, which are
    /// transmitted next, make the arm discard it.
    armwire_ling_client_cancel;
    armwire_ling_client_fault;
}

requests! {
    ArmwireLingClient;

    /// Reads the serial number and the versions (section 2.1).
    ///
    /// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
    armwire_ling_client_read_info() => Ok(Request::ReadInfo);

    /// Makes the present pose the zero position, and switches the torque off (section 2.2): a load that the arm holds
    /// falls. Not answered.
    armwire_ling_client_set_zero() => Ok(Request::SetZero);

    /// Sets the gripper's stroke in millimetres: 50, 75 or 100 (section 2.3). Not answered.
    armwire_ling_client_set_stroke(stroke_mm: u8) => stroke(stroke_mm).map(Request::SetStroke);

    /// Reads the configured stroke of the gripper (section 2.3).
    armwire_ling_client_read_stroke() => Ok(Request::ReadStroke);

    /// Switches the torque off (0: a load that the arm holds falls) or on (1) (section 2.4). Not answered.
    armwire_ling_client_set_torque(on: u8) => torque(on).map(Request::SetTorque);

    /// Reads the joint positions, the gripper and the motion status (section 2.5).
    armwire_ling_client_read_joints() => Ok(Request::ReadJoints);

    /// Reads the servo temperatures (section 2.5).
    armwire_ling_client_read_temperatures() => Ok(Request::ReadTemperatures);

    /// Sets the temperature limit of the overheat protection: 0 to 255 except 254 (section 2.5). Not answered.
    armwire_ling_client_set_temperature_limit(limit_celsius: u8) =>
        temperature_limit(limit_celsius).map(Request::SetTemperatureLimit);

    /// Reads the servo velocities (section 2.5).
    armwire_ling_client_read_velocities() => Ok(Request::ReadVelocities);
}

/// Moves the joints and the gripper (section 2.5). Not answered.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_move(
    client: Option<&mut ArmwireLingClient>,
    target: Option<&ArmwireLingMove>,
) -> ArmwireStatus {
    let Some(target) = target else {
        return ArmwireStatus::Null;
    };
    memory::open(client)
        .and_then(|client| client.submit(target.get(Speed::SLOWEST).map(Request::Move)))
        .into()
}

/// As `armwire_ling_client_move`, with speeds from 1 tick/s on. `mode` is the arm's answer to
/// `armwire_ling_client_read_mode`, which shows that it is a force-feedback leader. With any other response the slowest
/// speed is 50.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_move_slowly(
    client: Option<&mut ArmwireLingClient>,
    target: Option<&ArmwireLingMove>,
    mode: Option<&ArmwireLingResponse>,
) -> ArmwireStatus {
    let (Some(target), Some(mode)) = (target, mode) else {
        return ArmwireStatus::Null;
    };
    memory::open(client)
        .and_then(|client| client.submit(target.get(mode.slowest()).map(Request::Move)))
        .into()
}

requests! {
    ArmwireLingClient;

    /// Runs a self-check of every servo (section 2.6).
    armwire_ling_client_self_check() => Ok(Request::SelfCheck);

    /// Sets the control mode of a force-feedback leader: 0 position, 1 current. The torque may be switched: after a return
    /// to position mode it is off. The answer says that the mode is accepted, not that it is applied: read the mode until
    /// it is. An arm that is no such leader does not answer.
    armwire_ling_client_set_mode(mode: u8) => control_mode(mode).map(Request::SetMode);

    /// Reads the applied control mode and the currents of a force-feedback leader. No other arm answers.
    armwire_ling_client_read_mode() => Ok(Request::ReadMode);

    /// Requests the force feedback of a force-feedback leader (1), or its end (0). With it the motors push the joints. The
    /// answer says whether it is effective.
    armwire_ling_client_set_force_feedback(on: u8) => switch(on).map(Request::SetForceFeedback);

    /// Reads the state of the force feedback of a force-feedback leader.
    armwire_ling_client_read_force_feedback() => Ok(Request::ReadForceFeedback);
}
