//! Services. They are answered when the arm's readings show the effect, or after a timeout.

use armwire::ling::effect::{Effect, Output};
use armwire::ling::{JointState, ReadBack, Request};
use armwire::time::Instant;

use crate::messages::Outcome;

/// A request of the client `id`. Times are system times, in nanoseconds since 1970.
#[derive(Debug)]
pub(crate) struct Pending<I> {
    pub(crate) id: I,
    read_back: ReadBack,
}

/// The next action for a request.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum Action {
    /// Send it to the arm.
    Send(Effect),
    /// Wait for readings, which come at a rate.
    Wait,
    /// Answer it.
    Answer(Outcome),
}

impl<I> Pending<I> {
    pub(crate) fn new(id: I, effect: Effect) -> Self {
        let read_back = ReadBack::new(effect);
        Self { id, read_back }
    }

    pub(crate) fn effect(&self) -> Effect {
        self.read_back.effect()
    }

    /// Takes a reading of the joints with this stamp.
    pub(crate) fn on_joints(&mut self, at: i64, state: &JointState) {
        self.read_back.on_joints(instant(at), state);
    }

    /// The next action.
    pub(crate) fn poll(&mut self, now: i64) -> Action {
        match self.read_back.poll(instant(now)) {
            Output::Request(Request::ReadJoints) | Output::Wait(_) => Action::Wait,
            Output::Request(_) => Action::Send(self.effect()),
            Output::Done(Ok(outcome)) => Action::Answer(Outcome {
                success: true,
                message: outcome.to_string(),
            }),
            Output::Done(Err(error)) => Action::Answer(refused(&error.to_string())),
        }
    }
}

/// A system time on the clock of the state machines, which has no time before 1970.
fn instant(nanos: i64) -> Instant {
    Instant::from_micros(u64::try_from(nanos / 1_000).unwrap_or(0))
}

/// The outcome of a request that has no effect, for this reason.
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

    const MILLISECOND: i64 = 1_000_000;
    /// The rows that every program follows.
    const EFFECTS: &str = include_str!("../../protocol/tests/effects.txt");

    #[test]
    fn rows_of_readings_have_their_verdicts() {
        for row in EFFECTS.lines().filter(|row| !row.starts_with('#')) {
            let columns: Vec<_> = row.split_whitespace().collect();
            let [effect, status, ticks, change, later_status, later_ticks, verdict] = columns[..] else {
                panic!("{row}");
            };
            let effect = match effect {
                "torque-on" => Effect::Torque(Torque::On),
                "torque-off" => Effect::Torque(Torque::Off),
                _ => Effect::Zero,
            };
            let state = |status: &str, ticks: &str| JointState {
                joints: [ticks.parse().unwrap(); 6],
                gripper: 500,
                status: MotionStatus::from(u8::from_str_radix(status, 16).unwrap()),
            };
            let change = MILLISECOND * change.parse::<i64>().unwrap();
            let (before, after) = (state(status, ticks), state(later_status, later_ticks));
            let sent = 1_000 * MILLISECOND;
            let mut pending = Pending::new((), effect);
            assert_eq!(pending.poll(sent), Action::Send(effect));
            // A reading of the time before the request, as an adapter delivers it.
            pending.on_joints(sent - MILLISECOND, &after);
            let mut now = sent;
            let outcome = loop {
                match pending.poll(now) {
                    Action::Answer(outcome) => break outcome,
                    action => assert_eq!(action, Action::Wait, "{row}"),
                }
                now += 5 * MILLISECOND;
                pending.on_joints(now, if now - sent < change { &before } else { &after });
            };
            let (time, text) = match verdict {
                "confirmed" => (change.max(5 * MILLISECOND), ""),
                "not-shown" => (500 * MILLISECOND, " does not show its effect"),
                _ => (500 * MILLISECOND, " was sent, but "),
            };
            assert_eq!(outcome.success, verdict != "contradicted", "{row}: {outcome:?}");
            assert!(outcome.message.contains(text), "{row}: {outcome:?}");
            assert_eq!(now - sent, time, "{row}");
        }
    }
}
