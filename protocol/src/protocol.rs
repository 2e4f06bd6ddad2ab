//! What frames mean, and which answers which.

use core::fmt::Debug;

use crate::{BufferTooShort, Framing, Micros};

/// What to expect in answer to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Reply {
    /// The longest the answer may be, in bytes on the wire.
    pub len: usize,
    /// The longest the arm may think between the last byte of the request and the first of the answer.
    pub turnaround: Micros,
}

/// The messages of one kind of arm.
///
/// Both directions are here, so that a [`Client`](crate::Client) and a [`Device`](crate::Device) are made of the same
/// definitions and tested against each other. `ling::Ling` is the one to read as an example.
pub trait Protocol: Framing {
    /// What the arm may expect of the next frame: any request.
    const REQUESTS: Self::Expect;

    /// Whether an answer says which request it answers, as one with a transaction id does. Where it does not, an answer
    /// that is missing must be waited for, or given up, before the next request may go out.
    const IDENTIFIED: bool;

    /// What the host says.
    type Request: Copy + PartialEq + Debug;

    /// What the arm says.
    type Response: Copy + PartialEq + Debug;

    /// The same where what is long in it, such as a text, is borrowed: a [`Client`](crate::Client) looks at this, so that a
    /// response is not on the stack besides. [`Response`](Self::Response) itself where nothing is long.
    type ResponseRef<'a>: Copy + PartialEq + Debug;

    /// Why a good frame is not a message.
    type Error: core::error::Error + Copy + PartialEq;

    /// Writes a request at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`]; never when `out` has [`Framing::MAX_FRAME`] bytes.
    fn encode_request(request: &Self::Request, out: &mut [u8]) -> Result<usize, BufferTooShort>;

    /// Writes a response at the front of `out` and returns its length in bytes.
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`]; never when `out` has [`Framing::MAX_FRAME`] bytes.
    fn encode_response(response: &Self::Response, out: &mut [u8]) -> Result<usize, BufferTooShort>;

    /// What a frame from the host means.
    ///
    /// # Errors
    ///
    /// When it is no request of this protocol: what is wrong, and where.
    fn parse_request(frame: Self::Frame<'_>) -> Result<Self::Request, Self::Error>;

    /// Whether [`parse_request`](Self::parse_request) takes a frame, for whoever has no use for the request.
    fn is_request(frame: Self::Frame<'_>) -> bool {
        Self::parse_request(frame).is_ok()
    }

    /// What a frame from the arm means, where `expect` is what it was expected to be: some answers do not say what they
    /// answer.
    ///
    /// # Errors
    ///
    /// When it is no response of this protocol: what is wrong, and where.
    fn parse_response(frame: Self::Frame<'_>, expect: Self::Expect) -> Result<Self::Response, Self::Error> {
        match &Self::parse_response_ref(frame, expect) {
            Ok(response) => Ok(Self::to_response(response)),
            Err(error) => Err(*error),
        }
    }

    /// The same, and nothing of the frame is copied that is long.
    ///
    /// # Errors
    ///
    /// Those of [`parse_response`](Self::parse_response).
    fn parse_response_ref<'a>(
        frame: Self::Frame<'a>,
        expect: Self::Expect,
    ) -> Result<Self::ResponseRef<'a>, Self::Error>;

    /// The response with all that was borrowed.
    ///
    /// ```
    /// use armwire::Protocol;
    /// use armwire::xarm::{Direction, Frame, XArm};
    ///
    /// let frame = Frame { transaction: 7, protocol: 2, body: &[19, 0, 1] };
    /// let response = XArm::parse_response_ref(frame, Direction::Responses)?;
    /// assert_eq!(XArm::parse_response(frame, Direction::Responses), Ok(XArm::to_response(&response)));
    /// # Ok::<(), armwire::xarm::ParseError>(())
    /// ```
    fn to_response(response: &Self::ResponseRef<'_>) -> Self::Response;

    /// The response with what is long borrowed from it.
    ///
    /// ```
    /// use armwire::Protocol;
    /// use armwire::xarm::{Command, Header, ProtocolId, Raw, Reply, Request, Response, State, XArm};
    ///
    /// let header = Header { transaction: 7, protocol: ProtocolId::Private };
    /// let request = Request::Call { header, command: Command::Raw(Raw::new(19, &[1])?) };
    /// let reply = Reply::Raw(Raw::new(19, &[])?);
    /// let response = Response::Reply { header, state: State::OK, reply };
    /// assert!(XArm::answers(&request, &XArm::response_ref(&response)));
    /// # Ok::<(), armwire::xarm::RawError>(())
    /// ```
    fn response_ref(response: &Self::Response) -> Self::ResponseRef<'_>;

    /// What the host may expect of the next frame while `request`, or none, is in flight.
    fn expect(request: Option<&Self::Request>) -> Self::Expect;

    /// The reply `request` gets, or `None` if the arm does not answer it.
    fn reply(request: &Self::Request) -> Option<Reply>;

    /// Whether `response` is the answer to `request`.
    fn answers(request: &Self::Request, response: &Self::ResponseRef<'_>) -> bool;

    /// Whether `frame`, which [`parse_response`](Self::parse_response) does not take, is the answer to `request` by all that
    /// names one: then the request is answered, though by nothing of use. Never so for a request that is not answered.
    ///
    /// ```
    /// use armwire::Protocol;
    /// use armwire::ling::{Frame, Ling, Request};
    ///
    /// let stroke = Frame { command: 0x04, function: 0x0E, data: &[3] }; // no gripper has this code
    /// assert!(Ling::parse_response(stroke, ()).is_err());
    /// assert!(Ling::is_response_to(&Request::ReadStroke, stroke));
    /// assert!(!Ling::is_response_to(&Request::ReadJoints, stroke));
    /// ```
    fn is_response_to(request: &Self::Request, frame: Self::Frame<'_>) -> bool;

    /// Whether sending `request` again after silence is harmless: reads are, motion, torque and settings are not.
    fn repeatable(request: &Self::Request) -> bool;
}
