//! Setting what the arm does not confirm: readings in, requests out.

use core::fmt;

use super::{JointState, Position, Request, Rest, Torque};
use crate::time::{Duration, Instant};

/// Time between two readings.
const PERIOD: Duration = Duration::from_millis(20);

/// Time for a last reading after [`ReadBack::LIMIT`].
const EXTRA: Duration = Duration::from_millis(100);

/// The effect of a request that the arm does not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Effect {
    /// The torque is on or off. Without it the arm falls.
    Torque(Torque),
    /// The present pose is zero. The arm switches its torque off, and falls.
    Zero,
}

/// The evidence for an effect in one reading.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Verdict {
    /// The reading shows the effect.
    Confirmed,
    /// The reading shows neither the effect nor its absence. The status *overheating* is the same with and without torque.
    NotShown,
    /// The reading shows that the effect is missing.
    Contradicted,
}

/// Makes a request that the arm does not answer, and reads its effect back: a state machine without I/O.
///
/// The request is made once: a second zero would take the pose of an arm that falls. The first reading that shows the
/// effect ends the read-back. Otherwise the one at [`ReadBack::LIMIT`] decides: an older one leaves 0.1 s more for it.
/// A reading that is not later than the request says nothing.
///
/// [`poll`](Self::poll) returns requests; the joints read by [`Request::ReadJoints`] go in by
/// [`on_joints`](Self::on_joints). A failed read needs no call: it is repeated. A caller that gets readings anyway
/// may ignore the requests for them.
///
/// ```
/// use armwire::ling::effect::{Effect, Output};
/// use armwire::ling::{JointState, MotionStatus, ReadBack, Request, Torque};
/// use armwire::time::{Duration, Instant};
///
/// let state = JointState { joints: [2048; 6], gripper: 500, status: MotionStatus::Locked };
/// let (mut read_back, mut now) = (ReadBack::new(Effect::Torque(Torque::On)), Instant::ZERO);
/// let outcome = loop {
///     match read_back.poll(now) {
///         // Make the call here, and pass its answer in.
///         Output::Request(Request::ReadJoints) => read_back.on_joints(now, &state),
///         Output::Request(request) => assert_eq!(request, Request::SetTorque(Torque::On)),
///         Output::Wait(until) => now = until,
///         Output::Done(result) => break result?,
///     }
///     now += Duration::from_millis(1);
/// };
/// assert_eq!(outcome.to_string(), "torque on: the arm holds its position (status locked)");
/// # Ok::<(), armwire::ling::effect::EffectError>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ReadBack {
    effect: Effect,
    /// The time of the request.
    sent: Option<Instant>,
    /// The last reading after the request, and its time.
    last: Option<(Instant, JointState)>,
    /// The end of the time for a last reading after the limit, if the one before is old.
    extended: Option<Instant>,
    step: Step,
}

#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
enum Step {
    Send,
    /// The time of the next reading.
    Read(Instant),
    End,
}

/// The next action for the caller of a [`ReadBack`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// Make this request. Pass the answer of [`Request::ReadJoints`] to [`ReadBack::on_joints`].
    Request(Request),
    /// Poll again at this time.
    Wait(Instant),
    /// The end. Later polls return it again.
    Done(Result<Outcome, EffectError>),
}

/// End of a read-back that contradicts nothing. Its text is for people.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Outcome {
    /// The effect.
    pub effect: Effect,
    /// True if the last reading shows the effect: [`Verdict::Confirmed`]. False for [`Verdict::NotShown`].
    pub is_shown: bool,
    /// The last reading.
    pub state: JointState,
}

/// The reason why a request may have no effect.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum EffectError {
    /// The last reading shows that the effect is missing: [`Verdict::Contradicted`].
    Contradicted {
        /// The effect.
        effect: Effect,
        /// The last reading.
        state: JointState,
    },
    /// No reading came.
    NoReading(Effect),
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

    /// The evidence for this effect in a reading: the status for the torque, the joints for zero.
    pub fn verdict(self, state: &JointState) -> Verdict {
        let is_shown = match self {
            Self::Torque(torque) => state.status.is_holding().map(|holds| holds == (torque == Torque::On)),
            Self::Zero => {
                let is_zero = |ticks: &u16| ticks.abs_diff(Position::CENTRE.ticks()) <= Rest::TOLERANCE;
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

    /// A read-back of this effect. Its request is the first action.
    pub const fn new(effect: Effect) -> Self {
        Self {
            effect,
            sent: None,
            last: None,
            extended: None,
            step: Step::Send,
        }
    }

    /// The effect.
    pub const fn effect(&self) -> Effect {
        self.effect
    }

    /// True once the request was an action.
    pub const fn is_sent(&self) -> bool {
        self.sent.is_some()
    }

    /// The result; `None` before the end.
    pub fn result(&self) -> Option<Result<Outcome, EffectError>> {
        matches!(self.step, Step::End).then(|| self.end())
    }

    /// The next action.
    pub fn poll(&mut self, now: Instant) -> Output {
        let limit = self.sent.map_or(now, |sent| sent + Self::LIMIT);
        match self.step {
            Step::Send => {
                self.sent = Some(now);
                self.step = Step::Read(now);
                Output::Request(self.effect.request())
            }
            Step::Read(next) => {
                let end = self.end_of_reading(now, limit);
                if now >= end {
                    self.step = Step::End;
                    Output::Done(self.end())
                } else if next > now {
                    Output::Wait(next.min(end))
                } else {
                    self.step = Step::Read(now + PERIOD);
                    Output::Request(Request::ReadJoints)
                }
            }
            Step::End => Output::Done(self.end()),
        }
    }

    /// Takes a reading of the joints that arrived at `now`.
    pub fn on_joints(&mut self, now: Instant, state: &JointState) {
        if let Step::Read(_) = self.step
            && self.sent.is_some_and(|sent| now > sent)
        {
            self.last = Some((now, *state));
            if self.effect.verdict(state) == Verdict::Confirmed {
                self.step = Step::End;
            }
        }
    }

    /// The end of the readings: the limit, but later if the last reading is older than a period then. The caller may have
    /// made other calls since.
    fn end_of_reading(&mut self, now: Instant, limit: Instant) -> Instant {
        let is_old = self.last.is_some_and(|(at, _)| at + PERIOD < limit);
        match now >= limit && is_old {
            true => *self.extended.get_or_insert(now + EXTRA),
            false => limit,
        }
    }

    /// The end by the last reading.
    fn end(&self) -> Result<Outcome, EffectError> {
        let effect = self.effect;
        let (_, state) = self.last.ok_or(EffectError::NoReading(effect))?;
        let is_shown = match effect.verdict(&state) {
            Verdict::Confirmed => true,
            Verdict::NotShown => false,
            Verdict::Contradicted => return Err(EffectError::Contradicted { effect, state }),
        };
        Ok(Outcome {
            effect,
            is_shown,
            state,
        })
    }
}

impl fmt::Display for Outcome {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let (request, state, status) = (self.effect.request(), self.state, self.state.status);
        match (self.is_shown, self.effect) {
            (true, Effect::Torque(Torque::On)) => {
                write!(f, "torque on: the arm holds its position (status {status})")
            }
            (true, Effect::Torque(Torque::Off)) => {
                write!(f, "torque off: the arm can be moved by hand (status {status})")
            }
            (true, Effect::Zero) => write!(f, "zero set: {state}"),
            (false, _) => write!(f, "{request}: sent; status {status} does not show its effect"),
        }
    }
}

impl fmt::Display for EffectError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Contradicted { effect, state } => {
                write!(f, "{} was sent, but ", effect.request())?;
                match effect {
                    Effect::Torque(_) => write!(f, "the status is {}", state.status),
                    Effect::Zero => write!(f, "the arm reports {state}"),
                }
            }
            Self::NoReading(effect) => {
                write!(f, "{} was sent, but no reading came within 0.5 s", effect.request())
            }
        }
    }
}

impl core::error::Error for EffectError {}

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

    /// The one table: the verdict of every status on torque-on, and on torque-off.
    #[test]
    fn every_status_has_a_verdict() {
        use Verdict::{Confirmed, Contradicted, NotShown};
        for code in 0..=u8::MAX {
            let status = MotionStatus::from(code);
            let expected = match code {
                0x01 | 0x11 => (Confirmed, Contradicted),
                0x00 | 0xE2 => (Contradicted, Confirmed),
                _ => (NotShown, NotShown),
            };
            let verdict = |torque| Effect::Torque(torque).verdict(&state(0, status));
            assert_eq!((verdict(Torque::On), verdict(Torque::Off)), expected, "{status}");
            assert_eq!(status.is_torque_off(), expected.1 == Confirmed, "{status}");
        }
    }

    #[test]
    fn zero_is_shown_by_the_joints() {
        let verdict = |ticks| Effect::Zero.verdict(&state(ticks, MotionStatus::Idle));
        assert_eq!([2045, 2048, 2051].map(verdict), [Verdict::Confirmed; 3]);
        assert_eq!([2044, 2052].map(verdict), [Verdict::Contradicted; 2]);
    }
}
