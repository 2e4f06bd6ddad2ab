//! The host's side.

use armwire::Config;
use armwire::ling::{Ling, MAX_FRAME, Request};

use super::message::{ArmwireLingMove, ArmwireLingResponse, stroke, temperature_limit, torque};
use crate::client::{self, State};
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// Size of a client, in words of 64 bits.
pub const ARMWIRE_LING_CLIENT_WORDS: usize = 80;

/// A client of a Ling arm: one request at a time. The caller owns its memory. The content is private.
#[repr(C)]
pub struct ArmwireLingClient {
    opaque: [u64; ARMWIRE_LING_CLIENT_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireLingClient {
    type Value = State<Ling, MAX_FRAME>;
    const TAG: u32 = memory::tag(1);
}

/// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_serial`.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_init(
    client: Option<&mut ArmwireLingClient>,
    version: u32,
    config: Option<&ArmwireConfig>,
) -> ArmwireStatus {
    client::init(client, version, config, Config::DEFAULT, Ling).into()
}

/// The next action. Call it again after every event except WAIT, after bytes were received or transmitted, and at
/// `until_us` of a WAIT event. `now_us` is the time of a monotonic clock.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_poll(
    client: Option<&mut ArmwireLingClient>,
    now_us: u64,
    event: Option<&mut ArmwireEvent>,
    response: Option<&mut ArmwireLingResponse>,
) -> ArmwireStatus {
    client::poll(client, now_us, event, response, ArmwireLingResponse::set).into()
}

/// The line accepted the first `len` bytes of a TRANSMIT event.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the remaining bytes. Nothing counts as transmitted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_transmitted(
    client: Option<&mut ArmwireLingClient>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::transmitted(client, now_us, len)
}

/// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never empty after a
/// WAIT event.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_space(
    client: Option<&mut ArmwireLingClient>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    client::space(client, space, len).into()
}

/// The first `len` bytes of `space` arrived.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_received(
    client: Option<&mut ArmwireLingClient>,
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
pub unsafe extern "C" fn armwire_ling_client_receive(
    client: Option<&mut ArmwireLingClient>,
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
pub extern "C" fn armwire_ling_client_idle(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::idle(client)
}

/// Cancels the request in flight, if there is one. The rest of a partly transmitted request must still be transmitted.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_cancel(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::cancel(client)
}

/// The last rejected value or length, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_fault(
    client: Option<&mut ArmwireLingClient>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    client::fault(client, fault)
}

/// Reads the serial number and the versions (section 2.1).
///
/// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_read_info(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadInfo))
}

/// Makes the present pose the zero position, and switches the torque off (section 2.2): a load that the arm holds
/// falls. Not answered.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_set_zero(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::SetZero))
}

/// Sets the gripper's stroke in millimetres: 50, 75 or 100 (section 2.3). Not answered.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_set_stroke(
    client: Option<&mut ArmwireLingClient>,
    stroke_mm: u8,
) -> ArmwireStatus {
    client::submit(client, stroke(stroke_mm).map(Request::SetStroke))
}

/// Reads the configured stroke of the gripper (section 2.3).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_read_stroke(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadStroke))
}

/// Switches the torque off (0: a load that the arm holds falls) or on (1) (section 2.4). Not answered.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_set_torque(client: Option<&mut ArmwireLingClient>, on: u8) -> ArmwireStatus {
    client::submit(client, torque(on).map(Request::SetTorque))
}

/// Reads the joint positions, the gripper and the motion status (section 2.5).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_read_joints(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadJoints))
}

/// Reads the servo temperatures (section 2.5).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_read_temperatures(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadTemperatures))
}

/// Sets the temperature limit of the overheat protection: 0 to 255 except 254 (section 2.5). Not answered.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_set_temperature_limit(
    client: Option<&mut ArmwireLingClient>,
    limit_celsius: u8,
) -> ArmwireStatus {
    client::submit(
        client,
        temperature_limit(limit_celsius).map(Request::SetTemperatureLimit),
    )
}

/// Reads the servo velocities (section 2.5).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_read_velocities(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadVelocities))
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
    client::submit(client, target.get().map(Request::Move))
}

/// Runs a self-check of every servo (section 2.6).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_ling_client_self_check(client: Option<&mut ArmwireLingClient>) -> ArmwireStatus {
    client::submit(client, Ok(Request::SelfCheck))
}
