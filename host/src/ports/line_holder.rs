//! The line between an adapter and its arm, in words, where it is not the arm's.

use armwire_bridge::control::{LineHolder, LineState};
use armwire_bridge::{LineCoding, Parity, StopBits};

use crate::error::text::{Remedy, Text};

/// The holder of the line, and its rate. `None` if all hosts take turns at the arm's rate.
pub fn describe(line: &LineState) -> Option<Text> {
    let (coding, arm) = (rate(line.coding), rate(line.arm));
    let refused = "polls and CAN are refused";
    let held = |how: String| Text::from(how).remedy(Remedy::EndHold).and(": ").and(refused);
    let text = match (line.holder, line.waiting) {
        (LineHolder::OtherRate, _) => {
            format!("{coding} instead of the arm's {arm}, set by the host on USB: {refused}")
        }
        (LineHolder::HoldLine, _) if line.coding != line.arm => {
            return Some(held(format!("{coding} instead of the arm's {arm}, held for USB")));
        }
        (LineHolder::HoldLine, _) => return Some(held(format!("{coding}, held for USB"))),
        (LineHolder::Nobody, Some(waiting)) if waiting != line.arm => format!(
            "{coding}; {} set by the host on USB is not in effect, and its bytes are refused",
            rate(waiting)
        ),
        (LineHolder::Nobody, _) => return None,
        (other, _) => format!("{coding}, held by {other:?}: {refused}"),
    };
    Some(text.into())
}

/// A line coding in words.
fn rate(coding: LineCoding) -> String {
    let parity = match coding.parity {
        Parity::None => "",
        Parity::Odd => ", odd parity",
        Parity::Even => ", even parity",
    };
    let stop_bits = match coding.stop_bits {
        StopBits::One => "",
        StopBits::Two => ", 2 stop bits",
    };
    format!("{} baud{parity}{stop_bits}", coding.baud)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_holder_is_told_with_the_rate() {
        let slow = LineCoding {
            baud: 9_600,
            parity: Parity::Even,
            stop_bits: StopBits::Two,
        };
        let state = |coding, holder, waiting| LineState {
            coding,
            holder,
            waiting,
            ..LineState::default()
        };
        let arms = LineCoding::LING;
        for (state, expected) in [
            (state(arms, LineHolder::Nobody, None), None),
            // The rate changes to the arm's within milliseconds.
            (state(slow, LineHolder::Nobody, Some(arms)), None),
            (
                state(slow, LineHolder::OtherRate, None),
                Some(
                    "9600 baud, even parity, 2 stop bits instead of the arm's 1000000 baud, set by the host on USB: polls \
                     and CAN are refused",
                ),
            ),
            (
                state(arms, LineHolder::HoldLine, None),
                Some("1000000 baud, held for USB (the hold): polls and CAN are refused"),
            ),
            (
                state(slow, LineHolder::HoldLine, None),
                Some(
                    "9600 baud, even parity, 2 stop bits instead of the arm's 1000000 baud, held for USB (the \
                     hold): polls and CAN are refused",
                ),
            ),
            (
                state(arms, LineHolder::Nobody, Some(slow)),
                Some(
                    "1000000 baud; 9600 baud, even parity, 2 stop bits set by the host on USB is not in effect, and its \
                     bytes are refused",
                ),
            ),
        ] {
            let text = describe(&state).map(|text| text.with(|_| " (the hold)".to_owned()));
            assert_eq!(text.as_deref(), expected);
        }
    }
}
