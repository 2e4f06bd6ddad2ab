//! The messages of the xArm page, by register, and their encoding.

use super::frame::{HEARTBEAT_ID, MODBUS_ID, put};
use super::value::{
    Joint, ModbusFunction, Raw, Register, RotationRadius, SerialsText, State, TorqueSource, VersionText,
};
use super::{Direction, Frame, HEARTBEAT, Key, MessageId, XArm};
use crate::error::{self, Cause, ParseError};
use crate::framing::write;
use crate::messages::Messages;
use crate::{BufferTooShort, OutOfRange};

/// The parameter of register 10.
mod control {
    pub(super) const SHUTDOWN: u8 = 1;
    pub(super) const REBOOT: u8 = 2;
}

/// Modbus: the server has no such function.
const ILLEGAL_FUNCTION: u8 = 0x01;

/// A message of the host. The client assigns its number; its protocol id is that of [`XArm`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Request<'a> {
    /// A heartbeat. Not answered.
    Heartbeat,
    /// Register 1: versions. Answered by [`Reply::Version`].
    ReadVersion,
    /// Register 2: serial numbers. Answered by [`Reply::Serials`].
    ReadSerials,
    /// Register 4: reloads the friction parameters. Answered by [`Reply::Empty`].
    ReloadDynamics,
    /// Register 5: the quantity that is reported as torque. Answered by [`Reply::TorqueSource`].
    ReadTorqueSource,
    /// Register 6: the radius of rotation of a joint relative to the tool. Answered by [`Reply::RotationRadius`].
    ReadRotationRadius(Joint),
    /// Register 10: shuts the arm's operating system down. Answered by [`Reply::Empty`].
    Shutdown,
    /// Register 10: restarts the arm's operating system. Answered by [`Reply::Empty`].
    Reboot,
    /// Any other register. Answered by [`Reply::Raw`].
    ///
    /// The timeout of the answer is 10 s, as in the vendor's package for a move. For identification that package waits
    /// 300 to 500 s: for such registers use a client with a corresponding [`Config::latency`](crate::Config::latency),
    /// which extends the timeout of all its calls.
    Raw(Raw<'a>),
}

impl Request<'_> {
    /// The register; `None` for a heartbeat.
    ///
    /// ```
    /// assert_eq!(armwire::xarm::Request::Reboot.register(), Some(10));
    /// ```
    pub const fn register(&self) -> Option<u8> {
        Some(match self {
            Self::Heartbeat => return None,
            Self::ReadVersion => Register::Version as u8,
            Self::ReadSerials => Register::Serials as u8,
            Self::ReloadDynamics => Register::ReloadDynamics as u8,
            Self::ReadTorqueSource => Register::TorqueSource as u8,
            Self::ReadRotationRadius(_) => Register::RotationRadius as u8,
            Self::Shutdown | Self::Reboot => Register::SystemControl as u8,
            Self::Raw(raw) => raw.register(),
        })
    }
}

/// A message of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Response<'a> {
    /// A heartbeat, always unsolicited.
    Heartbeat,
    /// Answers every other [`Request`].
    Reply {
        /// The state of the arm.
        state: State,
        /// The answer.
        reply: Reply<'a>,
    },
    /// Answers a request in standard Modbus, which is not part of [`Request`]: exception 01, illegal function.
    ModbusRefused {
        /// The Modbus unit of the request.
        unit: u8,
        /// The Modbus function of the request.
        function: ModbusFunction,
    },
}

impl Response<'_> {
    /// The response of an arm to an invalid request: an invalid state in the private protocol, an illegal function in
    /// Modbus. `None` if the frame has no register or function.
    ///
    /// Neither is documented. The vendor's package recognises the invalid state, and waits 2 s for a missing answer.
    ///
    /// ```
    /// use armwire::correlation::Correlation;
    /// use armwire::messages::Messages;
    /// use armwire::xarm::{MAX_FRAME, Response, XArm};
    ///
    /// let (arm, frame) = (XArm::PRIVATE, [0, 7, 0, 3, 0, 2, 6, 8]); // joint 8 does not exist
    /// let error = arm.parse_request(&frame).unwrap_err();
    /// assert_eq!(error.to_string(), "register 6: joint is 8, must be 1..=7 (data byte 0)");
    /// let key = arm.request(&frame).map(|info| info.key);
    /// let mut out = [0; MAX_FRAME];
    /// let n = arm.encode_response(&Response::refusal(&error).unwrap(), key, &mut out)?;
    /// assert_eq!(out[..n], [0, 7, 0, 3, 0, 2, 6, 0x08]);
    /// # Ok::<(), armwire::BufferTooShort>(())
    /// ```
    pub const fn refusal(error: &ParseError) -> Option<Self> {
        match error.message {
            error::MessageId::XArm(MessageId::Modbus { unit, function }) => Some(Self::ModbusRefused {
                unit,
                function: ModbusFunction::of_byte(function),
            }),
            error::MessageId::XArm(MessageId::Register(register)) => Some(Self::Reply {
                state: State::INVALID,
                reply: Reply::empty(register),
            }),
            _ => None,
        }
    }
}

/// The content of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Reply<'a> {
    /// No parameters. Registers 4 and 10 have none; on other registers the arm has no value, and [`State::INVALID`] has
    /// the reason.
    Empty(Register),
    /// Answers [`Request::ReadVersion`].
    Version(VersionText<'a>),
    /// Answers [`Request::ReadSerials`].
    Serials(SerialsText<'a>),
    /// Answers [`Request::ReadTorqueSource`].
    TorqueSource(TorqueSource),
    /// Answers [`Request::ReadRotationRadius`].
    RotationRadius(RotationRadius),
    /// Answers [`Request::Shutdown`] and [`Request::Reboot`] with an undocumented number. It is accepted from an arm; a
    /// virtual arm should send [`Empty`](Self::Empty).
    SystemControl(u16),
    /// Answers [`Request::Raw`].
    Raw(Raw<'a>),
}

impl Reply<'_> {
    /// A reply without parameters, of any register.
    ///
    /// ```
    /// use armwire::xarm::{Raw, Register, Reply};
    ///
    /// assert_eq!(Reply::empty(4), Reply::Empty(Register::ReloadDynamics));
    /// assert_eq!(Reply::empty(11), Reply::Raw(Raw::new(11, &[]).unwrap()));
    /// ```
    pub const fn empty(register: u8) -> Self {
        match Register::from_code(register) {
            Some(register) => Self::Empty(register),
            None => Self::Raw(Raw::from_wire(register, &[])),
        }
    }

    /// The register.
    ///
    /// ```
    /// assert_eq!(armwire::xarm::Reply::SystemControl(1).register(), 10);
    /// ```
    pub const fn register(&self) -> u8 {
        match self {
            Self::Empty(register) => *register as u8,
            Self::Version(_) => Register::Version as u8,
            Self::Serials(_) => Register::Serials as u8,
            Self::TorqueSource(_) => Register::TorqueSource as u8,
            Self::RotationRadius(_) => Register::RotationRadius as u8,
            Self::SystemControl(_) => Register::SystemControl as u8,
            Self::Raw(raw) => raw.register(),
        }
    }
}

/// The start of a message in a frame.
enum Start<'a> {
    Heartbeat,
    /// Register, and the bytes after it.
    Call(u8, &'a [u8]),
    Modbus {
        unit: u8,
        function: u8,
        rest: &'a [u8],
    },
}

impl<'a> Start<'a> {
    fn of(frame: &'a [u8]) -> Result<Self, ParseError> {
        let frame = Frame::parse(frame).ok_or(ParseError::NO_FRAME)?;
        match (frame.protocol, frame.body) {
            (HEARTBEAT_ID, _) => Ok(Self::Heartbeat),
            (MODBUS_ID, &[unit, function, ref rest @ ..]) => Ok(Self::Modbus { unit, function, rest }),
            (2 | 3, &[register, ref rest @ ..]) => Ok(Self::Call(register, rest)),
            _ => Err(ParseError::NO_FRAME),
        }
    }
}

/// Adds the register to a cause.
fn named(register: u8) -> impl Fn(Cause) -> ParseError {
    ParseError::of(error::MessageId::XArm(MessageId::Register(register)))
}

/// The error of a request or a response in standard Modbus.
const fn modbus(unit: u8, function: u8) -> ParseError {
    let function = ModbusFunction::of_byte(function).number();
    ParseError {
        message: error::MessageId::XArm(MessageId::Modbus { unit, function }),
        cause: Cause::Unknown,
    }
}

impl Messages for XArm {
    type Request<'a> = Request<'a>;
    type Response<'a> = Response<'a>;
    type EncodeError = BufferTooShort;

    fn encode_request(&self, request: &Request<'_>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let Some(register) = request.register() else {
            return write(out, HEARTBEAT.into_iter());
        };
        // The sender stamps the number.
        let mut encode = |params: &[u8]| put(out, 0, self.protocol as u16, [&[register], params]);
        match request {
            Request::ReadRotationRadius(joint) => encode(&[joint.number()]),
            Request::Shutdown => encode(&[control::SHUTDOWN]),
            Request::Reboot => encode(&[control::REBOOT]),
            Request::Raw(raw) => encode(raw.params()),
            Request::Heartbeat
            | Request::ReadVersion
            | Request::ReadSerials
            | Request::ReloadDynamics
            | Request::ReadTorqueSource => encode(&[]),
        }
    }

    fn encode_response(
        &self,
        response: &Response<'_>,
        to: Option<Key>,
        out: &mut [u8],
    ) -> Result<usize, BufferTooShort> {
        let (transaction, protocol) = match to {
            Some(key) => (key.transaction, key.protocol),
            None => (0, self.protocol as u16),
        };
        let (state, reply) = match response {
            Response::Reply { state, reply } => (state, reply),
            Response::Heartbeat => return write(out, HEARTBEAT.into_iter()),
            Response::ModbusRefused { unit, function } => {
                let body = [*unit, function.refused(), ILLEGAL_FUNCTION];
                return put(out, transaction, MODBUS_ID, [&body, &[]]);
            }
        };
        let mut encode = |params: &[u8]| put(out, transaction, protocol, [&[reply.register(), state.0], params]);
        match reply {
            Reply::Empty(_) => encode(&[]),
            Reply::Version(text) => encode(text.0),
            Reply::Serials(text) => encode(text.0),
            Reply::TorqueSource(source) => encode(&[*source as u8]),
            Reply::RotationRadius(radius) => encode(&radius.millimetres.to_le_bytes()),
            Reply::SystemControl(number) => encode(&number.to_be_bytes()),
            Reply::Raw(raw) => encode(raw.params()),
        }
    }

    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Request<'a>, ParseError> {
        match Start::of(frame)? {
            Start::Heartbeat => Ok(Request::Heartbeat),
            Start::Modbus { unit, function, .. } => Err(modbus(unit, function)),
            Start::Call(register, params) => parse_request(register, params).map_err(named(register)),
        }
    }

    fn parse_response<'a>(&self, frame: &'a [u8], _expect: Direction) -> Result<Response<'a>, ParseError> {
        match Start::of(frame)? {
            Start::Heartbeat => Ok(Response::Heartbeat),
            Start::Modbus {
                unit,
                function: function @ ModbusFunction::REFUSED..,
                rest: [ILLEGAL_FUNCTION],
            } => Ok(Response::ModbusRefused {
                unit,
                function: ModbusFunction::of_byte(function),
            }),
            Start::Modbus { unit, function, .. } => Err(modbus(unit, function)),
            Start::Call(register, rest) => parse_response(register, rest).map_err(named(register)),
        }
    }

    /// ```
    /// use armwire::messages::Messages;
    /// use armwire::xarm::{Direction, Reply, Response, State, TorqueSource, XArm};
    ///
    /// let frame = [0, 1, 0, 2, 0, 5, 5, 0, 1, 0x07, 0x08];
    /// let reply = Reply::TorqueSource(TorqueSource::Current);
    /// assert_eq!(XArm::PRIVATE.parse_response(&frame, Direction::Responses), Ok(Response::Reply { state: State::OK, reply }));
    /// assert_eq!(XArm::PRIVATE.extra(&frame), [0x07, 0x08]);
    /// ```
    fn extra<'a>(&self, frame: &'a [u8]) -> &'a [u8] {
        match Start::of(frame) {
            Ok(Start::Call(register, [_state, params @ ..])) => split_extra(register, params).1,
            _ => &[],
        }
    }
}

fn parse_request(register: u8, params: &[u8]) -> Result<Request<'_>, Cause> {
    let Some(typed) = Register::from_code(register) else {
        return Ok(Request::Raw(Raw::from_wire(register, params)));
    };
    let got = params.len();
    match (typed, params) {
        (Register::Version, []) => Ok(Request::ReadVersion),
        (Register::Serials, []) => Ok(Request::ReadSerials),
        (Register::ReloadDynamics, []) => Ok(Request::ReloadDynamics),
        (Register::TorqueSource, []) => Ok(Request::ReadTorqueSource),
        (Register::RotationRadius, [joint]) => match Joint::new(*joint) {
            Ok(joint) => Ok(Request::ReadRotationRadius(joint)),
            Err(error) => Err(Cause::value(0, error)),
        },
        (Register::SystemControl, [control::SHUTDOWN]) => Ok(Request::Shutdown),
        (Register::SystemControl, [control::REBOOT]) => Ok(Request::Reboot),
        (Register::SystemControl, [got]) => {
            let error = OutOfRange::new("system control", "", *got, control::SHUTDOWN, control::REBOOT);
            Err(Cause::value(0, error))
        }
        (Register::RotationRadius | Register::SystemControl, _) => Err(Cause::Length { expected: &[1], got }),
        _ => Err(Cause::Length { expected: &[0], got }),
    }
}

/// The state, and the parameters after it.
fn parse_response(register: u8, rest: &[u8]) -> Result<Response<'_>, Cause> {
    let [state, params @ ..] = rest else {
        return Err(Cause::Length { expected: &[1], got: 0 });
    };
    let state = State(*state);
    parse_reply(register, params).map(|reply| Response::Reply { state, reply })
}

/// Divides the parameters of a reply after the documented ones. Arms may send more: the vendor's package accepts any
/// number. Texts and undocumented registers have no length.
fn split_extra(register: u8, params: &[u8]) -> (&[u8], &[u8]) {
    let documented = match Register::from_code(register) {
        Some(Register::ReloadDynamics) => 0,
        Some(Register::TorqueSource) => 1,
        Some(Register::RotationRadius) => 4,
        // The page has an answer without parameters, and one with a number.
        Some(Register::SystemControl) if params.len() < 2 => 0,
        Some(Register::SystemControl) => 2,
        Some(Register::Version | Register::Serials) | None => params.len(),
    };
    params.split_at_checked(documented).unwrap_or((params, &[]))
}

fn parse_reply(register: u8, params: &[u8]) -> Result<Reply<'_>, Cause> {
    let (params, _) = split_extra(register, params);
    let Some(typed) = Register::from_code(register) else {
        return Ok(Reply::Raw(Raw::from_wire(register, params)));
    };
    match (typed, params) {
        (register, []) => Ok(Reply::Empty(register)),
        // The document has no length: "n Byte".
        (Register::Version, text) => Ok(Reply::Version(VersionText(text))),
        (Register::Serials, text) => Ok(Reply::Serials(SerialsText(text))),
        (Register::TorqueSource, [code]) => match TorqueSource::from_code(*code) {
            Ok(source) => Ok(Reply::TorqueSource(source)),
            Err(error) => Err(Cause::value(0, error)),
        },
        (Register::RotationRadius, &[a, b, c, d]) => {
            let millimetres = f32::from_le_bytes([a, b, c, d]);
            Ok(Reply::RotationRadius(RotationRadius { millimetres }))
        }
        (Register::SystemControl, &[high, low]) => Ok(Reply::SystemControl(u16::from_be_bytes([high, low]))),
        // The other registers accept any number of parameters.
        (_, params) => Err(Cause::Length {
            expected: &[0, 4],
            got: params.len(),
        }),
    }
}
