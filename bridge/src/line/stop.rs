//! A stop of the arm: the hold of its pose, and the refusal of motion.

#[cfg(feature = "ling")]
use armwire::ling::{
    self, Ling, Opening, Response,
    stop::{Output, StopError},
};
#[cfg(feature = "ling")]
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};

use crate::arm::OwnRequest;
use crate::config::ArmKind;
use crate::control::{Event, Failure, Initiator, Refusal, STOP_MS};
use crate::counters::count;

use super::Line;
use super::dead_man::STREAMERS;
use super::gate::Gate;
use super::requests::{Request, StopRequest};
use super::to_host::PACKET;

/// The time without motion.
const REFUSAL: Duration = Duration::from_millis(STOP_MS as u64);

/// The state of a stop.
pub(super) struct Stop {
    /// The end of the refusal of motion, and of the steps. `None` without a stop.
    until: Option<Instant>,
    /// The steps that are left, and the time of the next one.
    steps: Option<Steps>,
    due: Option<Instant>,
    /// A reading was requested. The first goes before all other requests.
    pub(super) has_read: bool,
    /// A hold went out.
    has_held: bool,
    result: Option<Result<(), Failure>>,
    gate: Gate,
    /// Free space that a packet of the host on USB needs: its bytes, and those that wait at the gate.
    pub(super) packet_room: usize,
    /// A refusal of the host on USB was reported.
    is_reported: bool,
    /// The gripper's last goal on the line, in thousandths of the stroke.
    goal: Option<u16>,
}

/// The steps that stop one kind of arm.
enum Steps {
    #[cfg(feature = "ling")]
    Ling(ling::Stop),
    /// The arm's own request, until it was sent.
    Own(Option<&'static [u8]>),
}

/// The next step.
enum Step {
    /// Read the joints.
    #[cfg(feature = "ling")]
    Read,
    /// Send this request.
    Hold(Option<Request>),
    #[cfg(feature = "ling")]
    Wait(Instant),
    Done(Result<(), Failure>),
}

impl Steps {
    /// `None` if this kind of arm cannot be stopped. `goal` is that of the gripper.
    fn new(kind: ArmKind, goal: Option<u16>) -> Option<Self> {
        match (kind, goal) {
            #[cfg(feature = "ling")]
            (ArmKind::Ling, goal) => {
                let goal = goal.and_then(|goal| Opening::new(goal).ok());
                Some(Self::Ling(ling::Stop::new(goal)))
            }
            (kind, _) => kind.own(OwnRequest::Stop).map(|request| Self::Own(Some(request))),
        }
    }

    fn next(&mut self, kind: ArmKind, now: Instant) -> Step {
        match self {
            #[cfg(feature = "ling")]
            Self::Ling(stop) => loop {
                return match stop.poll(now) {
                    Output::Request(ling::Request::ReadJoints) => Step::Read,
                    Output::Request(request @ ling::Request::Move(_)) => {
                        let mut out = [0; ling::MAX_FRAME];
                        let len = Ling.encode_request(&request, &mut out).unwrap_or(0);
                        Step::Hold(Request::new(kind, out.get(..len).unwrap_or_default(), now))
                    }
                    // Torque-on would end the host's stream: there is none.
                    Output::Request(_) => continue,
                    Output::Wait(until) => Step::Wait(until),
                    Output::Done(Ok(_)) => Step::Done(Ok(())),
                    Output::Done(Err(StopError::Position(_))) => Step::Done(Err(Failure::PoseOutOfRange)),
                    Output::Done(Err(_)) => Step::Done(Err(Failure::ArmSilent)),
                };
            },
            Self::Own(request) => match request.take() {
                Some(request) => Step::Hold(Request::new(kind, request, now)),
                None => Step::Done(Ok(())),
            },
        }
    }

    /// Takes a frame of the arm. Returns true if it is a reading.
    fn on_frame(&mut self, frame: &[u8], at: Instant) -> bool {
        match (self, frame, at) {
            #[cfg(feature = "ling")]
            (Self::Ling(stop), frame, at) => match Ling.parse_response(frame, ()) {
                Ok(Response::Joints(state)) => {
                    stop.on_joints(at, &state);
                    true
                }
                _ => false,
            },
            (Self::Own(_), ..) => false,
        }
    }
}

impl Stop {
    pub(super) fn new() -> Self {
        Self {
            until: None,
            steps: None,
            due: None,
            has_read: false,
            has_held: false,
            result: None,
            gate: Gate::new(&[]),
            packet_room: PACKET,
            is_reported: false,
            goal: None,
        }
    }

    pub(super) const fn refuses_motion(&self) -> bool {
        self.until.is_some()
    }

    /// Returns true while steps are left.
    pub(super) const fn is_running(&self) -> bool {
        self.steps.is_some()
    }

    /// The time of the next [`tick_stop`](Line::tick_stop).
    pub(super) fn timeout(&self) -> Option<Instant> {
        let until = self.until?;
        Some(self.due.map_or(until, |due| due.min(until)))
    }

    /// Motion goes to the arm by this frame.
    pub(super) fn on_motion(&mut self, kind: ArmKind, frame: &[u8]) {
        self.goal = kind.gripper_goal(frame).or(self.goal);
    }

    /// Takes a frame of the arm. Returns true if it is a reading. Before the hold any reading of the joints counts, and
    /// after it those of the stop only: they have its period.
    // Not inlined: it is larger than the rest of its caller.
    #[inline(never)]
    pub(super) fn on_frame(&mut self, initiator: Option<Initiator>, frame: &[u8], at: Instant) -> bool {
        match &mut self.steps {
            Some(steps) if !self.has_held || initiator == Some(Initiator::Adapter) => steps.on_frame(frame, at),
            _ => false,
        }
    }

    /// Drops the bytes of the host on USB that wait for the rest of their request, and returns their number.
    pub(super) fn drop_gated(&mut self) -> usize {
        self.packet_room = PACKET;
        self.gate.clear()
    }

    /// Ends the steps. Only the first result is reported.
    fn end(&mut self, result: Result<(), Failure>) {
        if self.steps.take().is_some() && !self.has_held {
            self.result = Some(result);
        }
        self.due = None;
    }
}

impl Line {
    /// Stops the arm, by a request on the control port. [`stopped`](Self::stopped) has the result.
    pub(crate) fn stop(&mut self, now: Instant) -> Result<(), Failure> {
        if self.rate.is_on_hold() {
            return Err(Failure::LineHeld);
        }
        let steps = Steps::new(self.kind, self.stop.goal).ok_or(Failure::NotStoppable(self.kind))?;
        // Bytes that were handed over are on their way.
        self.transmitted(now);
        self.take_line_back(now);
        if self.stop.until.replace(now + REFUSAL).is_none() {
            self.drop_motion(now);
        }
        if self.requests.torque_off.is_some() {
            self.stop.result = Some(Ok(()));
        } else if !self.stop.is_running() {
            self.stop.steps = Some(steps);
            (self.stop.has_read, self.stop.has_held) = (false, false);
            self.step_stop(now);
        } else if self.stop.has_held {
            self.stop.result = Some(Ok(()));
        }
        Ok(())
    }

    /// The result of a [`stop`](Self::stop), returned once.
    pub(crate) const fn stopped(&mut self) -> Option<Result<(), Failure>> {
        self.stop.result.take()
    }

    /// Returns true while the adapter stops the arm.
    pub(crate) const fn is_stopping(&self) -> bool {
        self.stop.is_running()
    }

    /// Ends all streams of motion, and drops the motion that waits.
    fn drop_motion(&mut self, now: Instant) {
        for initiator in STREAMERS {
            self.dead_man.end(initiator);
        }
        self.refuse_command(Refusal::Stopped, now);
        for request in core::mem::take(&mut self.requests.can) {
            if request.is_motion() {
                self.refuse(Initiator::Can, Refusal::Stopped, now);
            } else {
                // It was in the queue.
                let _ = self.requests.can.push_back(request);
            }
        }
        self.stop.gate = Gate::new(self.from_host.begun());
        self.stop.packet_room = PACKET.saturating_add(self.stop.gate.len());
        self.stop.is_reported = false;
        self.from_host.end_turn();
        let mut queued = self.from_host.len();
        let mut bytes = [0; PACKET];
        while queued > 0 {
            let taken = self
                .from_host
                .take(bytes.get_mut(..queued.min(PACKET)).unwrap_or_default());
            queued = queued.saturating_sub(taken.max(1));
            self.pass_gate(bytes.get(..taken).unwrap_or_default(), now);
        }
    }

    /// Queues a packet of the host on USB while motion is refused.
    #[cold]
    pub(super) fn pass_gate(&mut self, bytes: &[u8], now: Instant) {
        let refused = self.stop.gate.pass(self.kind, bytes, &mut self.from_host);
        self.stop.packet_room = PACKET.saturating_add(self.stop.gate.len());
        self.refuse_usb_motion(refused, now);
    }

    fn refuse_usb_motion(&mut self, refused: usize, now: Instant) {
        if refused == 0 {
            return;
        }
        count(&mut self.counters.refused_stopped, refused);
        if !core::mem::replace(&mut self.stop.is_reported, true) {
            let (initiator, reason) = (Initiator::Usb, Refusal::Stopped);
            self.deliver(&Event::Refused { initiator, reason }, now);
        }
    }

    /// Executes the steps that are due.
    pub(super) fn step_stop(&mut self, now: Instant) {
        while let Some(steps) = &mut self.stop.steps {
            match steps.next(self.kind, now) {
                #[cfg(feature = "ling")]
                Step::Read => {
                    self.requests.stop.get_or_insert(StopRequest::Reading(now));
                }
                Step::Hold(request) => {
                    self.requests.stop = request.map(StopRequest::Hold);
                    // The next step follows the hold.
                    self.stop.due = None;
                    return;
                }
                #[cfg(feature = "ling")]
                Step::Wait(until) => {
                    self.stop.due = Some(until);
                    return;
                }
                Step::Done(result) => self.end_steps(result),
            }
        }
    }

    /// The hold went out.
    pub(super) fn held(&mut self, now: Instant) {
        if !core::mem::replace(&mut self.stop.has_held, true) {
            self.stop.result = Some(Ok(()));
        }
        self.step_stop(now);
    }

    /// Drops the stop's requests that wait, and ends it.
    fn end_steps(&mut self, result: Result<(), Failure>) {
        self.requests.stop = None;
        self.stop.end(result);
    }

    /// Executes what is due, and ends the refusal of motion at its time.
    pub(super) fn tick_stop(&mut self, now: Instant) {
        if self.stop.due.is_some_and(|at| at <= now) {
            self.step_stop(now);
        }
        if self.stop.until.is_some_and(|until| until <= now) {
            self.end_stop(now);
        }
    }

    /// Ends the refusal of motion.
    fn end_stop(&mut self, now: Instant) {
        self.end_steps(Err(Failure::ArmSilent));
        self.stop.until = None;
        let refused = self.stop.gate.open(&mut self.from_host);
        self.stop.packet_room = PACKET;
        self.refuse_usb_motion(refused, now);
    }

    /// Ends the stop of an arm that is replaced by another kind. Without a result so far, the other is stopped.
    pub(super) fn restart_stop(&mut self, now: Instant) {
        let restarts = self.stop.is_running() && !self.stop.has_held;
        self.end_stop(now);
        self.stop.goal = None;
        if restarts {
            self.stop.result = self.stop(now).err().map(Err);
        }
    }
}
