//! The value of an answer, by its type.

use super::{FirmwareVersion, Outcome, Response, ServoAngles, ServoResponse, ServoStates, Text};
use crate::messages::OtherAnswer;

/// The hardware version.
impl<'a> TryFrom<Response<'a>> for Text<'a> {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::HardwareVersion(version) => Ok(version),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Response<'a>> for ServoStates {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::ServoStates(states) => Ok(states),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Response<'a>> for FirmwareVersion {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::FirmwareVersion(version) => Ok(version),
            got => Err(OtherAnswer { got }),
        }
    }
}

/// The result in a response of the robot or of a servo that contains nothing else.
///
/// ```
/// use armwire::alpha1::{Outcome, Response, ServoStates};
///
/// assert_eq!(Outcome::try_from(Response::Stopped(Outcome::Success)), Ok(Outcome::Success));
/// let error = Outcome::try_from(Response::ServoStates(ServoStates::from_bits(1))).unwrap_err();
/// assert_eq!(error.to_string(), "another answer: servos that run: 1");
/// ```
impl<'a> TryFrom<Response<'a>> for Outcome {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::Stopped(outcome)
            | Response::Acted(outcome)
            | Response::OffsetTool(outcome)
            | Response::UsbType(outcome)
            | Response::Playing(outcome)
            | Response::Servo(ServoResponse::IdChanged { outcome, .. } | ServoResponse::OffsetSet { outcome, .. }) => {
                Ok(outcome)
            }
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Response<'a>> for ServoAngles {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::Servo(ServoResponse::Angles { target, actual, .. }) => Ok(Self { target, actual }),
            got => Err(OtherAnswer { got }),
        }
    }
}

impl<'a> TryFrom<Response<'a>> for ServoResponse {
    type Error = OtherAnswer<Response<'a>>;

    fn try_from(response: Response<'a>) -> Result<Self, Self::Error> {
        match response {
            Response::Servo(response) => Ok(response),
            got => Err(OtherAnswer { got }),
        }
    }
}
