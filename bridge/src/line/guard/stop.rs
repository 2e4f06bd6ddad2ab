//! The state of a stop: its steps, and the time without motion.

use armwire::correlation::Effect;
use armwire::exchange::time_of_state;
use armwire::ling::{
    self, JointState, Ling, Move, Torque,
    stop::{Output, StopError},
};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};

use crate::arm::{Info, OwnRequest};
use crate::config::ArmKind;
use crate::control::{Failure, FrameBytes, Initiator, STOP_MS, StopInForce};

use crate::line::wire::Answered;

/// The time without motion.
const REFUSAL: Duration = Duration::from_millis(STOP_MS as u64);

/// The state of a stop.
pub(crate) struct Stop {
    /// The end of the refusal of motion, and of the steps. `None` without a stop.
    until: Option<Instant>,
    /// The host that requested the last stop.
    by: Initiator,
    /// The begin of the steps.
    begun: Instant,
    /// The steps that are left, and the time of the next one.
    steps: Option<Steps>,
    due: Option<Instant>,
    /// A reading was requested. The first goes before all other requests.
    has_read: bool,
    /// A hold went out.
    has_held: bool,
    result: Option<Result<(), Failure>>,
    /// The last move on the line. `None` before, and after what may have changed the arm's goal.
    last: Option<Move>,
}

/// The steps that stop one kind of arm.
#[allow(clippy::large_enum_variant, reason = "one at a time, and no heap to put it on")]
pub(in crate::line) enum Steps {
    Ling(ling::Stop),
    /// The arm's own request, until it was sent.
    Own(Option<&'static [u8]>),
}

/// The next step of a kind of arm.
enum Next {
    /// Read the joints.
    Read,
    /// Send this request.
    Hold(FrameBytes),
    Wait(Instant),
    Done(Result<(), Failure>),
}

/// The next step of a stop.
pub(crate) enum Step {
    /// Nothing is due, or there is no stop.
    Wait,
    /// Read the joints, and ask for the next step at once.
    Read,
    /// Send this request. The next step follows when it [went out](Stop::hold_sent).
    Hold(FrameBytes),
    /// No request of the stop goes out any more.
    Done,
}

impl Steps {
    /// `None` if this kind of arm cannot be stopped. `last` is its last move.
    fn new(kind: ArmKind, last: Option<&Move>) -> Option<Self> {
        match kind {
            ArmKind::Ling => Some(Self::Ling(
                last.map_or_else(|| ling::Stop::new(None), ling::Stop::after),
            )),
            kind => kind.own(OwnRequest::Stop).map(|request| Self::Own(Some(request))),
        }
    }

    fn next(&mut self, now: Instant) -> Next {
        match self {
            Self::Ling(stop) => loop {
                return match stop.poll(now) {
                    Output::Request(ling::Request::ReadJoints) => Next::Read,
                    Output::Request(request @ ling::Request::Move(_)) => {
                        let mut out = [0; ling::MAX_FRAME];
                        let len = Ling.encode_request(&request, &mut out).unwrap_or(0);
                        Next::Hold(own(out.get(..len).unwrap_or_default()))
                    }
                    // Torque-on would end the host's stream: there is none.
                    Output::Request(_) => continue,
                    Output::Wait(until) => Next::Wait(until),
                    Output::Done(Ok(_)) => Next::Done(Ok(())),
                    Output::Done(Err(StopError::Position(_))) => Next::Done(Err(Failure::PoseOutOfRange)),
                    Output::Done(Err(_)) => Next::Done(Err(Failure::ArmSilent)),
                };
            },
            Self::Own(request) => match request.take() {
                Some(request) => Next::Hold(own(request)),
                None => Next::Done(Ok(())),
            },
        }
    }

    /// Takes a frame of the arm. Returns true if it is a reading.
    fn on_frame(&mut self, frame: &[u8], at: Instant) -> bool {
        match self {
            Self::Ling(stop) => match JointState::of_frame(frame) {
                Some(state) => {
                    stop.on_joints(at, &state);
                    true
                }
                None => false,
            },
            Self::Own(_) => false,
        }
    }
}

impl Stop {
    pub(in crate::line) fn new() -> Self {
        Self {
            until: None,
            by: Initiator::Usb,
            begun: Instant::ZERO,
            steps: None,
            due: None,
            has_read: false,
            has_held: false,
            result: None,
            last: None,
        }
    }

    pub(in crate::line) const fn refuses_motion(&self) -> bool {
        self.until.is_some()
    }

    /// Returns true while steps are left.
    pub(in crate::line) const fn is_running(&self) -> bool {
        self.steps.is_some()
    }

    /// Returns true if a reading was requested.
    pub(in crate::line) const fn has_read(&self) -> bool {
        self.has_read
    }

    /// The steps that would stop this kind of arm. `None` if it cannot be stopped.
    pub(in crate::line) fn steps(&self, kind: ArmKind) -> Option<Steps> {
        Steps::new(kind, self.last.as_ref())
    }

    /// Refuses motion from now on, for its time, by a request of this host. Returns true if it was not refused before.
    pub(in crate::line) fn refuse_motion(&mut self, by: Initiator, now: Instant) -> bool {
        self.by = by;
        self.until.replace(now + REFUSAL).is_none()
    }

    /// The host that requested the last stop.
    pub(in crate::line) const fn by(&self) -> Initiator {
        self.by
    }

    /// The stop for which motion is refused.
    pub(in crate::line) fn in_force(&self, now: Instant) -> Option<StopInForce> {
        let left = self.until?.since(now).as_micros().div_ceil(1_000);
        Some(StopInForce {
            by: self.by,
            left_ms: left.min(STOP_MS.into()) as u16,
        })
    }

    /// Begins the steps, unless they are running. Returns true if they begin.
    pub(in crate::line) fn begin(&mut self, steps: Steps, now: Instant) -> bool {
        let begins = self.steps.is_none();
        if begins {
            (self.steps, self.begun) = (Some(steps), now);
            (self.has_read, self.has_held) = (false, false);
        } else if self.has_held {
            self.result = Some(Ok(()));
        }
        begins
    }

    /// The arm is stopped without steps.
    pub(in crate::line) const fn stopped(&mut self) {
        self.result = Some(Ok(()));
    }

    /// The result, once.
    pub(in crate::line) const fn take_result(&mut self) -> Option<Result<(), Failure>> {
        self.result.take()
    }

    /// The next step.
    pub(in crate::line) fn step(&mut self, now: Instant) -> Step {
        let Some(steps) = &mut self.steps else {
            return Step::Wait;
        };
        match steps.next(now) {
            Next::Read => Step::Read,
            Next::Hold(request) => {
                self.due = None;
                Step::Hold(request)
            }
            Next::Wait(until) => {
                self.due = Some(until);
                Step::Wait
            }
            Next::Done(result) => {
                self.end(result);
                Step::Done
            }
        }
    }

    /// A reading went out.
    pub(in crate::line) const fn reading_sent(&mut self) {
        self.has_read = true;
    }

    /// The hold went out.
    pub(in crate::line) const fn hold_sent(&mut self) {
        if !core::mem::replace(&mut self.has_held, true) {
            self.result = Some(Ok(()));
        }
    }

    /// Returns true if a step is due at `now`.
    pub(in crate::line) fn is_step_due(&self, now: Instant) -> bool {
        self.due.is_some_and(|at| at <= now)
    }

    /// Returns true if the refusal of motion ends at `now`.
    pub(in crate::line) fn is_over(&self, now: Instant) -> bool {
        self.until.is_some_and(|until| until <= now)
    }

    /// Ends the refusal of motion and the steps.
    pub(in crate::line) fn end_refusal(&mut self) {
        self.end(Err(Failure::ArmSilent));
        self.until = None;
    }

    /// Ends the stop of an arm that is replaced by another kind. Returns true if it had no result so far.
    pub(in crate::line) fn change_arm(&mut self) -> bool {
        let restarts = self.is_running() && !self.has_held;
        self.end_refusal();
        self.last = None;
        restarts
    }

    /// The stop was repeated for another kind of arm. A failure is its result.
    pub(in crate::line) fn repeated(&mut self, result: Result<(), Failure>) {
        self.result = result.err().map(Err);
    }

    /// The time of the next [step](Self::step) or of the end of the refusal.
    pub(in crate::line) fn timeout(&self) -> Option<Instant> {
        let until = self.until?;
        Some(self.due.map_or(until, |due| due.min(until)))
    }

    /// A request goes to the arm. Bytes without information are none, or those of the host on USB, which are decoded
    /// later.
    pub(in crate::line) fn on_request(&mut self, kind: ArmKind, info: Option<Info>, request: &[u8]) {
        if kind != ArmKind::Ling || info.is_none_or(|info| info.effect == Effect::Read) {
            return;
        }
        self.last = match Ling.parse_request(request) {
            Ok(ling::Request::Move(target)) => Some(target),
            Ok(
                ling::Request::SetTorque(Torque::On)
                | ling::Request::SetStroke(_)
                | ling::Request::SetTemperatureLimit(_),
            ) => self.last,
            // The arm falls, or what it does is not known.
            _ => None,
        };
    }

    /// Takes the answer to a request. Returns true if it is a reading. Before the hold any reading of the joints counts
    /// that was requested since the begin, and after it those of the stop only: they have its period.
    // Not inlined: it is larger than the rest of its caller.
    #[inline(never)]
    pub(in crate::line) fn on_frame(&mut self, request: Answered, frame: &[u8], at: Instant) -> bool {
        match &mut self.steps {
            Some(steps) if self.begun <= request.sent && (!self.has_held || request.by == Initiator::Adapter) => {
                steps.on_frame(frame, time_of_state(request.sent, at))
            }
            _ => false,
        }
    }

    /// Ends the steps. Only the first result is reported.
    fn end(&mut self, result: Result<(), Failure>) {
        self.due = None;
        if self.steps.take().is_none() {
            return;
        }
        if result.is_err() {
            self.last = None;
        }
        if !self.has_held {
            self.result = Some(result);
        }
    }
}

/// The bytes of a request, which is no longer than any.
fn own(request: &[u8]) -> FrameBytes {
    FrameBytes::from_slice(request).unwrap_or_default()
}
