//! The value of an answer, by its type.

use super::{ForceFeedback, Info, JointState, ModeReply, ModeState, PerServo, Response, SelfCheck, Stroke};
use crate::messages::OtherAnswer;

/// ```
/// use armwire::ling::{Info, JointState, Response, Stroke};
///
/// let response = Response::Stroke(Stroke::Mm50);
/// assert_eq!(Stroke::try_from(response), Ok(Stroke::Mm50));
/// assert_eq!(JointState::try_from(response).unwrap_err().to_string(), "another answer: stroke: 50 mm");
/// ```
impl TryFrom<Response> for Stroke {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Stroke(stroke) => Ok(stroke),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for Info {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Info(info) => Ok(info),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for JointState {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Joints(state) => Ok(state),
            got => Err(OtherAnswer { got }),
        }
    }
}

/// Temperatures, in °C.
impl TryFrom<Response> for PerServo<u8> {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Temperatures(celsius) => Ok(celsius),
            got => Err(OtherAnswer { got }),
        }
    }
}

/// Velocities, in ticks per second.
impl TryFrom<Response> for PerServo<u16> {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Velocities(ticks) => Ok(ticks),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for SelfCheck {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::SelfCheck(check) => Ok(check),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for ModeReply {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::ModeReply(reply) => Ok(reply),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for ModeState {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::Mode(state) => Ok(state),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl TryFrom<Response> for ForceFeedback {
    type Error = OtherAnswer<Response>;

    fn try_from(response: Response) -> Result<Self, Self::Error> {
        match response {
            Response::ForceFeedback(state) => Ok(state),
            got => Err(OtherAnswer { got }),
        }
    }
}
