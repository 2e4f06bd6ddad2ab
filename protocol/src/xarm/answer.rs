//! The value of an answer, by its type.

use super::{Raw, Reply, Response, RotationRadius, SerialsText, State, TorqueSource, VersionText};
use crate::messages::OtherAnswer;

/// An answer of the arm.
///
/// ```
/// use armwire::xarm::{Answer, Reply, Response, RotationRadius, State, TorqueSource};
///
/// let response = Response::Reply { state: State::OK, reply: Reply::TorqueSource(TorqueSource::Current) };
/// let answer = Answer::try_from(response)?;
/// assert_eq!(answer, Answer { value: TorqueSource::Current, state: State::OK });
/// let error = Answer::<RotationRadius>::try_from(response).unwrap_err();
/// assert_eq!(error.to_string(), "another answer: torque: the servos' current, measured, state: ok");
/// # Ok::<(), armwire::messages::OtherAnswer<Response<'_>>>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Answer<T> {
    /// The requested value.
    pub value: T,
    /// The state of the arm.
    pub state: State,
}

/// The value of a reply. A reply with an invalid state has none.
impl<'a, T: TryFrom<Reply<'a>>> TryFrom<Response<'a>> for Answer<T> {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(got: Response<'a>) -> Result<Self, Self::Error> {
        match got {
            Response::Reply { state, reply } if !state.contains(State::INVALID) => match reply.try_into() {
                Ok(value) => Ok(Self { value, state }),
                Err(_) => Err(OtherAnswer { got }),
            },
            _ => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for VersionText<'a> {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::Version(text) => Ok(text),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for SerialsText<'a> {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::Serials(text) => Ok(text),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for TorqueSource {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::TorqueSource(source) => Ok(source),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for RotationRadius {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::RotationRadius(radius) => Ok(radius),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for Raw<'a> {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::Raw(raw) => Ok(raw),
            got => Err(OtherAnswer { got }),
        }
    }
}

/// A reply without a value: of register 4 or 10.
impl<'a> TryFrom<Reply<'a>> for () {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(reply: Reply<'a>) -> Result<Self, Self::Error> {
        match reply {
            Reply::Empty(_) | Reply::SystemControl(_) => Ok(()),
            got => Err(OtherAnswer { got }),
        }
    }
}
