//! Services. They are answered when the arm's readings show the effect, or after a timeout.

use armwire::ling::JointState;
use armwire::ling::effect::{self, Effect, ReadBack, Verdict};
use armwire::time::Instant;

use crate::messages::Outcome;

/// A request of the client `id` that was sent to the arm.
#[derive(Debug)]
pub(crate) struct Pending<I> {
    pub(crate) id: I,
    read_back: ReadBack,
}

impl<I> Pending<I> {
    /// A request that was sent at this system time, in nanoseconds since 1970.
    pub(crate) fn new(id: I, effect: Effect, sent_at: i64) -> Self {
        let read_back = ReadBack::new(effect, instant(sent_at));
        Self { id, read_back }
    }

    pub(crate) fn effect(&self) -> Effect {
        self.read_back.effect()
    }

    /// The outcome by a reading at this system time; `None` while it is undecided.
    pub(crate) fn outcome(&self, at: i64, state: &JointState) -> Option<Outcome> {
        self.read_back.on_joints(instant(at), state).map(answer)
    }
}

/// A system time on the clock of the state machines, which has no time before 1970.
fn instant(nanos: i64) -> Instant {
    Instant::from_micros(u64::try_from(nanos / 1_000).unwrap_or(0))
}

fn answer(outcome: effect::Outcome) -> Outcome {
    Outcome {
        success: outcome.verdict != Verdict::Contradicted,
        message: outcome.to_string(),
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
    use armwire::ling::{MotionStatus, Torque};

    use super::*;

    #[test]
    fn outcome_of_the_read_back_is_the_answer() {
        let pending = Pending::new((), Effect::Torque(Torque::On), 1_000_000);
        let outcome = |at, status| {
            let state = JointState {
                joints: [2048; 6],
                gripper: 0,
                status,
            };
            let outcome = pending.outcome(at, &state);
            outcome.map(|outcome| outcome.success)
        };
        assert_eq!(
            outcome(1_000_000, MotionStatus::Locked),
            None,
            "made before the request"
        );
        assert_eq!(outcome(2_000_000, MotionStatus::Locked), Some(true));
        assert_eq!(outcome(2_000_000, MotionStatus::Idle), None);
        assert_eq!(outcome(501_000_000, MotionStatus::Idle), Some(false));
        assert_eq!(outcome(501_000_000, MotionStatus::Overheating), Some(true));
    }
}
