//! The line between an adapter and its arm, in words, where it is not the arm's.

use armwire_bridge::control::{LineReservation, LineState};
use armwire_bridge::{LineCoding, Parity, StopBits};

use crate::error::text::{Remedy, Text};

/// The reservation of the line, and its rate. `None` if all hosts take turns at the arm's rate.
pub fn describe(line: &LineState) -> Option<Text> {
    let (coding, arm) = (rate(line.coding), rate(line.arm));
    let refused = "polls and CAN are refused";
    let reserved = |how: String| Text::from(how).remedy(Remedy::EndReservation).and(": ").and(refused);
    let text = match (line.reservation, line.waiting) {
        (LineReservation::OtherRate, _) => {
            format!("{coding} instead of the arm's {arm}, set by the host on USB: {refused}")
        }
        (LineReservation::Requested, _) if line.coding != line.arm => {
            return Some(reserved(format!(
                "{coding} instead of the arm's {arm}, reserved for USB"
            )));
        }
        (LineReservation::Requested, _) => return Some(reserved(format!("{coding}, reserved for USB"))),
        (LineReservation::None, Some(waiting)) if waiting != line.arm => format!(
            "{coding}; {} set by the host on USB is not in effect, and its bytes are refused",
            rate(waiting)
        ),
        (LineReservation::None, _) => return None,
        (other, _) => format!("{coding}, reserved by {other:?}: {refused}"),
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
    fn each_reservation_is_told_with_the_rate() {
        let slow = LineCoding {
            baud: 9_600,
            parity: Parity::Even,
            stop_bits: StopBits::Two,
        };
        let state = |coding, reservation, waiting| LineState {
            coding,
            reservation,
            waiting,
            ..LineState::default()
        };
        let arms = LineCoding::LING;
        for (state, expected) in [
            (state(arms, LineReservation::None, None), None),
            // The rate changes to the arm's within milliseconds.
            (state(slow, LineReservation::None, Some(arms)), None),
            (
                state(slow, LineReservation::OtherRate, None),
                Some(
                    "9600 baud, even parity, 2 stop bits instead of the arm's 1000000 baud, set by the host on USB: polls \
                     and CAN are refused",
                ),
            ),
            (
                state(arms, LineReservation::Requested, None),
                Some("1000000 baud, reserved for USB (the remedy): polls and CAN are refused"),
            ),
            (
                state(slow, LineReservation::Requested, None),
                Some(
                    "9600 baud, even parity, 2 stop bits instead of the arm's 1000000 baud, reserved for USB (the \
                     remedy): polls and CAN are refused",
                ),
            ),
            (
                state(arms, LineReservation::None, Some(slow)),
                Some(
                    "1000000 baud; 9600 baud, even parity, 2 stop bits set by the host on USB is not in effect, and its \
                     bytes are refused",
                ),
            ),
        ] {
            let text = describe(&state).map(|text| text.with(|_| " (the remedy)".to_owned()));
            assert_eq!(text.as_deref(), expected);
        }
    }
}
