//! Error and warning of an arm: register 15, which is not in the document.
//!
//! The register and the numbers are those of the vendor's package, xarm-python-sdk 1.18.4, the meanings in short words.

use core::fmt::{self, Display, Formatter};

use super::{Raw, Reply, Request};
use crate::messages::OtherAnswer;

/// The errors that have a meaning.
const ERRORS: [(u8, &str); 41] = [
    (1, "emergency stop button of the control box is pressed"),
    (2, "emergency input of the control box is triggered"),
    (3, "emergency stop button of the three-state switch is pressed"),
    (10, "servo motor error"),
    (11, "servo motor 1 error"),
    (12, "servo motor 2 error"),
    (13, "servo motor 3 error"),
    (14, "servo motor 4 error"),
    (15, "servo motor 5 error"),
    (16, "servo motor 6 error"),
    (17, "servo motor 7 error"),
    (18, "no communication with the force torque sensor"),
    (19, "no communication with the end effector"),
    (21, "kinematic error"),
    (22, "self-collision"),
    (23, "joint angle exceeds its limit"),
    (24, "speed exceeds its limit"),
    (25, "planning error"),
    (26, "Linux real-time error"),
    (27, "error in the reply to a command"),
    (28, "no communication with the end module"),
    (30, "measured speed exceeds its limit"),
    (31, "abnormal current, caused by a collision"),
    (32, "three points define no circle"),
    (33, "error of the control box's inputs and outputs"),
    (34, "recording exceeds its maximum duration"),
    (35, "safety boundary reached"),
    (36, "too many delayed commands"),
    (37, "abnormal motion in manual mode"),
    (38, "abnormal joint angle"),
    (39, "no communication between the two processors of the power board"),
    (40, "no solution for the joint trajectory"),
    (41, "invalid friction file"),
    (42, "invalid calibration file"),
    (50, "force torque sensor cannot be read"),
    (51, "mode of the force torque sensor cannot be set"),
    (52, "zero of the force torque sensor cannot be set"),
    (53, "force torque sensor is overloaded"),
    (60, "linear speed exceeds its limit in servo mode"),
    (110, "no communication with the arm's base board"),
    (111, "no communication with an RS-485 device at the control box"),
];

/// The warnings with a meaning.
const WARNINGS: [(u8, &str); 5] = [
    (11, "command queue is full"),
    (12, "invalid parameter of a command"),
    (13, "unknown command"),
    (14, "no solution for a command"),
    (15, "Modbus command queue is full"),
];

/// The error and the warning of an arm.
///
/// ```
/// use armwire::xarm::{Codes, Raw, Reply};
///
/// let reply = Reply::Raw(Raw::new(Codes::REGISTER, &[31, 0])?);
/// let codes = Codes::try_from(reply).unwrap();
/// assert_eq!(codes.to_string(), "error: 31 (abnormal current, caused by a collision), warning: none");
/// # Ok::<(), armwire::xarm::RawError>(())
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Codes {
    /// The error, which stops the arm until it is cleared.
    pub error: ErrorCode,
    /// The warning, which stops nothing.
    pub warning: WarningCode,
}

/// Number of an error. 0 means none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ErrorCode(pub u8);

/// Number of a warning. 0 means none.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct WarningCode(pub u8);

impl Codes {
    /// The register.
    pub const REGISTER: u8 = 15;

    /// No error, and no warning.
    pub const NONE: Self = Self {
        error: ErrorCode(0),
        warning: WarningCode(0),
    };

    /// The request that reads them.
    pub const READ: Request<'static> = Request::Raw(Raw::from_wire(Self::REGISTER, &[]));

    /// The codes in an answer. `None` for another register, and for fewer than two parameters.
    pub(super) const fn of(answer: &Raw<'_>) -> Option<Self> {
        match (answer.register(), answer.params()) {
            (Self::REGISTER, &[error, warning, ..]) => Some(Self {
                error: ErrorCode(error),
                warning: WarningCode(warning),
            }),
            _ => None,
        }
    }
}

impl<'a> TryFrom<Reply<'a>> for Codes {
    type Error = OtherAnswer<Reply<'a>>;

    fn try_from(got: Reply<'a>) -> Result<Self, Self::Error> {
        match got {
            Reply::Raw(raw) => Self::of(&raw).ok_or(OtherAnswer { got }),
            _ => Err(OtherAnswer { got }),
        }
    }
}

impl ErrorCode {
    /// The meaning. `None` for 0, and for a number that the vendor's package does not explain.
    pub fn meaning(self) -> Option<&'static str> {
        meaning(&ERRORS, self.0)
    }
}

impl WarningCode {
    /// The meaning. `None` for 0, and for a number that the vendor's package does not explain.
    pub fn meaning(self) -> Option<&'static str> {
        meaning(&WARNINGS, self.0)
    }
}

fn meaning(known: &'static [(u8, &'static str)], number: u8) -> Option<&'static str> {
    known
        .iter()
        .find(|(code, _)| *code == number)
        .map(|(_, meaning)| *meaning)
}

/// The number and the meaning, such as `23 (joint angle exceeds its limit)`. A number without a meaning stands alone.
fn write(f: &mut Formatter<'_>, number: u8, meaning: Option<&str>) -> fmt::Result {
    match (number, meaning) {
        (0, _) => f.write_str("none"),
        (number, Some(meaning)) => write!(f, "{number} ({meaning})"),
        (number, None) => write!(f, "{number}"),
    }
}

impl Display for ErrorCode {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write(f, self.0, self.meaning())
    }
}

impl Display for WarningCode {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write(f, self.0, self.meaning())
    }
}

impl Display for Codes {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        write!(f, "error: {}, warning: {}", self.error, self.warning)
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::BTreeSet;
    use std::format;
    use std::string::ToString;
    use std::vec::Vec;

    use super::*;

    #[test]
    fn each_number_has_a_meaning_of_its_own_or_stands_alone() {
        let errors = (0..=u8::MAX).map(|number| (number, ErrorCode(number).meaning(), ErrorCode(number).to_string()));
        let warnings =
            (0..=u8::MAX).map(|number| (number, WarningCode(number).meaning(), WarningCode(number).to_string()));
        for (all, known) in [(Vec::from_iter(errors), 41), (Vec::from_iter(warnings), 5)] {
            let meanings: BTreeSet<_> = all.iter().filter_map(|(_, meaning, _)| *meaning).collect();
            assert_eq!(meanings.len(), known);
            for (number, meaning, text) in all.into_iter().skip(1) {
                let expected = meaning.map_or(format!("{number}"), |meaning| format!("{number} ({meaning})"));
                assert_eq!(text, expected);
            }
        }
    }

    #[test]
    fn unknown_number_stands_alone() {
        assert_eq!(Codes::NONE.to_string(), "error: none, warning: none");
        let codes = Codes {
            error: ErrorCode(77),
            warning: WarningCode(200),
        };
        assert_eq!(codes.to_string(), "error: 77, warning: 200");
    }

    #[test]
    fn codes_are_the_first_parameters_of_their_register() {
        let codes = |register, params| Codes::try_from(Reply::Raw(Raw::new(register, params).unwrap()));
        let expected = Codes {
            error: ErrorCode(23),
            warning: WarningCode(11),
        };
        assert_eq!(codes(15, &[23, 11]), Ok(expected));
        assert_eq!(codes(15, &[23, 11, 7]), Ok(expected));
        assert!(codes(15, &[23]).is_err());
        assert!(codes(16, &[23, 11]).is_err());
    }
}
