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

/// The rate of the servo bus, and of the robot's Bluetooth serial port. USB takes any.
const BAUD: NonZeroU32 = NonZeroU32::new(115_200).unwrap();

const SERIAL: Config = Config {
    baud: BAUD,
    ..Config::DEFAULT
};

/// Words in the memory of a client.
pub const ARMWIRE_ALPHA1_CLIENT_WORDS: usize = 128;

/// A client of an Alpha1 robot, or of a bus of its servos: one request at a time. Its memory is yours, what is in it is not.
#[repr(C)]
pub struct ArmwireAlpha1Client {
    opaque: [u64; ARMWIRE_ALPHA1_CLIENT_WORDS],
}

// SAFETY: an array of `u64` in a `repr(C)` structure.
unsafe impl Memory for ArmwireAlpha1Client {
    type Value = State<Alpha1, MAX_FRAME>;
    const TAG: u32 = memory::tag(3);
}

/// Makes a client. `version` is ARMWIRE_VERSION. `config` may be NULL: then it is that of
/// `armwire_config_serial` at 115 200 baud.
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

/// The next step. Call it again after every event but WAIT, once bytes arrived or were transmitted, and at the time that WAIT
/// gives. `now_us` is of a clock that does not go back.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_poll(
    client: Option<&mut ArmwireAlpha1Client>,
    now_us: u64,
    event: Option<&mut ArmwireEvent>,
    response: Option<&mut ArmwireAlpha1Response>,
) -> ArmwireStatus {
    client::poll(client, now_us, event, response, ArmwireAlpha1Response::set).into()
}

/// The line took the first `len` bytes of a TRANSMIT event.
///
/// ARMWIRE_STATUS_OUT_OF_RANGE if that is more than what is left: then nothing is taken for transmitted.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_transmitted(
    client: Option<&mut ArmwireAlpha1Client>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::transmitted(client, now_us, len)
}

/// Room to read or DMA into. Say with `received` how many bytes arrived, before any other call. Never empty after a WAIT event.
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
/// ARMWIRE_STATUS_OUT_OF_RANGE if that is more than there is room for: then nothing is taken.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_received(
    client: Option<&mut ArmwireAlpha1Client>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus {
    client::received(client, now_us, len)
}

/// Copies in as much of the bytes that arrived as there is room for, `*taken` of them. Poll until WAIT, then put in the rest.
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

/// Gives up the request in flight, if there is one. What is left of its bytes is still to be transmitted.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_cancel(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::cancel(client)
}

/// The last value or length that was refused, with its range.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_fault(
    client: Option<&mut ArmwireAlpha1Client>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus {
    client::fault(client, fault)
}

/// Makes a request of a servo.
fn ask(client: Option<&mut ArmwireAlpha1Client>, request: Result<ServoRequest, Refused>) -> ArmwireStatus {
    client::submit(client, request.map(Request::Servo))
}

/// Asks for the robot's hardware version (row F1).
///
/// ARMWIRE_STATUS_BUSY while another request is in flight, as from all requests.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_read_hardware_version(
    client: Option<&mut ArmwireAlpha1Client>,
) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadHardwareVersion))
}

/// Asks which servos run (row EF).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_read_servo_states(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::submit(client, Ok(Request::ReadServoStates))
}

/// Stops the action that is played (row F2).
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_stop(client: Option<&mut ArmwireAlpha1Client>) -> ArmwireStatus {
    client::submit(client, Ok(Request::Stop))
}

/// Asks for the robot's firmware version (row F5).
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

/// Connects (1) or disconnects (0) the servo offset tool (row F4): while it is connected, Bluetooth may not be used.
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

/// Moves a servo (1 to 240), or all (0): then it is not answered. `angle_degrees` is 0 to 240, `time_ms` 0 to 5100, `lock_ms`,
/// the completion time, 0 to 1310700; both to the nearest 20 ms.
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
    ask(client, request())
}

/// Switches the motor of a servo (1 to 240) off, or those of all (0): then it is not answered. What they hold up falls.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_release(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    ask(client, address(servo_id).map(ServoRequest::Release))
}

/// Switches the light of a servo (1 to 240), or those of all (0): then it is not answered. Sources contradict each other on
/// what `led` means: by the servos' manual 0 is off and 1 blinks, in public programs 0 is on and 1 is off.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_set_led(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
    led: u8,
) -> ArmwireStatus {
    let request = address(servo_id).map(|to| ServoRequest::SetLed { to, led: Led(led) });
    ask(client, request)
}

/// Asks a servo for its target and actual angle. The servo switches its motor off to answer: what it holds up falls.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_angles(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    ask(client, servo(servo_id).map(ServoRequest::ReadAngles))
}

/// Gives a servo another id.
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
    ask(client, request())
}

/// Sets the offset of a servo's zero, -90 to 90 thirds of a degree.
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
    ask(client, request())
}

/// Asks a servo for the offset of its zero.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_offset(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    ask(client, servo(servo_id).map(ServoRequest::ReadOffset))
}

/// Asks a servo for the version of its firmware.
#[unsafe(no_mangle)]
pub extern "C" fn armwire_alpha1_client_servo_read_version(
    client: Option<&mut ArmwireAlpha1Client>,
    servo_id: u8,
) -> ArmwireStatus {
    ask(client, servo(servo_id).map(ServoRequest::ReadVersion))
}
