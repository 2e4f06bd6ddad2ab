//! Requests and responses as flat structures.

use armwire::OutOfRange;
use armwire::xarm::{
    Key, ModbusFunction, ProtocolId, Raw, RawError, Register, Reply, Request, Response, RotationRadius, SerialsText,
    State, TorqueSource, VersionText, XArm,
};

use crate::device::Refusal;
use crate::fault::Refused;
use crate::memory;
use crate::status::ArmwireStatus;

/// A protocol id: 2 or 3.
pub(super) fn protocol(id: u16) -> Result<ProtocolId, Refused> {
    let known = [ProtocolId::Private, ProtocolId::Supervised];
    let found = known.into_iter().find(|protocol| *protocol as u16 == id);
    found.ok_or(Refused::only(OutOfRange::new("protocol id", "", id, 2, 3)))
}

/// A register without types of its own, and its parameters.
pub(super) fn raw(register: u8, params: &[u8]) -> Result<Raw<'_>, Refused> {
    Raw::new(register, params).map_err(|error| match error {
        RawError::TooLong { max, got } => Refused::length(OutOfRange::new("parameters", "bytes", got, 0, max)),
        _ => Refused::only(OutOfRange::new(
            "register (this has types of its own)",
            "",
            register,
            11,
            255,
        )),
    })
}

/// A message of the host.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireXarmRequestKind {
    /// None.
    None = 0,
    /// A heartbeat. Not answered.
    Heartbeat,
    /// Versions (register 1).
    ReadVersion,
    /// Serial numbers (register 2).
    ReadSerials,
    /// Reloads the friction parameters (register 4).
    ReloadDynamics,
    /// The quantity reported as torque (register 5).
    ReadTorqueSource,
    /// The radius of rotation of a joint relative to the tool (register 6). (`joint`)
    ReadRotationRadius,
    /// Shuts the arm's operating system down (register 10).
    Shutdown,
    /// Restarts the arm's operating system (register 10).
    Reboot,
    /// Any other register. (`params`, `params_len`)
    Raw,
}

/// A request received by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireXarmRequest {
    /// The kind: an `ArmwireXarmRequestKind`.
    pub kind: u32,
    /// The request's number, which its response repeats. Every frame sets it, `protocol_id` and `reg`.
    pub transaction_id: u16,
    /// 2 or 3; 1 for a heartbeat, 0 for standard Modbus.
    pub protocol_id: u16,
    /// The register; in standard Modbus the function.
    pub reg: u8,
    /// The joint, 1 to 7.
    pub joint: u8,
    /// Parameters, valid until the next call with the device.
    pub params: *const u8,
    /// Bytes of `params`.
    pub params_len: usize,
}

impl ArmwireXarmRequest {
    /// Sets all members from a request.
    pub(super) fn set(&mut self, request: Option<Request<'_>>, key: Option<Key>) {
        let key = key.unwrap_or(Key {
            transaction: 0,
            protocol: XArm::PRIVATE.protocol as u16,
            register: 0,
        });
        *self = Self {
            transaction_id: key.transaction,
            protocol_id: key.protocol,
            reg: key.register,
            ..Self::default()
        };
        let kind = match request {
            Some(Request::Heartbeat) => ArmwireXarmRequestKind::Heartbeat,
            Some(Request::ReadVersion) => ArmwireXarmRequestKind::ReadVersion,
            Some(Request::ReadSerials) => ArmwireXarmRequestKind::ReadSerials,
            Some(Request::ReloadDynamics) => ArmwireXarmRequestKind::ReloadDynamics,
            Some(Request::ReadTorqueSource) => ArmwireXarmRequestKind::ReadTorqueSource,
            Some(Request::ReadRotationRadius(joint)) => {
                self.joint = joint.number();
                ArmwireXarmRequestKind::ReadRotationRadius
            }
            Some(Request::Shutdown) => ArmwireXarmRequestKind::Shutdown,
            Some(Request::Reboot) => ArmwireXarmRequestKind::Reboot,
            Some(Request::Raw(raw)) => {
                (self.params, self.params_len) = (raw.params().as_ptr(), raw.params().len());
                ArmwireXarmRequestKind::Raw
            }
            None | Some(_) => ArmwireXarmRequestKind::None,
        };
        self.kind = kind as u32;
    }

    /// The key of its response.
    pub(super) const fn key(&self) -> Key {
        Key {
            transaction: self.transaction_id,
            protocol: self.protocol_id,
            register: self.reg,
        }
    }
}

/// A message of the arm.
#[repr(u32)]
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ArmwireXarmResponseKind {
    /// None.
    None = 0,
    /// A heartbeat, always unsolicited.
    Heartbeat,
    /// A reply without parameters. (`state`, `reg`)
    Empty,
    /// Versions: text, padded with NUL. (`state`, `data`, `data_len`)
    Version,
    /// Serial numbers: that of the arm, NUL, that of the control box, a line feed, padded with NUL.
    /// (`state`, `data`, `data_len`)
    Serials,
    /// The quantity reported as torque. (`state`, `torque_source`)
    TorqueSource,
    /// The radius of rotation of a joint relative to the tool. (`state`, `rotation_radius_mm`)
    RotationRadius,
    /// The answer of an arm to shutdown or reboot with an undocumented number. (`state`, `system_control`)
    SystemControl,
    /// The answer of any other register. (`state`, `reg`, `data`, `data_len`)
    Raw,
    /// The refusal of a request in standard Modbus: illegal function. (`modbus_unit`, `modbus_function`)
    ModbusRefused,
}

/// A response received by a client or sent by a device. Members that its kind does not set are 0.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default)]
pub struct ArmwireXarmResponse {
    /// The kind: an `ArmwireXarmResponseKind`.
    pub kind: u32,
    /// State bits of the arm and the request: 0x08 refused or failed, 0x10 not ready to move, 0x20 warning, 0x40 error.
    pub state: u8,
    /// The register.
    pub reg: u8,
    /// 0 is the torque of the joint, computed; 1 is the current of the servo, measured.
    pub torque_source: u8,
    /// The unit of a request in standard Modbus.
    pub modbus_unit: u8,
    /// The function of a request in standard Modbus, 0 to 127.
    pub modbus_function: u8,
    /// An undocumented number.
    pub system_control: u16,
    /// The radius of rotation, as received: any number.
    pub rotation_radius_mm: f32,
    /// Text or parameters, 0 to 252 bytes. In a client they are valid until the next call.
    pub data: *const u8,
    /// Bytes of `data`.
    pub data_len: usize,
}

impl ArmwireXarmResponse {
    /// Sets all members from a response.
    pub(super) fn set(&mut self, response: Option<Response<'_>>) {
        *self = Self::default();
        let kind = match response {
            Some(Response::Heartbeat) => ArmwireXarmResponseKind::Heartbeat,
            Some(Response::Reply { state, reply }) => {
                (self.state, self.reg) = (state.0, reply.register());
                self.set_reply(reply)
            }
            Some(Response::ModbusRefused { unit, function }) => {
                (self.modbus_unit, self.modbus_function) = (unit, function.number());
                ArmwireXarmResponseKind::ModbusRefused
            }
            None | Some(_) => ArmwireXarmResponseKind::None,
        };
        self.kind = kind as u32;
    }

    fn set_reply(&mut self, reply: Reply<'_>) -> ArmwireXarmResponseKind {
        let (data, kind): (&[u8], _) = match reply {
            Reply::Empty(_) => (&[], ArmwireXarmResponseKind::Empty),
            Reply::Version(text) => (text.0, ArmwireXarmResponseKind::Version),
            Reply::Serials(text) => (text.0, ArmwireXarmResponseKind::Serials),
            Reply::TorqueSource(source) => {
                self.torque_source = source as u8;
                (&[], ArmwireXarmResponseKind::TorqueSource)
            }
            Reply::RotationRadius(radius) => {
                self.rotation_radius_mm = radius.millimetres;
                (&[], ArmwireXarmResponseKind::RotationRadius)
            }
            Reply::SystemControl(number) => {
                self.system_control = number;
                (&[], ArmwireXarmResponseKind::SystemControl)
            }
            Reply::Raw(raw) => (raw.params(), ArmwireXarmResponseKind::Raw),
            _ => (&[], ArmwireXarmResponseKind::None),
        };
        if !data.is_empty() {
            (self.data, self.data_len) = (data.as_ptr(), data.len());
        }
        kind
    }

    /// # Safety
    ///
    /// `data` is NULL, or has `data_len` bytes.
    pub(super) unsafe fn get(&self) -> Result<Response<'_>, Refusal> {
        let kind = |kind: ArmwireXarmResponseKind| self.kind == kind as u32;
        if kind(ArmwireXarmResponseKind::Heartbeat) {
            return Ok(Response::Heartbeat);
        }
        if kind(ArmwireXarmResponseKind::ModbusRefused) {
            return Ok(Response::ModbusRefused {
                unit: self.modbus_unit,
                function: ModbusFunction::new(self.modbus_function).map_err(Refused::only)?,
            });
        }
        // SAFETY: guaranteed by the caller.
        let data = || unsafe { memory::bytes(self.data, self.data_len) }.map_err(Refusal::Status);
        let reply = if kind(ArmwireXarmResponseKind::Empty) {
            let register = Register::from_code(self.reg);
            let error = OutOfRange::new("register (this is RAW)", "", self.reg, 1, 10);
            Reply::Empty(register.ok_or(Refused::only(error))?)
        } else if kind(ArmwireXarmResponseKind::Version) {
            Reply::Version(VersionText(text(data()?)?))
        } else if kind(ArmwireXarmResponseKind::Serials) {
            Reply::Serials(SerialsText(text(data()?)?))
        } else if kind(ArmwireXarmResponseKind::TorqueSource) {
            Reply::TorqueSource(torque_source(self.torque_source)?)
        } else if kind(ArmwireXarmResponseKind::RotationRadius) {
            Reply::RotationRadius(RotationRadius {
                millimetres: self.rotation_radius_mm,
            })
        } else if kind(ArmwireXarmResponseKind::SystemControl) {
            Reply::SystemControl(self.system_control)
        } else if kind(ArmwireXarmResponseKind::Raw) {
            Reply::Raw(raw(self.reg, data()?)?)
        } else {
            return Err(Refusal::Status(ArmwireStatus::UnknownKind));
        };
        Ok(Response::Reply {
            state: State(self.state),
            reply,
        })
    }
}

/// A text that fits into a frame and is not empty: an empty one would be another reply.
fn text(data: &[u8]) -> Result<&[u8], Refused> {
    const MAX: usize = armwire::xarm::MAX_PARAMS;
    match data.len() {
        1..=MAX => Ok(data),
        got => Err(Refused::length(OutOfRange::new("text", "bytes", got, 1, MAX))),
    }
}

fn torque_source(code: u8) -> Result<TorqueSource, Refused> {
    let known = [TorqueSource::Torque, TorqueSource::Current];
    let found = known.into_iter().find(|source| *source as u8 == code);
    found.ok_or(Refused::only(OutOfRange::new("torque source", "", code, 0, 1)))
}
