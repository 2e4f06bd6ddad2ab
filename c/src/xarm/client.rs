//! The host's side.

use armwire::Config;
use armwire::xarm::{Joint, MAX_FRAME, Request, XArm};

use super::message::{ArmwireXarmResponse, protocol, raw};
use crate::client::{self, State};
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// Size of a client, in words of 64 bits.
pub const ARMWIRE_XARM_CLIENT_WORDS: usize = 136;

/// A client of an xArm: one request at a time. The caller owns its memory. The content is private.
#[repr(C)]
pub struct ArmwireXarmClient {
    opaque: [u64; ARMWIRE_XARM_CLIENT_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireXarmClient {
    type Value = State<XArm, MAX_FRAME>;
    const TAG: u32 = memory::tag(5);
}

/// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_tcp`.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_init(
    client: Option<&mut ArmwireXarmClient>,
    version: u32,
    config: Option<&ArmwireConfig>,
) -> ArmwireStatus {
    client::init(client, version, config, Config::TCP, XArm::PRIVATE).into()
}

/// The next action. Call it again after every event except WAIT, after bytes were received or transmitted, and at
/// `until_us` of a WAIT event. `now_us` is the time of a monotonic clock.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_poll(
    client: Option<&mut ArmwireXarmClient>,
    now_us: u64,
    event: Option<&mut ArmwireEvent>,
    response: Option<&mut ArmwireXarmResponse>,
) -> ArmwireStatus {
    client::poll(client, now_us, event, response, ArmwireXarmResponse::set).into()
}

/// The line accepted the first `len` bytes of a TRANSMIT event.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the remaining bytes. Nothing counts as transmitted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_transmitted(
    client: Option<&mut ArmwireXarmClient>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::transmitted(client, now_us, len)
}

/// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never empty after a
/// WAIT event.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_space(
    client: Option<&mut ArmwireXarmClient>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    client::space(client, space, len).into()
}

/// The first `len` bytes of `space` arrived.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_received(
    client: Option<&mut ArmwireXarmClient>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::received(client, now_us, len)
}

/// Copies in as many of the received bytes as fit and writes their number to `taken`. Poll until WAIT, then pass in the
/// rest.
///
/// # Safety
///
/// `bytes` is NULL, or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_xarm_client_receive(
    client: Option<&mut ArmwireXarmClient>,
    now_us: u64,
    bytes: *const u8,
    len: usize,
    taken: Option<&mut usize>,
) -> ArmwireStatus {
    // SAFETY: guaranteed by the caller.
    let bytes = unsafe { memory::bytes(bytes, len) };
    client::receive(client, now_us, bytes, taken).into()
}

/// The UART reported an idle line. Never call it for a gap between USB packets.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_idle(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::idle(client)
}

/// Cancels the request in flight, if there is one. The rest of a partly transmitted request must still be transmitted.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_cancel(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::cancel(client)
}

/// The last rejected value or length, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_fault(
    client: Option<&mut ArmwireXarmClient>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    client::fault(client, fault)
}

/// Sets the protocol id of later requests: 2, the initial value, or 3.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_set_protocol(
    client: Option<&mut ArmwireXarmClient>,
    protocol_id: u16,
) -> ArmwireStatus {
    client::change(client, protocol(protocol_id), |arm, protocol| arm.protocol = protocol)
}

/// Sends a heartbeat. Not answered.
///
/// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_heartbeat(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::Heartbeat))
}

/// Reads the versions (register 1).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_read_version(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadVersion))
}

/// Reads the serial numbers (register 2).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_read_serials(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadSerials))
}

/// Reloads the friction parameters (register 4).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_reload_dynamics(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReloadDynamics))
}

/// Reads the quantity reported as torque (register 5).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_read_torque_source(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadTorqueSource))
}

/// Reads the radius of rotation of a joint, 1 to 7, relative to the tool (register 6).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_read_rotation_radius(
    client: Option<&mut ArmwireXarmClient>,
    joint: u8,
) -> ArmwireStatus {
    let joint = Joint::new(joint).map_err(Refused::only);
    client::submit(client, joint.map(Request::ReadRotationRadius))
}

/// Shuts the arm's operating system down (register 10).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_shutdown(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::Shutdown))
}

/// Restarts the arm's operating system (register 10).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_xarm_client_reboot(client: Option<&mut ArmwireXarmClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::Reboot))
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
        Ok(params) => client::submit(client, raw(reg, params).map(Request::Raw)),
        Err(status) => status,
    }
}
