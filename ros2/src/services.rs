//! Services. They are answered when the arm's readings show the effect, or after a timeout.

use std::time::{Duration, Instant};

use armwire::ling::{Request, Torque};

use crate::joint_states::Reading;
use crate::messages::Outcome;

/// Timeout until a reading shows the effect of a request.
const EFFECT_TIMEOUT: Duration = Duration::from_millis(500);

/// The expected effect of a request on the readings.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Effect {
    Torque(bool),
    Zero,
}

impl Effect {
    /// The request to the arm.
    pub(crate) fn request(self) -> Request {
        match self {
            Self::Torque(true) => Request::SetTorque(Torque::On),
            Self::Torque(false) => Request::SetTorque(Torque::Off),
            Self::Zero => Request::SetZero,
        }
    }

    fn is_shown(self, reading: &Reading) -> bool {
        match self {
            Self::Torque(on) => reading.status.is_holding() == Some(on),
            Self::Zero => reading.is_at_zero(),
        }
    }
}

/// A request of the client `id` that was sent to the arm.
#[derive(Debug)]
pub(crate) struct Pending<I> {
    pub(crate) id: I,
    pub(crate) effect: Effect,
    sent: Instant,
    /// System time of the request, in nanoseconds since 1970.
    sent_at: i64,
}

impl<I> Pending<I> {
    pub(crate) fn new(id: I, effect: Effect, sent: Instant, sent_at: i64) -> Self {
        Self {
            id,
            effect,
            sent,
            sent_at,
        }
    }

    /// The outcome by a reading after the request; `None` while it is undecided.
    pub(crate) fn outcome(&self, reading: &Reading, now: Instant) -> Option<Outcome> {
        let status = reading.status;
        if reading.at > self.sent_at && self.effect.is_shown(reading) {
            return Some(Outcome {
                success: true,
                message: format!("read back: status {status}"),
            });
        }
        let is_late = now.duration_since(self.sent) >= EFFECT_TIMEOUT;
        let message = format!(
            "sent, but not read back within {} ms: status {status}",
            EFFECT_TIMEOUT.as_millis()
        );
        is_late.then_some(Outcome {
            success: false,
            message,
        })
    }
}

/// The outcome of a request that was not sent.
pub(crate) fn refused(reason: &str) -> Outcome {
    Outcome {
        success: false,
        message: reason.to_owned(),
    }
}

#[cfg(test)]
mod tests {
    use armwire::ling::MotionStatus;

    use super::*;

    fn reading(status: MotionStatus, position: f64) -> Reading {
        Reading {
            at: 1,
            status,
            positions: vec![position; 7],
        }
    }

    #[test]
    fn reading_with_the_effect_is_a_success() {
        let sent = Instant::now();
        let pending = Pending::new((), Effect::Torque(true), sent, 0);
        assert_eq!(pending.outcome(&reading(MotionStatus::Idle, 0.0), sent), None);
        assert!(
            pending
                .outcome(&reading(MotionStatus::Locked, 0.0), sent)
                .unwrap()
                .success
        );
    }

    #[test]
    fn reading_before_the_request_is_not_a_success() {
        let sent = Instant::now();
        let pending = Pending::new((), Effect::Torque(true), sent, 1);
        assert_eq!(pending.outcome(&reading(MotionStatus::Locked, 0.0), sent), None);
    }

    #[test]
    fn missing_effect_is_a_failure() {
        let sent = Instant::now();
        let pending = Pending::new((), Effect::Zero, sent, 0);
        let outcome = |ms| pending.outcome(&reading(MotionStatus::Idle, 0.1), sent + Duration::from_millis(ms));
        assert_eq!(outcome(499), None);
        assert!(!outcome(500).unwrap().success);
    }
}
