//! Requests and responses as flat structures.

use armwire::OutOfRange;
use armwire::alpha1::{
    Action, Address, Angle, FirmwareVersion, Interval, MoveTime, Offset, OffsetTool, Outcome, Request, Response,
    SERVOS, ServoId, ServoRequest, ServoResponse, ServoStates, Text, UsbType,
};

use crate::device::Refusal;
use crate::fault::Refused;
use crate::memory;
use crate::status::ArmwireStatus;

/// Number of servos in an action (row FB). An Alpha1 has 16.
pub const ARMWIRE_ALPHA1_SERVOS: usize = 20;

const _: () = assert!(ARMWIRE_ALPHA1_SERVOS == SERVOS);

/// No angle: its effect in an action is not documented, and a load that the servo holds may fall.
pub const ARMWIRE_ALPHA1_NO_ANGLE: u8 = 255;

/// The unit of all times on the wire.
const UNIT_MS: u32 = 20;

/// The robot's USB device type.
#[repr(u8)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireAlpha1UsbType {
    /// A disk, which no longer supports this protocol.
    Disk = 1,
    /// A virtual serial port.
    SerialPort = 2,
    /// A HID device with reports of 64 bytes.
    Hid = 3,
}

/// One frame of an action (row FB).
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireAlpha1Action {
    /// Targets of servos 1 to 20: 0 to 240, or ARMWIRE_ALPHA1_NO_ANGLE. A device may also receive 241 to 254.
    pub angle_degrees: [u8; ARMWIRE_ALPHA1_SERVOS],
    /// Duration of the motion, 0 to 5100, in steps of 20 ms; rounded to the nearest.
    pub time_ms: u32,
    /// Time from the end of this frame to the start of the next accepted one, 0 to 1310700; rounded to the nearest 20
    /// ms.
    pub interval_ms: u32,
}

impl ArmwireAlpha1Action {
    fn of(action: &Action) -> Self {
        Self {
            angle_degrees: action
                .angles
                .map(|angle| angle.map_or(ARMWIRE_ALPHA1_NO_ANGLE, Angle::raw)),
            time_ms: u32::from(action.time.units()) * UNIT_MS,
            interval_ms: u32::from(action.interval.units()) * UNIT_MS,
        }
    }

    pub(super) fn get(&self) -> Result<Action, Refused> {
        let mut angles = [None; SERVOS];
        for (index, (to, degrees)) in angles.iter_mut().zip(self.angle_degrees).enumerate() {
            if degrees != ARMWIRE_ALPHA1_NO_ANGLE {
                *to = Some(Angle::new(degrees).map_err(Refused::at(index))?);
            }
        }
        Ok(Action {
            angles,
            time: move_time(self.time_ms)?,
            interval: interval(self.interval_ms)?,
        })
    }
}

/// The number of units nearest to a time.
fn units(what: &'static str, time_ms: u32, max: u16) -> Result<u16, Refused> {
    let max_ms = u32::from(max) * UNIT_MS;
    if time_ms > max_ms {
        let got = i32::try_from(time_ms).unwrap_or(i32::MAX);
        return Err(Refused::only(OutOfRange::new(what, "ms", got, 0, max_ms as i32)));
    }
    Ok((time_ms.saturating_add(UNIT_MS / 2) / UNIT_MS) as u16)
}

pub(super) fn move_time(time_ms: u32) -> Result<MoveTime, Refused> {
    units("move time", time_ms, u8::MAX.into()).map(|units| MoveTime::new(units as u8))
}

pub(super) fn interval(time_ms: u32) -> Result<Interval, Refused> {
    units("interval", time_ms, u16::MAX).map(Interval::new)
}

pub(super) fn angle(degrees: u8) -> Result<Angle, Refused> {
    Angle::new(degrees).map_err(Refused::only)
}

pub(super) fn servo(id: u8) -> Result<ServoId, Refused> {
    ServoId::new(id).map_err(Refused::only)
}

/// A servo, or all of them: 0.
pub(super) fn address(id: u8) -> Result<Address, Refused> {
    match id {
        0 => Ok(Address::All),
        _ => servo(id).map(Address::One),
    }
}

pub(super) fn offset(thirds: i16) -> Result<Offset, Refused> {
    Offset::new(thirds).map_err(Refused::only)
}

pub(super) fn offset_tool(connected: u8) -> Result<OffsetTool, Refused> {
    match flag("offset tool", connected)? {
        true => Ok(OffsetTool::Connect),
        false => Ok(OffsetTool::Disconnect),
    }
}

pub(super) fn usb_type(code: u8) -> Result<UsbType, Refused> {
    let types = [UsbType::Disk, UsbType::SerialPort, UsbType::Hid];
    let known = types.into_iter().find(|usb| *usb as u8 == code);
    known.ok_or(Refused::only(OutOfRange::new("USB type", "", code, 1, 3)))
}

pub(super) fn text(bytes: &[u8]) -> Result<Text<'_>, Refused> {
    Text::new(bytes).map_err(Refused::only)
}

/// A flag: 0 or 1.
fn flag(what: &'static str, value: u8) -> Result<bool, Refused> {
    match value {
        0 => Ok(false),
        1 => Ok(true),
        _ => Err(Refused::only(OutOfRange::new(what, "", value, 0, 1))),
    }
}

/// A message of the host.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireAlpha1RequestKind {
    /// None.
    None = 0,
    /// Reads the robot's hardware version (row F1).
    ReadHardwareVersion,
    /// Reads the servo states (row EF).
    ReadServoStates,
    /// Stops the current action (row F2).
    Stop,
    /// Reads the robot's firmware version (row F5).
    ReadFirmwareVersion,
    /// Moves all servos (row FB). (`action`)
    Act,
    /// Connects or disconnects the servo offset tool (row F4). (`connected`)
    SetOffsetTool,
    /// Sets the robot's USB device type (row F9). (`usb_type`)
    SetUsbType,
    /// Plays an action (row F3). (`name`, `name_len`)
    Play,
    /// Moves a servo, or all servos without an answer. (`servo_id`, `angle_degrees`, `time_ms`, `lock_ms`)
    ServoMove,
    /// Switches the motor of a servo off, or of all servos without an answer. (`servo_id`)
    ServoRelease,
    /// Switches the LED of a servo, or of all servos without an answer. (`servo_id`, `led`)
    ServoSetLed,
    /// Reads a servo's target and actual angle. The servo switches its motor off. (`servo_id`)
    ServoReadAngles,
    /// Changes a servo's id. (`servo_id`, `new_servo_id`)
    ServoChangeId,
    /// Sets a servo's zero offset. (`servo_id`, `offset_thirds_of_degree`)
    ServoSetOffset,
    /// Reads a servo's zero offset. (`servo_id`)
    ServoReadOffset,
    /// Reads the version of a servo's firmware. (`servo_id`)
    ServoReadVersion,
}

/// A request received by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireAlpha1Request {
    /// The kind: an `ArmwireAlpha1RequestKind`.
    pub kind: u32,
    /// State of the offset tool: 1 connected, 0 disconnected.
    pub connected: u8,
    /// The new USB device type of the robot: an `ArmwireAlpha1UsbType`.
    pub usb_type: u8,
    /// The servo, 1 to 240; 0 for all.
    pub servo_id: u8,
    /// The new id of the servo.
    pub new_servo_id: u8,
    /// The byte for the LED. The sources contradict each other on its meaning.
    pub led: u8,
    /// Target of a servo.
    pub angle_degrees: u8,
    /// Zero offset of a servo, -90 to 90.
    pub offset_thirds_of_degree: i16,
    /// Duration of the motion.
    pub time_ms: u32,
    /// The completion time, which the servos' manual also calls lock time.
    pub lock_ms: u32,
    /// The action.
    pub action: ArmwireAlpha1Action,
    /// The name of an action, valid until the next call with the device.
    pub name: *const u8,
    /// Bytes of `name`.
    pub name_len: usize,
}

impl ArmwireAlpha1Request {
    /// Sets all members from a request.
    pub(super) fn set(&mut self, request: Option<Request<'_>>) {
        *self = Self::default();
        let kind = match request {
            Some(Request::ReadHardwareVersion) => ArmwireAlpha1RequestKind::ReadHardwareVersion,
            Some(Request::ReadServoStates) => ArmwireAlpha1RequestKind::ReadServoStates,
            Some(Request::Stop) => ArmwireAlpha1RequestKind::Stop,
            Some(Request::ReadFirmwareVersion) => ArmwireAlpha1RequestKind::ReadFirmwareVersion,
            Some(Request::Act(action)) => {
                self.action = ArmwireAlpha1Action::of(&action);
                ArmwireAlpha1RequestKind::Act
            }
            Some(Request::SetOffsetTool(tool)) => {
                self.connected = tool as u8;
                ArmwireAlpha1RequestKind::SetOffsetTool
            }
            Some(Request::SetUsbType(usb)) => {
                self.usb_type = usb as u8;
                ArmwireAlpha1RequestKind::SetUsbType
            }
            Some(Request::Play(name)) => {
                (self.name, self.name_len) = (name.as_bytes().as_ptr(), name.as_bytes().len());
                ArmwireAlpha1RequestKind::Play
            }
            Some(Request::Servo(request)) => self.set_servo(request),
            None | Some(_) => ArmwireAlpha1RequestKind::None,
        };
        self.kind = kind as u32;
    }

    fn set_servo(&mut self, request: ServoRequest) -> ArmwireAlpha1RequestKind {
        match request {
            ServoRequest::Move { to, angle, time, lock } => {
                (self.servo_id, self.angle_degrees) = (to.id(), angle.raw());
                self.time_ms = u32::from(time.units()) * UNIT_MS;
                self.lock_ms = u32::from(lock.units()) * UNIT_MS;
                ArmwireAlpha1RequestKind::ServoMove
            }
            ServoRequest::Release(to) => {
                self.servo_id = to.id();
                ArmwireAlpha1RequestKind::ServoRelease
            }
            ServoRequest::SetLed { to, led } => {
                (self.servo_id, self.led) = (to.id(), led.0);
                ArmwireAlpha1RequestKind::ServoSetLed
            }
            ServoRequest::ReadAngles(servo) => {
                self.servo_id = servo.get();
                ArmwireAlpha1RequestKind::ServoReadAngles
            }
            ServoRequest::ChangeId { from, to } => {
                (self.servo_id, self.new_servo_id) = (from.get(), to.get());
                ArmwireAlpha1RequestKind::ServoChangeId
            }
            ServoRequest::SetOffset(servo, offset) => {
                (self.servo_id, self.offset_thirds_of_degree) = (servo.get(), offset.thirds());
                ArmwireAlpha1RequestKind::ServoSetOffset
            }
            ServoRequest::ReadOffset(servo) => {
                self.servo_id = servo.get();
                ArmwireAlpha1RequestKind::ServoReadOffset
            }
            ServoRequest::ReadVersion(servo) => {
                self.servo_id = servo.get();
                ArmwireAlpha1RequestKind::ServoReadVersion
            }
            _ => ArmwireAlpha1RequestKind::None,
        }
    }
}

/// A message of the robot or of a servo.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireAlpha1ResponseKind {
    /// None.
    None = 0,
    /// The hardware version. (`text`, `text_len`)
    HardwareVersion,
    /// The running servos. (`running_servos`)
    ServoStates,
    /// Outcome of a stop. (`success`)
    Stopped,
    /// The firmware version. (`success`, `firmware_version`)
    FirmwareVersion,
    /// Outcome of an action frame. (`success`)
    Acted,
    /// Outcome of a change of the offset tool. (`success`)
    OffsetTool,
    /// Outcome of a change of the USB device type. (`success`)
    UsbType,
    /// Outcome of the start of an action. (`success`)
    Playing,
    /// A servo accepted a move, a release or an LED setting. (`servo_id`)
    ServoAcknowledged,
    /// Angles of a servo. Its motor is off now. (`servo_id`, `success`, `target_degrees`, `actual_degrees`)
    ServoAngles,
    /// Outcome of a change of a servo's id. (`servo_id`, `success`, `previous_servo_id`)
    ServoIdChanged,
    /// Outcome of a change of a servo's zero offset. (`servo_id`, `success`)
    ServoOffsetSet,
    /// The zero offset of a servo. (`servo_id`, `success`, `offset_thirds_of_degree`)
    ServoOffset,
    /// The version of a servo's firmware. (`servo_id`, `success`, `servo_version`)
    ServoVersion,
}

/// A response received by a client or sent by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireAlpha1Response {
    /// The kind: an `ArmwireAlpha1ResponseKind`.
    pub kind: u32,
    /// Outcome: 1 success, 0 failure.
    pub success: u8,
    /// The servo that responds, 1 to 240.
    pub servo_id: u8,
    /// The previous id of the servo.
    pub previous_servo_id: u8,
    /// Firmware version of the robot, ASCII, year first; arbitrary bytes after a failure.
    pub firmware_version: [u8; 10],
    /// Firmware version of a servo. The meaning of its bytes is not documented.
    pub servo_version: [u8; 4],
    /// Target angle of the servo.
    pub target_degrees: u16,
    /// Actual angle of the servo.
    pub actual_degrees: u16,
    /// Zero offset of a servo, as sent: -90 to 90.
    pub offset_thirds_of_degree: i16,
    /// One bit per servo, servo 1 lowest: 1 is running, 0 can be turned by hand, or is not there.
    pub running_servos: u32,
    /// The hardware version, 0 to 254 bytes without a documented character set. In a client it is valid until the next
    /// call.
    pub text: *const u8,
    /// Bytes of `text`.
    pub text_len: usize,
}

fn outcome(success: u8) -> Result<Outcome, Refused> {
    match flag("success", success)? {
        true => Ok(Outcome::Success),
        false => Ok(Outcome::Failure),
    }
}

impl ArmwireAlpha1Response {
    /// Sets all members from a response.
    pub(super) fn set(&mut self, response: Option<Response<'_>>) {
        *self = Self::default();
        let kind = match response {
            Some(Response::HardwareVersion(text)) => {
                (self.text, self.text_len) = (text.as_bytes().as_ptr(), text.as_bytes().len());
                ArmwireAlpha1ResponseKind::HardwareVersion
            }
            Some(Response::ServoStates(states)) => {
                self.running_servos = states.bits();
                ArmwireAlpha1ResponseKind::ServoStates
            }
            Some(Response::Stopped(outcome)) => self.set_outcome(outcome, ArmwireAlpha1ResponseKind::Stopped),
            Some(Response::FirmwareVersion(FirmwareVersion { outcome, text })) => {
                self.firmware_version = text;
                self.set_outcome(outcome, ArmwireAlpha1ResponseKind::FirmwareVersion)
            }
            Some(Response::Acted(outcome)) => self.set_outcome(outcome, ArmwireAlpha1ResponseKind::Acted),
            Some(Response::OffsetTool(outcome)) => self.set_outcome(outcome, ArmwireAlpha1ResponseKind::OffsetTool),
            Some(Response::UsbType(outcome)) => self.set_outcome(outcome, ArmwireAlpha1ResponseKind::UsbType),
            Some(Response::Playing(outcome)) => self.set_outcome(outcome, ArmwireAlpha1ResponseKind::Playing),
            Some(Response::Servo(response)) => self.set_servo(response),
            None | Some(_) => ArmwireAlpha1ResponseKind::None,
        };
        self.kind = kind as u32;
    }

    fn set_outcome(&mut self, outcome: Outcome, kind: ArmwireAlpha1ResponseKind) -> ArmwireAlpha1ResponseKind {
        self.success = outcome.is_success().into();
        kind
    }

    fn set_servo(&mut self, response: ServoResponse) -> ArmwireAlpha1ResponseKind {
        let (servo, outcome, kind) = match response {
            ServoResponse::Acknowledged(servo) => {
                self.servo_id = servo.get();
                return ArmwireAlpha1ResponseKind::ServoAcknowledged;
            }
            ServoResponse::Angles {
                servo,
                outcome,
                target,
                actual,
            } => {
                (self.target_degrees, self.actual_degrees) = (target, actual);
                (servo, outcome, ArmwireAlpha1ResponseKind::ServoAngles)
            }
            ServoResponse::IdChanged { servo, outcome, was } => {
                self.previous_servo_id = was;
                (servo, outcome, ArmwireAlpha1ResponseKind::ServoIdChanged)
            }
            ServoResponse::OffsetSet { servo, outcome } => (servo, outcome, ArmwireAlpha1ResponseKind::ServoOffsetSet),
            ServoResponse::Offset { servo, outcome, thirds } => {
                self.offset_thirds_of_degree = thirds;
                (servo, outcome, ArmwireAlpha1ResponseKind::ServoOffset)
            }
            ServoResponse::Version {
                servo,
                outcome,
                version,
            } => {
                self.servo_version = version;
                (servo, outcome, ArmwireAlpha1ResponseKind::ServoVersion)
            }
            _ => return ArmwireAlpha1ResponseKind::None,
        };
        self.servo_id = servo.get();
        self.set_outcome(outcome, kind)
    }

    /// # Safety
    ///
    /// `text` is NULL, or has `text_len` bytes.
    pub(super) unsafe fn get(&self) -> Result<Response<'_>, Refusal> {
        let kind = |kind: ArmwireAlpha1ResponseKind| self.kind == kind as u32;
        if kind(ArmwireAlpha1ResponseKind::HardwareVersion) {
            // SAFETY: guaranteed by the caller.
            let bytes = unsafe { memory::bytes(self.text, self.text_len) }.map_err(Refusal::Status)?;
            return Ok(Response::HardwareVersion(text(bytes)?));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoStates) {
            return Ok(Response::ServoStates(ServoStates::from_bits(self.running_servos)));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoAcknowledged) {
            return Ok(Response::Servo(ServoResponse::Acknowledged(servo(self.servo_id)?)));
        }
        let outcome = outcome(self.success);
        if kind(ArmwireAlpha1ResponseKind::Stopped) {
            return Ok(Response::Stopped(outcome?));
        }
        if kind(ArmwireAlpha1ResponseKind::FirmwareVersion) {
            return Ok(Response::FirmwareVersion(FirmwareVersion {
                outcome: outcome?,
                text: self.firmware_version,
            }));
        }
        if kind(ArmwireAlpha1ResponseKind::Acted) {
            return Ok(Response::Acted(outcome?));
        }
        if kind(ArmwireAlpha1ResponseKind::OffsetTool) {
            return Ok(Response::OffsetTool(outcome?));
        }
        if kind(ArmwireAlpha1ResponseKind::UsbType) {
            return Ok(Response::UsbType(outcome?));
        }
        if kind(ArmwireAlpha1ResponseKind::Playing) {
            return Ok(Response::Playing(outcome?));
        }
        let servo = servo(self.servo_id);
        if kind(ArmwireAlpha1ResponseKind::ServoAngles) {
            return Ok(Response::Servo(ServoResponse::Angles {
                servo: servo?,
                outcome: outcome?,
                target: self.target_degrees,
                actual: self.actual_degrees,
            }));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoIdChanged) {
            return Ok(Response::Servo(ServoResponse::IdChanged {
                servo: servo?,
                outcome: outcome?,
                was: self.previous_servo_id,
            }));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoOffsetSet) {
            return Ok(Response::Servo(ServoResponse::OffsetSet {
                servo: servo?,
                outcome: outcome?,
            }));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoOffset) {
            return Ok(Response::Servo(ServoResponse::Offset {
                servo: servo?,
                outcome: outcome?,
                thirds: self.offset_thirds_of_degree,
            }));
        }
        if kind(ArmwireAlpha1ResponseKind::ServoVersion) {
            return Ok(Response::Servo(ServoResponse::Version {
                servo: servo?,
                outcome: outcome?,
                version: self.servo_version,
            }));
        }
        Err(Refusal::Status(ArmwireStatus::UnknownKind))
    }
}
