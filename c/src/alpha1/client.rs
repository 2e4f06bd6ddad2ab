//! The host's side.

use core::num::NonZeroU32;

use armwire::Config;
use armwire::alpha1::{Alpha1, Led, MAX_FRAME, Request, ServoRequest};

use super::message::{
    ArmwireAlpha1Action, ArmwireAlpha1Response, address, angle, interval, move_time, offset, offset_tool, servo, text,
    usb_type,
};
use crate::client::{self, State};
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;

/// The baud rate of the servo bus, and of the robot's Bluetooth serial port. USB accepts any rate.
const BAUD: NonZeroU32 = NonZeroU32::new(115_200).unwrap();

const SERIAL: Config = Config {
    baud: BAUD,
    ..Config::DEFAULT
};

/// Size of a client, in words of 64 bits.
pub const ARMWIRE_ALPHA1_CLIENT_WORDS: usize = 128;

/// A client of an Alpha1 robot, or of a bus of its servos: one request at a time. The caller owns its memory. The
/// content is private.
#[repr(C)]
pub struct ArmwireAlpha1Client {
    opaque: [u64; ARMWIRE_ALPHA1_CLIENT_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireAlpha1Client {
    type Value = State<Alpha1, MAX_FRAME>;
    const TAG: u32 = memory::tag(3);
}

/// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_serial` at
/// 115 200 baud.
///
/// ARMWIRE_STATUS_VERSION if header and library differ, ARMWIRE_STATUS_OUT_OF_RANGE if the baud rate is 0.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_init(
    client: Option<&mut ArmwireAlpha1Client>,
    version: u32,
    config: Option<&ArmwireConfig>,
) -> ArmwireStatus {
    client::init(client, version, config, SERIAL, Alpha1).into()
}

/// The next action. Call it again after every event except WAIT, after bytes were received or transmitted, and at
/// `until_us` of a WAIT event. `now_us` is the time of a monotonic clock.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_poll(
    client: Option<&mut ArmwireAlpha1Client>,
    now_us: u64,
    event: Option<&mut ArmwireEvent>,
    response: Option<&mut ArmwireAlpha1Response>,
) -> ArmwireStatus {
    client::poll(client, now_us, event, response, ArmwireAlpha1Response::set).into()
}

/// The line accepted the first `len` bytes of a TRANSMIT event.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the remaining bytes. Nothing counts as transmitted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_transmitted(
    client: Option<&mut ArmwireAlpha1Client>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::transmitted(client, now_us, len)
}

/// Free space for a read or DMA. Report the number of bytes with `received`, before any other call. Never empty after a
/// WAIT event.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_space(
    client: Option<&mut ArmwireAlpha1Client>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> ArmwireStatus {
    client::space(client, space, len).into()
}

/// The first `len` bytes of `space` arrived.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if `len` exceeds the free space. Nothing is accepted then.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_received(
    client: Option<&mut ArmwireAlpha1Client>,
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
pub unsafe extern "C" fn armwire_alpha1_client_receive(
    client: Option<&mut ArmwireAlpha1Client>,
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
pub extern "C" fn armwire_alpha1_client_idle(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::idle(client)
}

/// Cancels the request in flight, if there is one. The rest of a partly transmitted request must still be transmitted.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_cancel(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::cancel(client)
}

/// The last rejected value or length, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_fault(
    client: Option<&mut ArmwireAlpha1Client>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    client::fault(client, fault)
}

/// Submits a request to a servo.
fn submit_servo(client: Option<&mut ArmwireAlpha1Client>, request: Result<ServoRequest, Refused>) -> ArmwireStatus {
    client::submit(client, request.map(Request::Servo))
}

/// Reads the robot's hardware version (row F1).
///
/// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_read_hardware_version(
    client: Option<&mut ArmwireAlpha1Client>,
) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadHardwareVersion))
}

/// Reads the servo states (row EF).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_read_servo_states(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadServoStates))
}

/// Stops the current action (row F2).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_stop(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::submit(client, Ok(Request::Stop))
}

/// Reads the robot's firmware version (row F5).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_read_firmware_version(
    client: Option<&mut ArmwireAlpha1Client>,
) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadFirmwareVersion))
}

/// Moves all servos (row FB).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_act(
    client: Option<&mut ArmwireAlpha1Client>,
    action: Option<&ArmwireAlpha1Action>,
) -> ArmwireStatus {
    let Some(action) = action else {
        return ArmwireStatus::Null;
    };
    client::submit(client, action.get().map(Request::Act))
}

/// Connects (1) or disconnects (0) the servo offset tool (row F4). Bluetooth is not available while it is connected.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_set_offset_tool(
    client: Option<&mut ArmwireAlpha1Client>,
    connected: u8,
) -> ArmwireStatus {
    client::submit(client, offset_tool(connected).map(Request::SetOffsetTool))
}

/// Sets the robot's USB device type, an `ArmwireAlpha1UsbType` (row F9). A disk no longer supports this protocol.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_set_usb_type(
    client: Option<&mut ArmwireAlpha1Client>,
    usb: u8,
) -> ArmwireStatus {
    client::submit(client, usb_type(usb).map(Request::SetUsbType))
}

/// Plays the action of this name, 0 to 254 bytes (row F3).
///
/// # Safety
///
/// `name` is NULL, or has `len` bytes.
#[unsafe(no_mangle)]
pub unsafe extern "C" fn armwire_alpha1_client_play(
    client: Option<&mut ArmwireAlpha1Client>,
    name: *const u8,
    len: usize,
) -> ArmwireStatus {
    // SAFETY: guaranteed by the caller.
    match unsafe { memory::bytes(name, len) } {
        Ok(name) => client::submit(client, text(name).map(Request::Play)),
        Err(status) => status,
    }
}

/// Moves a servo (1 to 240), or all servos (0), without an answer. `angle_degrees` is 0 to 240, `time_ms` is 0 to 5100,
/// and `lock_ms`, the completion time, is 0 to 1310700. Both times are rounded to the nearest 20 ms.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_move(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
    angle_degrees: u8,
    time_ms: u32,
    lock_ms: u32,
) -> ArmwireStatus {
    let request = || {
        Ok(ServoRequest::Move {
            to: address(servo_id)?,
            angle: angle(angle_degrees)?,
            time: move_time(time_ms)?,
            lock: interval(lock_ms)?,
        })
    };
    submit_servo(client, request())
}

/// Switches the motor of a servo (1 to 240) off, or of all servos (0), without an answer. A load that they hold falls.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_release(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    submit_servo(client, address(servo_id).map(ServoRequest::Release))
}

/// Switches the LED of a servo (1 to 240), or of all servos (0), without an answer. The sources contradict each other:
/// in the servos' manual 0 is off and 1 blinks, in public programs 0 is on and 1 is off.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_set_led(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
    led: u8,
) -> ArmwireStatus {
    let request = address(servo_id).map(|to| ServoRequest::SetLed { to, led: Led(led) });
    submit_servo(client, request)
}

/// Reads a servo's target and actual angle. The servo switches its motor off to answer: a load that it holds falls.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_angles(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    submit_servo(client, servo(servo_id).map(ServoRequest::ReadAngles))
}

/// Changes a servo's id.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_change_id(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
    new_servo_id: u8,
) -> ArmwireStatus {
    let request = || {
        Ok(ServoRequest::ChangeId {
            from: servo(servo_id)?,
            to: servo(new_servo_id)?,
        })
    };
    submit_servo(client, request())
}

/// Sets a servo's zero offset, -90 to 90 thirds of a degree.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_set_offset(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
    offset_thirds_of_degree: i16,
) -> ArmwireStatus {
    let request = || {
        let servo = servo(servo_id)?;
        Ok(ServoRequest::SetOffset(servo, offset(offset_thirds_of_degree)?))
    };
    submit_servo(client, request())
}

/// Reads a servo's zero offset.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_offset(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    submit_servo(client, servo(servo_id).map(ServoRequest::ReadOffset))
}

/// Reads the version of a servo's firmware.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_version(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    submit_servo(client, servo(servo_id).map(ServoRequest::ReadVersion))
}
