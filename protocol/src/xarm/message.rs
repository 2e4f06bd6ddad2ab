//! The messages of the xArm page, by register, and the bytes they travel as.

use core::fmt;

use super::frame::{HEARTBEAT_ID, MODBUS_ID, put};
use super::value::{
    Joint, ModbusFunction, ProtocolId, Raw, RawError, RawRef, Register, RotationRadius, SerialsText, State, TEXT,
    TorqueSource, VersionText, padded,
};
use super::{Direction, Frame, MAX_FRAME, XArm};
use crate::error::write_either;
use crate::{BufferTooShort, Micros, OutOfRange, Protocol};

/// The parameter of register 10.
mod control {
    pub(super) const SHUTDOWN: u8 = 1;
    pub(super) const REBOOT: u8 = 2;
}

/// Modbus: the server has no such function.
const ILLEGAL_FUNCTION: u8 = 0x01;

/// [`HEARTBEAT`](super::HEARTBEAT) as a frame.
const HEARTBEAT: Frame<'_> = Frame {
    transaction: 0,
    protocol: HEARTBEAT_ID,
    body: &[0, 0],
};

/// What the host says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Request {
    /// Says that the host is there. Not answered.
    Heartbeat,
    /// Asks something of the arm. Answered by [`Response::Reply`] with the same header and register.
    Call {
        /// Which call it is.
        header: Header,
        /// What is asked.
        command: Command,
    },
}

/// What a response has in common with its request, and with no other.
///
/// ```
/// use armwire::xarm::{Header, ProtocolId, Transactions};
///
/// let mut transactions = Transactions::new();
/// let header = Header { transaction: transactions.next_id(), protocol: ProtocolId::Private };
/// assert_eq!(header.transaction, 1);
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Header {
    /// Transaction id. Hosts count `1..=65535` (see [`Transactions`]); an arm gives back whatever comes, 0 too.
    pub transaction: u16,
    /// Protocol id.
    pub protocol: ProtocolId,
}

/// Gives transaction ids: `1..=65535`, and then 1 again.
#[derive(Clone, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Transactions {
    last: u16,
}

impl Transactions {
    /// Starts at 1.
    pub const fn new() -> Self {
        Self { last: 0 }
    }

    /// The next id.
    pub const fn next_id(&mut self) -> u16 {
        self.last = match self.last {
            u16::MAX => 1,
            last => last + 1,
        };
        self.last
    }
}

impl Default for Transactions {
    fn default() -> Self {
        Self::new()
    }
}

/// What is asked of the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Command {
    /// Register 1: versions. Answered by [`Reply::Version`].
    ReadVersion,
    /// Register 2: serial numbers. Answered by [`Reply::Serials`].
    ReadSerials,
    /// Register 4: reloads the friction parameters. Answered by [`Reply::Empty`].
    ReloadDynamics,
    /// Register 5: what is reported as torque. Answered by [`Reply::TorqueSource`].
    ReadTorqueSource,
    /// Register 6: the radius of rotation of a joint relative to the tool. Answered by [`Reply::RotationRadius`].
    ReadRotationRadius(Joint),
    /// Register 10: shuts the arm's operating system down. Answered by [`Reply::Empty`].
    Shutdown,
    /// Register 10: restarts the arm's operating system. Answered by [`Reply::Empty`].
    Reboot,
    /// Any other register. Answered by [`Reply::Raw`].
    ///
    /// The answer is waited for 10 s, as the vendor's package does for a move. For identification that package waits
    /// 300 to 500 s: for such registers make a client with as much [`Config::latency`](crate::Config::latency). All its
    /// calls then wait so much longer before they time out.
    Raw(Raw),
}

impl Command {
    /// The register.
    ///
    /// ```
    /// assert_eq!(armwire::xarm::Command::Reboot.register(), 10);
    /// ```
    pub const fn register(&self) -> u8 {
        match self {
            Self::ReadVersion => Register::Version as u8,
            Self::ReadSerials => Register::Serials as u8,
            Self::ReloadDynamics => Register::ReloadDynamics as u8,
            Self::ReadTorqueSource => Register::TorqueSource as u8,
            Self::ReadRotationRadius(_) => Register::RotationRadius as u8,
            Self::Shutdown | Self::Reboot => Register::SystemControl as u8,
            Self::Raw(raw) => raw.register(),
        }
    }
}

/// What the arm says.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Response {
    /// Says that the arm is there. Answers nothing.
    Heartbeat,
    /// Answers [`Request::Call`].
    Reply {
        /// That of the request.
        header: Header,
        /// How the arm is.
        state: State,
        /// What was asked for.
        reply: Reply,
    },
    /// Answers a request in standard Modbus, which is none of [`Request`]: exception 01, no such function.
    ModbusRefused {
        /// Transaction id of the request.
        transaction: u16,
        /// The Modbus unit it was for.
        unit: u8,
        /// The Modbus function it asked for.
        function: ModbusFunction,
    },
}

/// What was asked for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Reply {
    /// No parameters. Registers 4 and 10 have none; on the others the arm has nothing to say, and
    /// [`State::INVALID`] says why.
    Empty(Register),
    /// Answers [`Command::ReadVersion`].
    Version(VersionText),
    /// Answers [`Command::ReadSerials`].
    Serials(SerialsText),
    /// Answers [`Command::ReadTorqueSource`].
    TorqueSource(TorqueSource),
    /// Answers [`Command::ReadRotationRadius`].
    RotationRadius(RotationRadius),
    /// Answers [`Command::Shutdown`] and [`Command::Reboot`] with a number of which the document does not say what it
    /// is. An arm that does so is understood; a virtual one should say [`Empty`](Self::Empty).
    SystemControl(u16),
    /// Answers [`Command::Raw`].
    Raw(Raw),
}

impl Reply {
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
            None => Self::Raw(Raw::empty(register)),
        }
    }

    /// The register.
    ///
    /// ```
    /// assert_eq!(armwire::xarm::Reply::SystemControl(1).register(), 10);
    /// ```
    pub const fn register(&self) -> u8 {
        self.borrowed().register()
    }

    /// The reply with its text or parameters borrowed.
    pub const fn borrowed(&self) -> ReplyRef<'_> {
        match self {
            Self::Empty(register) => ReplyRef::Empty(*register),
            Self::Version(text) => ReplyRef::Version(&text.0),
            Self::Serials(text) => ReplyRef::Serials(&text.0),
            Self::TorqueSource(source) => ReplyRef::TorqueSource(*source),
            Self::RotationRadius(radius) => ReplyRef::RotationRadius(*radius),
            Self::SystemControl(number) => ReplyRef::SystemControl(*number),
            Self::Raw(raw) => ReplyRef::Raw(raw.borrowed()),
        }
    }
}

/// A [`Response`] whose reply is borrowed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ResponseRef<'a> {
    /// [`Response::Heartbeat`].
    Heartbeat,
    /// [`Response::Reply`].
    Reply {
        /// That of the request.
        header: Header,
        /// How the arm is.
        state: State,
        /// What was asked for.
        reply: ReplyRef<'a>,
    },
    /// [`Response::ModbusRefused`].
    ModbusRefused {
        /// Transaction id of the request.
        transaction: u16,
        /// The Modbus unit it was for.
        unit: u8,
        /// The Modbus function it asked for.
        function: ModbusFunction,
    },
}

/// A [`Reply`] whose text or parameters are borrowed.
///
/// ```
/// use armwire::xarm::{Raw, Reply, ReplyRef};
///
/// let reply = Reply::Raw(Raw::new(19, &[1])?);
/// assert!(matches!(reply.borrowed(), ReplyRef::Raw(raw) if raw.params() == [1]));
/// assert_eq!(reply.borrowed().register(), 19);
/// # Ok::<(), armwire::xarm::RawError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ReplyRef<'a> {
    /// [`Reply::Empty`].
    Empty(Register),
    /// [`Reply::Version`].
    Version(&'a [u8; TEXT]),
    /// [`Reply::Serials`].
    Serials(&'a [u8; TEXT]),
    /// [`Reply::TorqueSource`].
    TorqueSource(TorqueSource),
    /// [`Reply::RotationRadius`].
    RotationRadius(RotationRadius),
    /// [`Reply::SystemControl`].
    SystemControl(u16),
    /// [`Reply::Raw`].
    Raw(RawRef<'a>),
}

impl ReplyRef<'_> {
    /// The register.
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

/// A good frame that is no message of the document.
///
/// ```
/// use armwire::Protocol;
/// use armwire::xarm::{Frame, XArm};
///
/// let frame = Frame { transaction: 7, protocol: 2, body: &[6, 8] };
/// let error = XArm::parse_request(frame).unwrap_err();
/// assert_eq!(error.to_string(), "register 6: joint is 8, must be 1..=7 (parameter byte 0)");
///
/// let frame = Frame { transaction: 7, protocol: 0, body: &[1, 3, 0, 0, 0, 2] };
/// let error = XArm::parse_request(frame).unwrap_err();
/// assert_eq!(error.to_string(), "protocol id 0, standard Modbus, expected 2 or 3 (unit 1, function 3)");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ParseError {
    /// A message of another protocol with the same header: standard Modbus TCP, if the id is 0.
    Protocol {
        /// Transaction id.
        transaction: u16,
        /// Protocol id.
        protocol: u16,
        /// Modbus unit.
        unit: u8,
        /// The Modbus function it asks for.
        function: ModbusFunction,
    },
    /// A register with parameters that it does not have.
    Call {
        /// The frame's header.
        header: Header,
        /// The frame's register.
        register: u8,
        /// What is wrong with its parameters.
        cause: Cause,
    },
}

impl ParseError {
    /// What an arm answers to such a request: to one of its own that its state is invalid, to Modbus that it does not
    /// have the function.
    ///
    /// Neither is documented. The vendor's package takes the first for what it is, and would wait 2 s for an answer
    /// that does not come.
    ///
    /// ```
    /// use armwire::Protocol;
    /// use armwire::xarm::{Frame, MAX_FRAME, XArm};
    ///
    /// let error = XArm::parse_request(Frame { transaction: 7, protocol: 3, body: &[6, 8] }).unwrap_err();
    /// let mut out = [0; MAX_FRAME];
    /// let n = XArm::encode_response(&error.refusal(), &mut out)?;
    /// assert_eq!(out[..n], [0, 7, 0, 3, 0, 2, 6, 0x08]);
    /// # Ok::<(), armwire::BufferTooShort>(())
    /// ```
    pub const fn refusal(&self) -> Response {
        match *self {
            Self::Protocol {
                transaction,
                unit,
                function,
                ..
            } => Response::ModbusRefused {
                transaction,
                unit,
                function,
            },
            Self::Call { header, register, .. } => Response::Reply {
                header,
                state: State::INVALID,
                reply: Reply::empty(register),
            },
        }
    }
}

/// What is wrong with the body of a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Cause {
    /// It is too short to have a register and, in a response, a state. The framing lets no such frame through.
    Body {
        /// The least bytes it may have.
        min: usize,
        /// How many it has.
        got: usize,
    },
    /// The parameters have the wrong length.
    Length {
        /// The lengths they may have, in bytes.
        expected: &'static [usize],
        /// The length they have, in bytes.
        got: usize,
    },
    /// There are more parameters than armwire takes. The framing lets no such frame through.
    Raw(RawError),
    /// A value is out of its range.
    Value {
        /// Where it is, in bytes from the start of the parameters.
        offset: usize,
        /// What it is and may be.
        error: OutOfRange,
    },
}

impl fmt::Display for ParseError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Protocol {
                protocol,
                unit,
                function,
                ..
            } => {
                let modbus = if *protocol == MODBUS_ID {
                    ", standard Modbus"
                } else {
                    ""
                };
                write!(
                    f,
                    "protocol id {protocol}{modbus}, expected 2 or 3 (unit {unit}, function {function})"
                )
            }
            Self::Call { register, cause, .. } => write!(f, "register {register}: {cause}"),
        }
    }
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Body { min, got } => write!(f, "body of {got} bytes, expected at least {min}"),
            Self::Raw(error) => error.fmt(f),
            Self::Length { expected, got } => {
                write!(f, "{got} bytes of parameters, expected ")?;
                write_either(f, expected, |f, length| write!(f, "{length}"))
            }
            Self::Value { offset, error } => write!(f, "{error} (parameter byte {offset})"),
        }
    }
}

impl core::error::Error for ParseError {}

/// What the header of a frame says it is.
enum Kind {
    Heartbeat,
    Call(Header),
    Other(ParseError),
}

fn kind(frame: Frame<'_>) -> Kind {
    let Frame {
        transaction, protocol, ..
    } = frame;
    let call = |protocol| Kind::Call(Header { transaction, protocol });
    match protocol {
        HEARTBEAT_ID => Kind::Heartbeat,
        2 => call(ProtocolId::Private),
        3 => call(ProtocolId::Supervised),
        _ => {
            let mut body = frame.body.iter().copied();
            Kind::Other(ParseError::Protocol {
                transaction,
                protocol,
                unit: body.next().unwrap_or_default(),
                function: ModbusFunction::of_byte(body.next().unwrap_or_default()),
            })
        }
    }
}

/// Writes a message of the arm's own protocol, whose body is in two parts.
fn encode(out: &mut [u8], header: &Header, start: &[u8], params: &[u8]) -> Result<usize, BufferTooShort> {
    put(out, header.transaction, header.protocol as u16, [start, params])
}

impl Protocol for XArm {
    const REQUESTS: Direction = Direction::Requests;
    const IDENTIFIED: bool = true;
    type Request = Request;
    type Response = Response;
    type ResponseRef<'a> = ResponseRef<'a>;
    type Error = ParseError;

    fn encode_request(request: &Request, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let Request::Call { header, command } = request else {
            return HEARTBEAT.put(out);
        };
        let mut encode = |params: &[u8]| encode(out, header, &[command.register()], params);
        match command {
            Command::ReadVersion | Command::ReadSerials | Command::ReloadDynamics | Command::ReadTorqueSource => {
                encode(&[])
            }
            Command::ReadRotationRadius(joint) => encode(&[joint.number()]),
            Command::Shutdown => encode(&[control::SHUTDOWN]),
            Command::Reboot => encode(&[control::REBOOT]),
            Command::Raw(raw) => encode(raw.params()),
        }
    }

    fn encode_response(response: &Response, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        let (header, state, reply) = match response {
            Response::Reply { header, state, reply } => (header, state, reply),
            Response::Heartbeat => return HEARTBEAT.put(out),
            Response::ModbusRefused {
                transaction,
                unit,
                function,
            } => {
                let frame = Frame {
                    transaction: *transaction,
                    protocol: MODBUS_ID,
                    body: &[*unit, function.refused(), ILLEGAL_FUNCTION],
                };
                return frame.put(out);
            }
        };
        let mut encode = |params: &[u8]| encode(out, header, &[reply.register(), state.0], params);
        match reply {
            Reply::Empty(_) => encode(&[]),
            Reply::Version(text) => encode(&text.0),
            Reply::Serials(text) => encode(&text.0),
            Reply::TorqueSource(source) => encode(&[*source as u8]),
            Reply::RotationRadius(radius) => encode(&radius.millimetres.to_le_bytes()),
            Reply::SystemControl(number) => encode(&number.to_be_bytes()),
            Reply::Raw(raw) => encode(raw.params()),
        }
    }

    fn parse_request(frame: Frame<'_>) -> Result<Request, ParseError> {
        let header = match kind(frame) {
            Kind::Heartbeat => return Ok(Request::Heartbeat),
            Kind::Other(error) => return Err(error),
            Kind::Call(header) => header,
        };
        // Each message is made where it is returned: they are long.
        let call = |command| Ok(Request::Call { header, command });
        let wrong = |cause| Err(unusable(header, frame, cause));
        let [register, params @ ..] = frame.body else {
            return wrong(Cause::Body { min: 1, got: 0 });
        };
        let Some(typed) = Register::from_code(*register) else {
            return match Raw::check(*register, params) {
                Ok(()) => call(Command::Raw(Raw::from_wire(*register, params))),
                Err(error) => wrong(Cause::Raw(error)),
            };
        };
        let length = |expected| {
            let got = params.len();
            wrong(Cause::Length { expected, got })
        };
        let value = |error| wrong(Cause::Value { offset: 0, error });
        match (typed, params) {
            (Register::Version, []) => call(Command::ReadVersion),
            (Register::Serials, []) => call(Command::ReadSerials),
            (Register::ReloadDynamics, []) => call(Command::ReloadDynamics),
            (Register::TorqueSource, []) => call(Command::ReadTorqueSource),
            (Register::RotationRadius, [joint]) => match Joint::new(*joint) {
                Ok(joint) => call(Command::ReadRotationRadius(joint)),
                Err(error) => value(error),
            },
            (Register::SystemControl, [control::SHUTDOWN]) => call(Command::Shutdown),
            (Register::SystemControl, [control::REBOOT]) => call(Command::Reboot),
            (Register::SystemControl, [got]) => value(OutOfRange {
                what: "system control",
                unit: "",
                got: (*got).into(),
                min: control::SHUTDOWN.into(),
                max: control::REBOOT.into(),
            }),
            (Register::RotationRadius | Register::SystemControl, _) => length(&[1]),
            _ => length(&[0]),
        }
    }

    fn parse_response_ref<'a>(frame: Self::Frame<'a>, _expect: Direction) -> Result<Self::ResponseRef<'a>, ParseError> {
        let header = match (kind(frame), frame.body) {
            (Kind::Heartbeat, _) => return Ok(ResponseRef::Heartbeat),
            (
                Kind::Other(ParseError::Protocol {
                    transaction,
                    unit,
                    function,
                    ..
                }),
                &[_, ModbusFunction::REFUSED..=u8::MAX, ILLEGAL_FUNCTION],
            ) => {
                return Ok(ResponseRef::ModbusRefused {
                    transaction,
                    unit,
                    function,
                });
            }
            (Kind::Other(error), _) => return Err(error),
            (Kind::Call(header), _) => header,
        };
        let answer = |state, reply| Ok(ResponseRef::Reply { header, state, reply });
        let wrong = |cause| Err(unusable(header, frame, cause));
        let [register, state, params @ ..] = frame.body else {
            let got = frame.body.len();
            return wrong(Cause::Body { min: 2, got });
        };
        let state = State(*state);
        let Some(typed) = Register::from_code(*register) else {
            return match Raw::check(*register, params) {
                Ok(()) => answer(state, ReplyRef::Raw(RawRef::from_wire(*register, params))),
                Err(error) => wrong(Cause::Raw(error)),
            };
        };
        let length = |expected| {
            let got = params.len();
            wrong(Cause::Length { expected, got })
        };
        match (typed, params) {
            (register, []) => answer(state, ReplyRef::Empty(register)),
            (Register::Version, text) => match text.try_into() {
                Ok(text) => answer(state, ReplyRef::Version(text)),
                Err(_) => length(&[0, TEXT]),
            },
            (Register::Serials, text) => match text.try_into() {
                Ok(text) => answer(state, ReplyRef::Serials(text)),
                Err(_) => length(&[0, TEXT]),
            },
            (Register::TorqueSource, [code]) => match TorqueSource::from_code(*code) {
                Ok(source) => answer(state, ReplyRef::TorqueSource(source)),
                Err(error) => wrong(Cause::Value { offset: 0, error }),
            },
            (Register::RotationRadius, &[a, b, c, d]) => {
                let millimetres = f32::from_le_bytes([a, b, c, d]);
                answer(state, ReplyRef::RotationRadius(RotationRadius { millimetres }))
            }
            (Register::SystemControl, &[high, low]) => {
                answer(state, ReplyRef::SystemControl(u16::from_be_bytes([high, low])))
            }
            (Register::ReloadDynamics, _) => length(&[0]),
            (Register::TorqueSource, _) => length(&[0, 1]),
            (Register::RotationRadius, _) => length(&[0, 4]),
            (Register::SystemControl, _) => length(&[0, 2]),
        }
    }

    // Inlined, it would add to the stack of all that its caller calls besides.
    #[inline(never)]
    fn to_response(response: &ResponseRef<'_>) -> Response {
        match response {
            ResponseRef::Heartbeat => Response::Heartbeat,
            ResponseRef::Reply { header, state, reply } => {
                // A response is made by each arm, where it is returned: it is long.
                let answer = |reply| Response::Reply {
                    header: *header,
                    state: *state,
                    reply,
                };
                match *reply {
                    ReplyRef::Empty(register) => answer(Reply::Empty(register)),
                    ReplyRef::Version(text) => answer(Reply::Version(VersionText(padded(text)))),
                    ReplyRef::Serials(text) => answer(Reply::Serials(SerialsText(padded(text)))),
                    ReplyRef::TorqueSource(source) => answer(Reply::TorqueSource(source)),
                    ReplyRef::RotationRadius(radius) => answer(Reply::RotationRadius(radius)),
                    ReplyRef::SystemControl(number) => answer(Reply::SystemControl(number)),
                    ReplyRef::Raw(raw) => answer(Reply::Raw(Raw::from_wire(raw.register(), raw.params()))),
                }
            }
            &ResponseRef::ModbusRefused {
                transaction,
                unit,
                function,
            } => Response::ModbusRefused {
                transaction,
                unit,
                function,
            },
        }
    }

    fn response_ref(response: &Response) -> ResponseRef<'_> {
        match response {
            Response::Heartbeat => ResponseRef::Heartbeat,
            Response::Reply { header, state, reply } => ResponseRef::Reply {
                header: *header,
                state: *state,
                reply: reply.borrowed(),
            },
            &Response::ModbusRefused {
                transaction,
                unit,
                function,
            } => ResponseRef::ModbusRefused {
                transaction,
                unit,
                function,
            },
        }
    }

    fn expect(_request: Option<&Request>) -> Direction {
        Direction::Responses
    }

    fn reply(request: &Request) -> Option<crate::Reply> {
        // The document gives no times. The vendor's package waits 2 s for a reading or a setting, and 10 s for a move.
        let turnaround = match request {
            Request::Heartbeat => return None,
            Request::Call {
                command: Command::Raw(_),
                ..
            } => Micros::from_millis(10_000),
            Request::Call { .. } => Micros::from_millis(2_000),
        };
        Some(crate::Reply {
            len: MAX_FRAME,
            turnaround,
        })
    }

    fn answers(request: &Request, response: &ResponseRef<'_>) -> bool {
        match (request, response) {
            (Request::Call { header, command }, ResponseRef::Reply { header: of, reply, .. }) => {
                header == of && command.register() == reply.register()
            }
            _ => false,
        }
    }

    fn is_response_to(request: &Request, frame: Frame<'_>) -> bool {
        match (request, kind(frame)) {
            (Request::Call { header, command }, Kind::Call(of)) => {
                *header == of && frame.body.first() == Some(&command.register())
            }
            _ => false,
        }
    }

    fn repeatable(request: &Request) -> bool {
        matches!(
            request,
            Request::Call {
                command: Command::ReadVersion
                    | Command::ReadSerials
                    | Command::ReadTorqueSource
                    | Command::ReadRotationRadius(_),
                ..
            }
        )
    }
}

/// A frame with this header whose body is wrong.
fn unusable(header: Header, frame: Frame<'_>, cause: Cause) -> ParseError {
    ParseError::Call {
        header,
        register: frame.body.first().copied().unwrap_or_default(),
        cause,
    }
}
