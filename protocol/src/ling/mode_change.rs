//! A change of the control mode, which the arm accepts before it applies it: answers in, requests out.

use core::fmt;

use super::{ControlMode, ModeReply, ModeResult, ModeState, Request};
use crate::time::{Duration, Instant};

/// Time between two readings.
const PERIOD: Duration = Duration::from_millis(20);

/// Sets the control mode of a force-feedback leader, and waits until it is applied: a state machine without I/O.
///
/// The request is made once. Its answer only says that the arm has accepted it; a reading that is later shows that the
/// mode is applied. [`poll`](Self::poll) returns requests. The answer of [`Request::SetMode`] goes in by
/// [`on_reply`](Self::on_reply), and that of [`Request::ReadMode`] by [`on_mode`](Self::on_mode). A missing answer needs
/// no call. An arm that is not known to be such a leader is asked for its mode before.
///
/// After a return to position mode the torque stays off.
///
/// ```
/// use armwire::ling::mode_change::Output;
/// use armwire::ling::{ControlMode, JointMask, ModeChange, ModeReply, ModeResult, ModeState, Request};
/// use armwire::time::{Duration, Instant};
///
/// let reply = ModeReply { requested: 1, result: ModeResult::Accepted };
/// let mut state = ModeState {
///     mode: ControlMode::Position,
///     blocked: JointMask(0),
///     valid: JointMask(0x3F),
///     joints: Default::default(),
/// };
/// let (mut change, mut now, mut readings) = (ModeChange::new(ControlMode::Current), Instant::ZERO, 0);
/// let applied = loop {
///     match change.poll(now) {
///         // Make the call here, and pass its answer in.
///         Output::Request(Request::SetMode(_)) => change.on_reply(&reply),
///         Output::Request(_) => {
///             change.on_mode(now, &state);
///             readings += 1;
///             state.mode = ControlMode::Current;
///         }
///         Output::Wait(until) => now = until,
///         Output::Done(result) => break result?,
///     }
///     now += Duration::from_millis(1);
/// };
/// assert_eq!((applied.mode, readings), (ControlMode::Current, 2));
/// # Ok::<(), armwire::ling::mode_change::ModeError>(())
/// ```
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ModeChange {
    mode: ControlMode,
    /// The time of the request.
    sent: Option<Instant>,
    reply: Option<ModeReply>,
    /// The last reading after the request.
    last: Option<ModeState>,
    step: Step,
}

#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
enum Step {
    Send,
    /// The time of the next reading.
    Read(Instant),
    End(Result<ModeState, ModeError>),
}

/// The next action for the caller of a [`ModeChange`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Output {
    /// Make this request, and pass its answer in.
    Request(Request),
    /// Poll again at this time.
    Wait(Instant),
    /// The end, with the reading that shows the mode. Later polls return it again.
    Done(Result<ModeState, ModeError>),
}

/// The reason why a mode is not applied.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum ModeError {
    /// The arm refuses the mode.
    Refused {
        /// The mode.
        mode: ControlMode,
        /// The arm's verdict.
        result: ModeResult,
    },
    /// The last reading within [`ModeChange::LIMIT`] has another mode. The arm may apply it later.
    NotApplied {
        /// The mode.
        mode: ControlMode,
        /// The arm has accepted it. False if its answer is missing.
        is_accepted: bool,
        /// The mode of the last reading. `None` if none came.
        applied: Option<ControlMode>,
    },
}

impl ModeChange {
    /// The time after the request within which a reading must show the mode. The document has none.
    pub const LIMIT: Duration = Duration::from_millis(2_000);

    /// A change to this mode. Its request is the first action.
    pub const fn new(mode: ControlMode) -> Self {
        Self {
            mode,
            sent: None,
            reply: None,
            last: None,
            step: Step::Send,
        }
    }

    /// The mode.
    pub const fn mode(&self) -> ControlMode {
        self.mode
    }

    /// The next action.
    pub fn poll(&mut self, now: Instant) -> Output {
        match self.step {
            Step::Send => {
                self.sent = Some(now);
                self.step = Step::Read(now);
                Output::Request(Request::SetMode(self.mode))
            }
            Step::Read(next) => {
                let limit = self.sent.map_or(now, |sent| sent + Self::LIMIT);
                if now >= limit {
                    let error = ModeError::NotApplied {
                        mode: self.mode,
                        is_accepted: self.reply.is_some(),
                        applied: self.last.map(|state| state.mode),
                    };
                    self.step = Step::End(Err(error));
                    Output::Done(Err(error))
                } else if next > now {
                    Output::Wait(next.min(limit))
                } else {
                    self.step = Step::Read(now + PERIOD);
                    Output::Request(Request::ReadMode)
                }
            }
            Step::End(result) => Output::Done(result),
        }
    }

    /// Takes the answer to the request. One for another mode says nothing.
    pub fn on_reply(&mut self, reply: &ModeReply) {
        if let Step::Read(_) = self.step
            && reply.requested == self.mode as u8
        {
            self.reply = Some(*reply);
            if reply.result != ModeResult::Accepted {
                self.step = Step::End(Err(ModeError::Refused {
                    mode: self.mode,
                    result: reply.result,
                }));
            }
        }
    }

    /// Takes a reading of the mode that arrived at `now`. One that is not later than the request says nothing.
    pub fn on_mode(&mut self, now: Instant, state: &ModeState) {
        if let Step::Read(_) = self.step
            && self.sent.is_some_and(|sent| now > sent)
        {
            self.last = Some(*state);
            if state.mode == self.mode {
                self.step = Step::End(Ok(*state));
            }
        }
    }
}

impl fmt::Display for ModeError {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match *self {
            Self::Refused { mode, result } => write!(f, "{}: the arm answered: {result}", Request::SetMode(mode)),
            Self::NotApplied {
                mode,
                is_accepted,
                applied,
            } => {
                let verdict = if is_accepted { "accepted" } else { "sent" };
                write!(f, "{} was {verdict}, but ", Request::SetMode(mode))?;
                match applied {
                    Some(applied) => write!(f, "the mode is {applied} after 2 s"),
                    None => f.write_str("no reading of the mode came within 2 s"),
                }
            }
        }
    }
}

impl core::error::Error for ModeError {}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;
    use std::vec::Vec;

    use super::super::{JointForce, JointMask};
    use super::*;

    fn state(mode: ControlMode) -> ModeState {
        ModeState {
            mode,
            blocked: JointMask(0),
            valid: JointMask(0x3F),
            joints: [JointForce::default(); 6],
        }
    }

    /// The end of a change to current mode, its time in milliseconds, and the requests. The arm answers the request with
    /// this verdict and each reading with the mode at its time, if at all.
    fn change(
        verdict: Option<ModeResult>,
        mode_at: impl Fn(u64) -> Option<ControlMode>,
    ) -> (u64, Result<ControlMode, ModeError>, Vec<Request>) {
        let mut change = ModeChange::new(ControlMode::Current);
        let mut requests = Vec::new();
        for millis in 0.. {
            let now = Instant::from_millis(millis);
            match change.poll(now) {
                Output::Request(request) => {
                    requests.push(request);
                    match request {
                        Request::SetMode(_) => {
                            if let Some(result) = verdict {
                                change.on_reply(&ModeReply { requested: 1, result });
                            }
                        }
                        _ => {
                            if let Some(mode) = mode_at(millis) {
                                change.on_mode(now, &state(mode));
                            }
                        }
                    }
                }
                Output::Wait(_) => {}
                Output::Done(result) => return (millis, result.map(|state| state.mode), requests),
            }
        }
        unreachable!()
    }

    #[test]
    fn accepted_mode_is_waited_for() {
        use ControlMode::{Current, Position};
        let applied_at = |time| move |millis| Some(if millis >= time { Current } else { Position });
        let (millis, result, requests) = change(Some(ModeResult::Accepted), applied_at(300));
        assert_eq!(result, Ok(Current));
        assert!((300..330).contains(&millis), "{millis}");
        let set = Request::SetMode(Current);
        assert_eq!(requests[0], set);
        assert!(requests[1..].iter().all(|request| *request == Request::ReadMode));
        // Its answer is lost: the reading decides.
        assert_eq!(change(None, applied_at(300)).1, Ok(Current));
    }

    #[test]
    fn refused_mode_ends_the_change_at_once() {
        for (result, text) in [
            (
                ModeResult::Invalid,
                "set control mode current: the arm answered: invalid",
            ),
            (
                ModeResult::Unsupported,
                "set control mode current: the arm answered: unsupported or not queued",
            ),
        ] {
            let (millis, end, requests) = change(Some(result), |_| Some(ControlMode::Current));
            assert_eq!((millis, requests.len()), (1, 1));
            assert_eq!(end.unwrap_err().to_string(), text);
        }
    }

    #[test]
    fn mode_that_is_never_applied_is_an_error() {
        let position = |_| Some(ControlMode::Position);
        let rows = [
            (
                change(Some(ModeResult::Accepted), position),
                "set control mode current was accepted, but the mode is position after 2 s",
            ),
            (
                change(None, position),
                "set control mode current was sent, but the mode is position after 2 s",
            ),
            (
                change(None, |_| None),
                "set control mode current was sent, but no reading of the mode came within 2 s",
            ),
        ];
        for ((millis, end, requests), text) in rows {
            assert_eq!(end.unwrap_err().to_string(), text);
            assert_eq!(millis, ModeChange::LIMIT.as_micros() / 1_000);
            // It is sent once: a second one would be a second change.
            let set = |request: &&Request| matches!(request, Request::SetMode(_));
            assert_eq!(requests.iter().filter(set).count(), 1);
        }
    }

    #[test]
    fn answer_for_another_mode_says_nothing() {
        let mut change = ModeChange::new(ControlMode::Current);
        assert!(matches!(
            change.poll(Instant::ZERO),
            Output::Request(Request::SetMode(_))
        ));
        let (requested, result) = (ControlMode::Position as u8, ModeResult::Unsupported);
        change.on_reply(&ModeReply { requested, result });
        assert_eq!(change.poll(Instant::ZERO), Output::Request(Request::ReadMode));
    }

    #[test]
    fn earlier_reading_says_nothing() {
        let mut change = ModeChange::new(ControlMode::Current);
        change.on_mode(Instant::ZERO, &state(ControlMode::Current));
        assert!(matches!(
            change.poll(Instant::ZERO),
            Output::Request(Request::SetMode(_))
        ));
        change.on_mode(Instant::ZERO, &state(ControlMode::Current));
        assert_eq!(change.poll(Instant::ZERO), Output::Request(Request::ReadMode));
    }
}
