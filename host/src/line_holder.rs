//! The line between an adapter and its arm, in words, where it is not the arm's.

use armwire_bridge::control::{LineHolder, LineState};
use armwire_bridge::{LineCoding, Parity, StopBits};

/// The holder of the line, and its rate. `None` if all hosts take turns at the arm's rate.
pub fn describe(line: &LineState) -> Option<String> {
    let (coding, arm) = (rate(line.coding), rate(line.arm));
    let refused = "polls and CAN are refused";
    Some(match (line.holder, line.waiting) {
        (LineHolder::OtherRate, _) => {
            format!("{coding} instead of the arm's {arm}, set by the host on USB: {refused}")
        }
        (LineHolder::HoldLine, _) if line.coding != line.arm => {
            format!("{coding} instead of the arm's {arm}, held for USB ('armwire hold'): {refused}")
        }
        (LineHolder::HoldLine, _) => format!("{coding}, held for USB ('armwire hold'): {refused}"),
        (LineHolder::Nobody, Some(waiting)) if waiting != line.arm => format!(
            "{coding}; {} set by the host on USB is not in effect, and its bytes are refused",
            rate(waiting)
        ),
        (LineHolder::Nobody, _) => return None,
        (other, _) => format!("{coding}, held by {other:?}: {refused}"),
    })
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
                Some("1000000 baud, held for USB ('armwire hold'): polls and CAN are refused"),
            ),
            (
                state(slow, LineHolder::HoldLine, None),
                Some(
                    "9600 baud, even parity, 2 stop bits instead of the arm's 1000000 baud, held for USB ('armwire \
                     hold'): polls and CAN are refused",
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
            assert_eq!(describe(&state).as_deref(), expected);
        }
    }
}
