//! Orders to a virtual SO-101: what fails next, and what a hand does.

use std::error::Error;
use std::fmt;
use std::str::FromStr;

use armwire::OutOfRange;
use armwire::time::Duration;
use armwire_feetech::MAX_ID;

/// An order, as a line of text. Answers are counted over all servos, from the order on; 1 is the next one.
///
/// | Line | Effect |
/// |---|---|
/// | `late N[:MS]` | the `N`th answer, and what follows in that time, arrives `MS` milliseconds later, 60 without it |
/// | `damaged [N]` | the `N`th answer has a flipped bit |
/// | `twice [N]` | the `N`th answer is sent twice |
/// | `brownout [N[:MS]]` | before the `N`th answer the supply drops for `MS` milliseconds, 300 without it: all servos restart |
/// | `silent ID` | this servo executes requests and does not answer |
/// | `unplugged ID` | this servo and those behind it have no supply |
/// | `error ID BITS` | answers of this servo have these error bits too, 0 to 255 |
/// | `echo` | the host receives its own bytes |
/// | `sag TICKS` | loaded joints rest this many steps below their goals, -500 to 500 |
/// | `hand ID POSITION` | a hand moves this servo to the position that it then reports |
/// | `clear` | all of these faults end, and orders that wait for an answer are dropped; the sag stays |
/// | `state` | a line for each servo |
///
/// ```
/// use armwire_sim::so101::Order;
///
/// assert!("late 3:80".parse::<Order>().is_ok());
/// let error = "late x".parse::<Order>().unwrap_err();
/// assert_eq!(error.to_string(), "'late x': expected late N[:MS]");
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[expect(missing_docs)]
pub enum Order {
    /// `late`.
    Late { answer: u32, by: Duration },
    /// `damaged`.
    Damaged { answer: u32 },
    /// `twice`.
    Twice { answer: u32 },
    /// `brownout`.
    Brownout { answer: u32, time: Duration },
    /// `silent`.
    Silent { id: u8 },
    /// `unplugged`.
    Unplugged { id: u8 },
    /// `error`.
    Error { id: u8, bits: u8 },
    /// `echo`.
    Echo,
    /// `sag`.
    Sag(i16),
    /// `hand`.
    Hand { id: u8, position: i16 },
    /// `clear`.
    Clear,
    /// `state`.
    State,
}

/// Each order and its form.
const FORMS: [(&str, &str); 12] = [
    ("late", "late N[:MS]"),
    ("damaged", "damaged [N]"),
    ("twice", "twice [N]"),
    ("brownout", "brownout [N[:MS]]"),
    ("silent", "silent ID"),
    ("unplugged", "unplugged ID"),
    ("error", "error ID BITS"),
    ("echo", "echo"),
    ("sag", "sag TICKS, -500 to 500"),
    ("hand", "hand ID POSITION"),
    ("clear", "clear"),
    ("state", "state"),
];

const LATE: u32 = 60;
const BROWNOUT: u32 = 300;

impl FromStr for Order {
    type Err = OrderError;

    fn from_str(text: &str) -> Result<Self, OrderError> {
        let words: Vec<&str> = text.split_whitespace().collect();
        let name = words.first().copied().unwrap_or_default();
        let Some((_, form)) = FORMS.iter().find(|(known, _)| *known == name) else {
            return Err(OrderError::Unknown(text.to_owned()));
        };
        order(&words).ok_or_else(|| OrderError::Form {
            order: text.to_owned(),
            form,
        })
    }
}

/// The order of these words.
fn order(words: &[&str]) -> Option<Order> {
    Some(match *words {
        ["late", when] => {
            let (answer, by) = answer_and_time(when, LATE)?;
            Order::Late { answer, by }
        }
        ["damaged"] => Order::Damaged { answer: 1 },
        ["damaged", answer] => Order::Damaged { answer: count(answer)? },
        ["twice"] => Order::Twice { answer: 1 },
        ["twice", answer] => Order::Twice { answer: count(answer)? },
        ["brownout"] => Order::Brownout {
            answer: 1,
            time: Duration::from_millis(BROWNOUT.into()),
        },
        ["brownout", when] => {
            let (answer, time) = answer_and_time(when, BROWNOUT)?;
            Order::Brownout { answer, time }
        }
        ["silent", id] => Order::Silent { id: servo(id)? },
        ["unplugged", id] => Order::Unplugged { id: servo(id)? },
        ["error", id, bits] => Order::Error {
            id: servo(id)?,
            bits: bits.parse().ok()?,
        },
        ["echo"] => Order::Echo,
        ["sag", steps] => Order::Sag(steps.parse().ok().filter(|steps| (-500..=500).contains(steps))?),
        ["hand", id, position] => Order::Hand {
            id: servo(id)?,
            position: position.parse().ok()?,
        },
        ["clear"] => Order::Clear,
        ["state"] => Order::State,
        _ => return None,
    })
}

fn servo(text: &str) -> Option<u8> {
    text.parse().ok().filter(|id| *id <= MAX_ID)
}

/// A number of an answer, from 1.
fn count(text: &str) -> Option<u32> {
    text.parse().ok().filter(|answer| *answer > 0)
}

fn answer_and_time(text: &str, millis: u32) -> Option<(u32, Duration)> {
    let (answer, millis) = match text.split_once(':') {
        Some((answer, millis)) => (answer, millis.parse().ok()?),
        None => (text, millis),
    };
    Some((count(answer)?, Duration::from_millis(millis.into())))
}

/// The reason why a line is not an [`Order`], or is not carried out.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
#[expect(missing_docs)]
pub enum OrderError {
    /// Line that begins with no order.
    Unknown(String),
    /// Order with wrong or missing values.
    Form { order: String, form: &'static str },
    /// Servo that the bus does not have.
    NoServo(u8),
    /// Servo that a hand cannot move: its torque is on.
    Holds(u8),
    /// Position that the servo cannot report.
    Position { id: u8, error: OutOfRange<i32> },
}

impl fmt::Display for OrderError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Unknown(text) => {
                let names = FORMS.map(|(name, _)| name).join(", ");
                write!(f, "unknown order '{}': expected one of {names}", text.escape_debug())
            }
            Self::Form { order, form } => write!(f, "'{}': expected {form}", order.escape_debug()),
            Self::NoServo(id) => write!(f, "no servo has id {id}"),
            Self::Holds(id) => write!(f, "servo {id} holds its position"),
            Self::Position { id, error } => write!(f, "servo {id}: {error}"),
        }
    }
}

impl Error for OrderError {}

#[cfg(test)]
pub(super) mod tests {
    use proptest::prelude::*;

    use super::*;

    /// Any order but `echo`, whose bytes are those of the host, to servos 1 to 6 more often than to others.
    pub(in super::super) fn any_order() -> impl Strategy<Value = Order> {
        let id = || prop_oneof![9 => 1..=6_u8, 1 => 0..=MAX_ID];
        let answer = || 1..20_u32;
        let time = || (0..200_u64).prop_map(Duration::from_millis);
        prop_oneof![
            (answer(), time()).prop_map(|(answer, by)| Order::Late { answer, by }),
            answer().prop_map(|answer| Order::Damaged { answer }),
            answer().prop_map(|answer| Order::Twice { answer }),
            (answer(), time()).prop_map(|(answer, time)| Order::Brownout { answer, time }),
            id().prop_map(|id| Order::Silent { id }),
            id().prop_map(|id| Order::Unplugged { id }),
            (id(), any::<u8>()).prop_map(|(id, bits)| Order::Error { id, bits }),
            (-500..=500_i16).prop_map(Order::Sag),
            (id(), any::<i16>()).prop_map(|(id, position)| Order::Hand { id, position }),
            Just(Order::Clear),
            Just(Order::State),
        ]
    }

    #[test]
    fn lines_are_orders() {
        let millis = |millis| Duration::from_millis(millis);
        let lines = [
            (
                "late 2",
                Order::Late {
                    answer: 2,
                    by: millis(60),
                },
            ),
            (
                "late 2:5",
                Order::Late {
                    answer: 2,
                    by: millis(5),
                },
            ),
            (
                "brownout",
                Order::Brownout {
                    answer: 1,
                    time: millis(300),
                },
            ),
            (
                "brownout 3:1",
                Order::Brownout {
                    answer: 3,
                    time: millis(1),
                },
            ),
            ("damaged", Order::Damaged { answer: 1 }),
            ("twice 9", Order::Twice { answer: 9 }),
            ("silent 0", Order::Silent { id: 0 }),
            ("unplugged 253", Order::Unplugged { id: 253 }),
            ("error 2 33", Order::Error { id: 2, bits: 33 }),
            (" echo ", Order::Echo),
            ("sag -30", Order::Sag(-30)),
            ("hand 2 1500", Order::Hand { id: 2, position: 1500 }),
            ("clear", Order::Clear),
            ("state", Order::State),
        ];
        for (line, order) in lines {
            assert_eq!(line.parse(), Ok(order), "{line}");
        }
    }

    #[test]
    fn wrong_lines_are_refused_with_their_form() {
        for (line, form) in [
            ("late", "late N[:MS]"),
            ("late 0", "late N[:MS]"),
            ("late x", "late N[:MS]"),
            ("late 1:", "late N[:MS]"),
            ("late 1:x", "late N[:MS]"),
            ("late -1", "late N[:MS]"),
            ("late 1 60", "late N[:MS]"),
            ("late 4294967296", "late N[:MS]"),
            ("damaged 0", "damaged [N]"),
            ("twice x", "twice [N]"),
            ("brownout 0:5", "brownout [N[:MS]]"),
            ("silent", "silent ID"),
            ("silent 254", "silent ID"),
            ("silent -1", "silent ID"),
            ("unplugged 1 2", "unplugged ID"),
            ("error 1", "error ID BITS"),
            ("error 1 256", "error ID BITS"),
            ("error 1@2", "error ID BITS"),
            ("echo on", "echo"),
            ("sag", "sag TICKS, -500 to 500"),
            ("sag 501", "sag TICKS, -500 to 500"),
            ("sag 1.5", "sag TICKS, -500 to 500"),
            ("hand 1", "hand ID POSITION"),
            ("hand 1 32768", "hand ID POSITION"),
            ("clear 1", "clear"),
            ("state 1", "state"),
        ] {
            let error = line.parse::<Order>().unwrap_err();
            assert_eq!(error.to_string(), format!("'{line}': expected {form}"));
        }
        for line in ["", " ", "gremlins", "Late 1", "late:1", "\u{1b}[2J"] {
            let error = line.parse::<Order>().unwrap_err();
            assert_eq!(error, OrderError::Unknown(line.to_owned()));
            assert!(!error.to_string().contains('\u{1b}'));
        }
    }
}
