//! Services. They are answered when the arm's readings show the effect, or after a timeout.

use armwire::ling::effect::{Effect, Output};
use armwire::ling::{JointState, ReadBack};
use armwire::time::Instant;

use crate::messages::Outcome;

/// A request of the client `id` that was sent to the arm.
#[derive(Debug)]
pub(crate) struct Pending<I> {
    pub(crate) id: I,
    read_back: ReadBack,
}

impl<I> Pending<I> {
    /// A request that was sent by `now`.
    pub(crate) fn sent(id: I, effect: Effect, now: Instant) -> Self {
        let mut read_back = ReadBack::new(effect);
        // The first action is the request.
        read_back.poll(now);
        Self { id, read_back }
    }

    pub(crate) fn effect(&self) -> Effect {
        self.read_back.effect()
    }

    /// Takes a reading of the joints that was made at `at`.
    pub(crate) fn on_joints(&mut self, at: Instant, state: &JointState) {
        self.read_back.on_joints(at, state);
    }

    /// The answer; `None` while it waits for readings, which come at a rate.
    pub(crate) fn poll(&mut self, now: Instant) -> Option<Outcome> {
        match self.read_back.poll(now) {
            Output::Request(_) | Output::Wait(_) => None,
            Output::Done(Ok(outcome)) => Some(Outcome {
                success: true,
                message: outcome.to_string(),
            }),
            Output::Done(Err(error)) => Some(refused(&error.to_string())),
        }
    }
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
    use armwire::time::Duration;
    use armwire_bridge::control::Stamp;
    use armwire_host::StreamReading;
    use armwire_host::stamps::{Clock, HostTime};

    use super::*;
    use crate::source::Input;

    const MILLISECOND: Duration = Duration::from_millis(1);
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
            let change = Duration::from_millis(change.parse().unwrap());
            let (before, after) = (state(status, ticks), state(later_status, later_ticks));
            let sent = Instant::from_millis(1_000);
            let mut pending = Pending::sent((), effect, sent);
            // A reading of the time before the request, as an adapter delivers it.
            pending.on_joints(sent - MILLISECOND, &after);
            let mut now = sent;
            let outcome = loop {
                if let Some(outcome) = pending.poll(now) {
                    break outcome;
                }
                now += Duration::from_millis(5);
                pending.on_joints(now, if now.since(sent) < change { &before } else { &after });
            };
            let (time, text) = match verdict {
                "confirmed" => (change.max(Duration::from_millis(5)), ""),
                "not-shown" => (ReadBack::LIMIT, " does not show its effect"),
                _ => (ReadBack::LIMIT, " was sent, but "),
            };
            assert_eq!(outcome.success, verdict != "contradicted", "{row}: {outcome:?}");
            assert!(outcome.message.contains(text), "{row}: {outcome:?}");
            assert_eq!(now.since(sent), time, "{row}");
        }
    }

    /// The time of the answer after a request whose readings show this status, 7 ms old, while the system time is set
    /// back by an hour.
    fn answered(status: MotionStatus) -> (u64, bool) {
        let state = JointState {
            joints: [2_048; 6],
            gripper: 500,
            status,
        };
        let (mut clock, mut pending) = (Clock::default(), None);
        for millis in (0..5_000).step_by(10) {
            let now = Instant::from_millis(millis);
            let set = if millis < 1_010 { 0 } else { -3_600_000 };
            let received = HostTime {
                monotonic_ns: millis as i64 * 1_000_000,
                unix_ns: (1_700_000_000_000 + millis as i64 + set) * 1_000_000,
            };
            // The first reading arrives at once.
            let age = if millis == 0 { 0 } else { 7_000 };
            let time = clock.host_time(Stamp(millis * 1_000 - age), received);
            let reading = StreamReading { state, time };
            let Input::Reading { age, state, .. } = Input::reading(reading, received) else {
                unreachable!()
            };
            if millis == 1_000 {
                pending = Some(Pending::sent((), Effect::Torque(Torque::Off), now));
            }
            let Some(pending) = &mut pending else { continue };
            pending.on_joints(now - age, &state);
            if let Some(outcome) = pending.poll(now) {
                return (millis, outcome.success);
            }
        }
        panic!("no answer");
    }

    #[test]
    fn step_of_the_system_time_delays_no_answer() {
        assert_eq!(answered(MotionStatus::Idle), (1_010, true));
        assert_eq!(answered(MotionStatus::Locked), (1_500, false));
    }
}
