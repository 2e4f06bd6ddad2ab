//! The host's side.

use core::num::NonZeroU32;

use armwire::Config;
use armwire::alpha1::{Alpha1, Led, MAX_FRAME, Request, ServoRequest};

use super::message::{
    ArmwireAlpha1Action, ArmwireAlpha1Response, address, angle, interval, move_time, offset, offset_tool, servo, text,
    usb_type,
};
use crate::client::State;
use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::ArmwireFault;
use crate::functions::{client, requests};
use crate::memory;
use crate::status::ArmwireStatus;

/// At the baud rate of the servo bus, and of the robot's Bluetooth serial port. USB accepts any rate.
const SERIAL: Config = Config {
    baud: NonZeroU32::new(115_200),
    ..Config::DEFAULT
};

client! {
    /// A client of an Alpha1 robot, or of a bus of its servos: one request at a time. The caller owns its memory. The
    /// content is private.
    ArmwireAlpha1Client: State<Alpha1, MAX_FRAME>, ARMWIRE_ALPHA1_CLIENT_WORDS = 208, tag 3,
        response ArmwireAlpha1Response;
    /// Initializes a client. `version` is ARMWIRE_VERSION. `config` may be NULL, for that of `armwire_config_serial` at
    /// 115 200 baud.
    armwire_alpha1_client_init(SERIAL, Alpha1);
    armwire_alpha1_client_poll;
    armwire_alpha1_client_transmitted;
    armwire_alpha1_client_space;
    armwire_alpha1_client_received;
    armwire_alpha1_client_receive;
    armwire_alpha1_client_idle;
    /// Cancels the request in flight, if there is one. A partly transmitted request is never executed: zeros, which are
    /// transmitted next, make the arm discard it.
    armwire_alpha1_client_cancel;
    armwire_alpha1_client_fault;
}

requests! {
    ArmwireAlpha1Client;

    /// Reads the robot's hardware version (row F1).
    ///
    /// ARMWIRE_STATUS_BUSY while another request is in flight. All requests return it.
    armwire_alpha1_client_read_hardware_version() => Ok(Request::ReadHardwareVersion);

    /// Reads the servo states (row EF).
    armwire_alpha1_client_read_servo_states() => Ok(Request::ReadServoStates);

    /// Stops the current action (row F2).
    armwire_alpha1_client_stop() => Ok(Request::Stop);

    /// Reads the robot's firmware version (row F5).
    armwire_alpha1_client_read_firmware_version() => Ok(Request::ReadFirmwareVersion);
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
    memory::open(client)
        .and_then(|client| client.submit(action.get().map(Request::Act)))
        .into()
}

requests! {
    ArmwireAlpha1Client;

    /// Connects (1) or disconnects (0) the servo offset tool (row F4). Bluetooth is not available while it is
    /// connected.
    armwire_alpha1_client_set_offset_tool(connected: u8) => offset_tool(connected).map(Request::SetOffsetTool);

    /// Sets the robot's USB device type, an `ArmwireAlpha1UsbType` (row F9). A disk no longer supports this protocol.
    armwire_alpha1_client_set_usb_type(usb: u8) => usb_type(usb).map(Request::SetUsbType);
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
        Ok(name) => memory::open(client)
            .and_then(|client| client.submit(text(name).map(Request::Play)))
            .into(),
        Err(status) => status,
    }
}

requests! {
    ArmwireAlpha1Client;

    /// Moves a servo (1 to 240), or all servos (0), without an answer. `angle_degrees` is 0 to 240, `time_ms` is 0 to
    /// 5100, and `lock_ms`, the completion time, is 0 to 1310700. Both times are rounded to the nearest 20 ms.
    armwire_alpha1_client_servo_move(servo_id: u8, angle_degrees: u8, time_ms: u32, lock_ms: u32) => {
        let request = || {
            Ok(ServoRequest::Move {
                to: address(servo_id)?,
                angle: angle(angle_degrees)?,
                time: move_time(time_ms)?,
                lock: interval(lock_ms)?,
            })
        };
        request().map(Request::Servo)
    };

    /// Switches the motor of a servo (1 to 240) off, or of all servos (0), without an answer. A load that they hold
    /// falls.
    armwire_alpha1_client_servo_release(servo_id: u8) =>
        address(servo_id).map(ServoRequest::Release).map(Request::Servo);

    /// Switches the LED of a servo (1 to 240), or of all servos (0), without an answer. The sources contradict each
    /// other: in the servos' manual 0 is off and 1 blinks, in public programs 0 is on and 1 is off.
    armwire_alpha1_client_servo_set_led(servo_id: u8, led: u8) =>
        address(servo_id).map(|to| Request::Servo(ServoRequest::SetLed { to, led: Led(led) }));

    /// Reads a servo's target and actual angle. The servo switches its motor off to answer: a load that it holds falls.
    armwire_alpha1_client_servo_read_angles(servo_id: u8) =>
        servo(servo_id).map(ServoRequest::ReadAngles).map(Request::Servo);

    /// Changes a servo's id.
    armwire_alpha1_client_servo_change_id(servo_id: u8, new_servo_id: u8) => {
        let request = || {
            Ok(ServoRequest::ChangeId {
                from: servo(servo_id)?,
                to: servo(new_servo_id)?,
            })
        };
        request().map(Request::Servo)
    };

    /// Sets a servo's zero offset, -90 to 90 thirds of a degree.
    armwire_alpha1_client_servo_set_offset(servo_id: u8, offset_thirds_of_degree: i16) => {
        let request = || {
            let servo = servo(servo_id)?;
            Ok(ServoRequest::SetOffset(servo, offset(offset_thirds_of_degree)?))
        };
        request().map(Request::Servo)
    };

    /// Reads a servo's zero offset.
    armwire_alpha1_client_servo_read_offset(servo_id: u8) =>
        servo(servo_id).map(ServoRequest::ReadOffset).map(Request::Servo);

    /// Reads the version of a servo's firmware.
    armwire_alpha1_client_servo_read_version(servo_id: u8) =>
        servo(servo_id).map(ServoRequest::ReadVersion).map(Request::Servo);
}
