//! The host's side.

use armwire::Config;
use armwire::xarm::{Joint, MAX_FRAME, Request, XArm};

use super::message::{ArmwireXarmResponse, protocol, raw};
use crate::client::State;
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::functions::{client, requests};
use crate::memory;
use crate::status::ArmwireStatus;

client! {
    /// A client of an xArm: one request at a time. The caller owns its memory. The content is private.
    ArmwireXarmClient: State<XArm, MAX_FRAME>, ARMWIRE_XARM_CLIENT_WORDS = 216, tag 5, response ArmwireXarmResponse;
    /// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_tcp`.
    armwire_xarm_client_init(Config::TCP, XArm::PRIVATE);
    armwire_xarm_client_poll;
    armwire_xarm_client_transmitted;
    armwire_xarm_client_space;
    armwire_xarm_client_received;
    armwire_xarm_client_receive;
    armwire_xarm_client_idle;
    /// Cancels the request in flight, if there is one. A partly transmitted request is never executed: the next request
    /// ends with the event BROKEN.
    armwire_xarm_client_cancel;
    armwire_xarm_client_fault;
}

/// Sets the protocol id of later requests: 2, the initial value, or 3.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_set_protocol(
    client: Option<&mut ArmwireXarmClient>,
    protocol_id: u16,
) -> ArmwireStatus {
    memory::open(client)
        .and_then(|client| client.change(protocol(protocol_id), |arm, protocol| arm.protocol = protocol))
        .into()
}

requests! {
    ArmwireXarmClient;

    /// Sends a heartbeat. Not answered.
    ///
    /// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
    armwire_xarm_client_heartbeat() => Ok(Request::Heartbeat);

    /// Reads the versions (register 1).
    armwire_xarm_client_read_version() => Ok(Request::ReadVersion);

    /// Reads the serial numbers (register 2).
    armwire_xarm_client_read_serials() => Ok(Request::ReadSerials);

    /// Reloads the friction parameters (register 4).
    armwire_xarm_client_reload_dynamics() => Ok(Request::ReloadDynamics);

    /// Reads the quantity reported as torque (register 5).
    armwire_xarm_client_read_torque_source() => Ok(Request::ReadTorqueSource);

    /// Reads the radius of rotation of a joint, 1 to 7, relative to the tool (register 6).
    armwire_xarm_client_read_rotation_radius(joint: u8) =>
        Joint::new(joint).map_err(Refused::only).map(Request::ReadRotationRadius);

    /// Shuts the arm's operating system down (register 10).
    armwire_xarm_client_shutdown() => Ok(Request::Shutdown);

    /// Restarts the arm's operating system (register 10).
    armwire_xarm_client_reboot() => Ok(Request::Reboot);
}

/// Calls any other register with up to 252 bytes of parameters: 16-bit numbers are big-endian, 32-bit numbers
/// little-endian. The timeout of the answer is 10 s.
///
/// # Safety
///
/// `params` is NULL, or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_xarm_client_raw(
    client: Option<&mut ArmwireXarmClient>,
    reg: u8,
    params: *const u8,
    len: usize,
) -> ArmwireStatus {
    // SAFETY: guaranteed by the caller.
    match unsafe { memory::bytes(params, len) } {
        Ok(params) => memory::open(client)
            .and_then(|client| client.submit(raw(reg, params).map(Request::Raw)))
            .into(),
        Err(status) => status,
    }
}
