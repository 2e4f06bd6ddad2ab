//! Requests without an answer: what a reading shows of their effect.

use core::fmt;

use super::{JointState, Move, Position, Request, Torque};
use crate::time::{Duration, Instant};

/// The effect of a request that the arm does not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Effect {
    /// The torque is switched. Without it the arm falls.
    Torque(Torque),
    /// The present pose becomes zero. The arm switches its torque off, and falls.
    Zero,
}

/// What a reading says of an effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// It shows the effect.
    Confirmed,
    /// It shows neither the effect nor its absence: see [`MotionStatus::is_holding`](super::MotionStatus::is_holding).
    NotShown,
    /// It shows that the effect is missing.
    Contradicted,
}

/// The end of a read-back. Its text is for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Outcome {
    /// The effect that was asked for.
    pub effect: Effect,
    /// What the last reading says of it.
    pub verdict: Verdict,
    /// The last reading.
    pub state: JointState,
}

/// The read-back of an effect: a state machine without I/O.
///
/// ```
/// use armwire::ling::effect::{Effect, ReadBack, Verdict};
/// use armwire::ling::{JointState, MotionStatus, Torque};
/// use armwire::time::Instant;
///
/// let read_back = ReadBack::new(Effect::Torque(Torque::On), Instant::ZERO);
/// let state = JointState { joints: [2048; 6], gripper: 0, status: MotionStatus::Idle };
/// assert_eq!(read_back.on_joints(Instant::from_millis(1), &state), None);
/// let outcome = read_back.on_joints(Instant::from_millis(500), &state).unwrap();
/// assert_eq!(outcome.verdict, Verdict::Contradicted);
/// ```
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReadBack {
    effect: Effect,
    sent: Instant,
}

impl Effect {
    /// The request that has this effect.
    pub const fn request(self) -> Request {
        match self {
            Self::Torque(torque) => Request::SetTorque(torque),
            Self::Zero => Request::SetZero,
        }
    }

    /// True if the arm falls.
    pub const fn drops_arm(self) -> bool {
        !matches!(self, Self::Torque(Torque::On))
    }

    /// What this reading says of it.
    pub fn verdict(self, state: &JointState) -> Verdict {
        let is_shown = match self {
            Self::Torque(torque) => state.status.is_holding().map(|holds| holds == (torque == Torque::On)),
            Self::Zero => {
                let is_zero = |ticks: &u16| ticks.abs_diff(Position::CENTRE.ticks()) <= Move::JOINT_TOLERANCE;
                Some(state.joints.iter().all(is_zero))
            }
        };
        match is_shown {
            Some(true) => Verdict::Confirmed,
            None => Verdict::NotShown,
            Some(false) => Verdict::Contradicted,
        }
    }
}

impl ReadBack {
    /// The time after the request within which a reading must show the effect.
    pub const LIMIT: Duration = Duration::from_millis(500);

    /// The read-back of a request that was sent at this time.
    pub const fn new(effect: Effect, sent: Instant) -> Self {
        Self { effect, sent }
    }

    /// The effect that is read back.
    pub const fn effect(&self) -> Effect {
        self.effect
    }

    /// Takes a reading that was made at `at`: one that is not later than the request says nothing. Returns the outcome of
    /// the first reading that shows the effect, or of the first one after [`LIMIT`](Self::LIMIT).
    pub fn on_joints(&self, at: Instant, state: &JointState) -> Option<Outcome> {
        let (effect, state) = (self.effect, *state);
        let verdict = effect.verdict(&state);
        let is_over = verdict == Verdict::Confirmed || at.since(self.sent) >= Self::LIMIT;
        (at > self.sent && is_over).then_some(Outcome { effect, verdict, state })
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (request, state, status) = (self.effect.request(), self.state, self.state.status);
        match (self.verdict, self.effect) {
            (Verdict::Confirmed, Effect::Torque(Torque::On)) => {
                write!(f, "torque on: the arm holds its position (status {status})")
            }
            (Verdict::Confirmed, Effect::Torque(Torque::Off)) => {
                write!(f, "torque off: the arm can be moved by hand (status {status})")
            }
            (Verdict::Confirmed, Effect::Zero) => write!(f, "zero set: {state}"),
            (Verdict::NotShown, _) => write!(f, "{request}: sent; status {status} does not show its effect"),
            (Verdict::Contradicted, Effect::Torque(_)) => write!(f, "{request} was sent, but the status is {status}"),
            (Verdict::Contradicted, Effect::Zero) => write!(f, "{request} was sent, but the arm reports {state}"),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::super::MotionStatus;
    use super::*;

    fn state(ticks: u16, status: MotionStatus) -> JointState {
        JointState {
            joints: [ticks; 6],
            gripper: 0,
            status,
        }
    }

    /// The one table: what every status says of a torque that was switched on, and off.
    #[test]
    fn every_status_has_a_verdict() {
        use Verdict::{Confirmed, Contradicted, NotShown};
        for code in 0..=u8::MAX {
            let status = MotionStatus::from(code);
            let expected = match status {
                MotionStatus::Locked | MotionStatus::SyncLocked => (Confirmed, Contradicted),
                MotionStatus::Idle | MotionStatus::OverheatProtection => (Contradicted, Confirmed),
                MotionStatus::Syncing | MotionStatus::Overheating | MotionStatus::Other(_) => (NotShown, NotShown),
            };
            let [on, off] = [Torque::On, Torque::Off].map(|torque| {
                let read_back = ReadBack::new(Effect::Torque(torque), Instant::ZERO);
                let outcome = |millis| read_back.on_joints(Instant::from_millis(millis), &state(0, status));
                assert_eq!(outcome(0), None, "made before the request");
                let last = outcome(500).unwrap().verdict;
                assert_eq!(outcome(1).is_some(), last == Confirmed, "{status}");
                last
            });
            assert_eq!((on, off), expected, "{status}");
        }
    }

    #[test]
    fn zero_is_shown_by_the_joints() {
        let verdict = |ticks| Effect::Zero.verdict(&state(ticks, MotionStatus::Idle));
        assert_eq!([2045, 2048, 2051].map(verdict), [Verdict::Confirmed; 3]);
        assert_eq!([2044, 2052].map(verdict), [Verdict::Contradicted; 2]);
    }
}
