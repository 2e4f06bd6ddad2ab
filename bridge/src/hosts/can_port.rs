//! The adapter's end of the CAN bus: two ISO-TP connections, cyclic frames both ways, and events as frames.

use heapless::Deque;

use crate::can::telemetry::{Errors, event_to_data};
use crate::can::{Frame, Function, RefusedRequest};
use crate::config::{self, ArmKind};
use crate::control::{Event, FrameBytes, Initiator, MAX_FRAME, MAX_MESSAGE, Refusal, Stamp};
use crate::counters::{Counters, count};
use crate::earliest::Earliest;
use crate::isotp::{self, Endpoint, Link};
use crate::queue::Queue;
use armwire::time::{Duration, Instant};

use super::cyclic::Cyclic;
use super::event_frames::EventFrames;
use super::grid;

/// Maximum length of a message from a host on the control connection, in bytes. The longest, which sets the
/// configuration, has 31.
pub(crate) const MAX_REQUEST: usize = 64;

/// Capacity for frames of the arm that wait for ISO-TP, besides the one in transfer.
const ANSWERS: usize = 4;

/// Capacity for events on the control connection, in bytes.
const EVENTS: usize = 192;

/// Period of the error counts while telemetry is on.
const ERRORS_PERIOD: Duration = Duration::from_millis(1_000);

/// The outcome of a received frame that the caller must handle.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Received {
    /// A request for the arm is complete.
    Arm,
    /// A control message is complete.
    Control,
    /// A command moves the arm by this request.
    Command(FrameBytes),
    /// A request, a message or a command was refused.
    Refused(Initiator, RefusedRequest),
}

/// The adapter's node on the bus.
pub(crate) struct CanPort {
    config: config::Can,
    pub(crate) arm: Endpoint<MAX_FRAME, MAX_FRAME>,
    /// Arrival of the last frame of a request for the arm.
    pub(crate) arm_arrived: Instant,
    pub(crate) control: Endpoint<MAX_REQUEST, MAX_MESSAGE>,
    cyclic: Cyclic,
    answers: Deque<FrameBytes, ANSWERS>,
    /// Control messages that wait, each preceded by its length.
    events: Queue<EVENTS>,
    event_frames: EventFrames,
    /// Time of the next error counts.
    errors_at: Option<Instant>,
    /// Number of frames in the controller, and number of those up to and including the last of each connection.
    handed: u8,
    arm_handed: u8,
    control_handed: u8,
    /// Time up to which timeouts have expired.
    ticked: Instant,
}

impl CanPort {
    // Not inlined: a second copy takes 0.7 kB.
    #[inline(never)]
    pub(crate) fn new(config: config::Can) -> Self {
        let link = match config.data_bit_rate {
            Some(_) => Link::Fd,
            None => Link::Classic,
        };
        let answers = |function: Function| isotp::Config::new(link, function.id(config.node));
        Self {
            config,
            arm: Endpoint::new(answers(Function::ArmAnswer)),
            arm_arrived: Instant::ZERO,
            control: Endpoint::new(answers(Function::ControlAnswer)),
            cyclic: Cyclic::new(&config),
            answers: Deque::new(),
            events: Queue::new(),
            event_frames: EventFrames::new(),
            errors_at: first_errors(&config),
            handed: 0,
            arm_handed: 0,
            control_handed: 0,
            ticked: Instant::ZERO,
        }
    }

    /// Changes the cyclic frames, on the same bus.
    pub(crate) fn adopt(&mut self, config: config::Can, counters: &mut Counters) {
        self.drop_half_command(counters);
        self.config = config;
        self.cyclic.adopt(&config);
        self.errors_at = first_errors(&config);
    }

    /// The configuration of the controller.
    pub(crate) const fn config(&self) -> &config::Can {
        &self.config
    }

    /// Handles a frame from the bus, on which hosts send requests to this `kind` of arm.
    pub(crate) fn received(
        &mut self,
        frame: &Frame,
        kind: ArmKind,
        now: Instant,
        counters: &mut Counters,
    ) -> Option<Received> {
        count(&mut counters.can_frames_received, 1);
        let (function, node) = Function::of(frame.id())?;
        if node != self.config.node {
            return None;
        }
        match function {
            Function::ArmRequest => match count_events(self.arm.receive(frame.data(), now), counters) {
                Outcome::Refused => {
                    let begins_motion = |(len, start)| kind.is_motion(start, len);
                    let full = RefusedRequest {
                        reason: Refusal::QueueFull,
                        keeps_stream: isotp::beginning(frame.data()).is_some_and(begins_motion),
                    };
                    Some(Received::Refused(Initiator::Can, full))
                }
                Outcome::Whole => {
                    self.arm_arrived = now;
                    Some(Received::Arm)
                }
                Outcome::Other => None,
            },
            Function::ControlRequest => match count_events(self.control.receive(frame.data(), now), counters) {
                Outcome::Refused => Some(Received::Refused(Initiator::Can, Refusal::QueueFull.into())),
                Outcome::Whole => Some(Received::Control),
                Outcome::Other => None,
            },
            Function::CommandA | Function::CommandB if self.config.commands => match self.cyclic.receive(frame, now)? {
                Ok(request) => Some(Received::Command(request)),
                Err(refused) => Some(Received::Refused(Initiator::Command, refused)),
            },
            _ => None,
        }
    }

    /// Returns true if a request that moves this `kind` of arm waits in the connection.
    pub(crate) fn is_motion_waiting(&self, kind: ArmKind) -> bool {
        self.arm.received().is_some_and(|pdu| kind.is_motion(pdu, pdu.len()))
    }

    /// Ends the stream of commands: the next command must start one.
    pub(crate) fn stop_commands(&mut self) {
        self.cyclic.stop_commands();
    }

    /// Handles a frame of the arm, which may be telemetry.
    pub(crate) fn frame(&mut self, kind: ArmKind, bytes: &[u8], at: Instant) {
        self.cyclic.frame(kind, bytes, at);
    }

    /// Queues an answer of the arm. Returns false if it was dropped because the queue is full.
    pub(crate) fn answer(&mut self, frame: &[u8]) -> bool {
        // Usually the connection is free and nothing waits for it.
        let sent = self.answers.is_empty() && self.arm.send(frame).is_ok();
        sent || FrameBytes::from_slice(frame).is_ok_and(|frame| self.answers.push_back(frame).is_ok())
    }

    /// Queues an event in postcard format for the control connection. Returns false if it does not fit.
    pub(crate) fn event(&mut self, message: &[u8]) -> bool {
        let fits = message.len() < self.events.room();
        if fits {
            self.events.push(&[message.len() as u8]);
            self.events.push(message);
        }
        fits
    }

    /// Queues an event as a plain frame, if it has one. Returns false if an older one was dropped for it.
    pub(crate) fn event_frame(&mut self, event: &Event, at: Instant) -> bool {
        event_to_data(event, Stamp(at.as_micros())).is_none_or(|data| self.event_frames.push(data))
    }

    /// Starts pending transfers on free connections.
    fn feed(&mut self) {
        if self.arm_has_next()
            && let Some(frame) = self.answers.pop_front()
        {
            // Its length is within the connection's maximum.
            let _ = self.arm.send(&frame);
        }
        if self.control_has_next() {
            let mut message = [0; EVENTS];
            let len = self.next_event(&mut message);
            let _ = self.control.send(message.get(..len).unwrap_or_default());
        }
    }

    /// Moves the next event to the front of `message` and returns its length, 0 for none.
    // Not inlined: it is larger than the rest of its callers.
    #[inline(never)]
    fn next_event(&mut self, message: &mut [u8; EVENTS]) -> usize {
        let mut len = [0];
        self.events.pop(&mut len);
        let [len] = len.map(usize::from);
        self.events.pop(message.get_mut(..len).unwrap_or_default())
    }

    /// Returns true if an answer waits for a free connection.
    fn arm_has_next(&self) -> bool {
        !self.arm.is_sending() && !self.answers.is_empty()
    }

    /// Returns true if an event waits for a free connection. Replies go before events.
    fn control_has_next(&self) -> bool {
        !self.control.is_sending() && self.control.received().is_none() && !self.events.is_empty()
    }

    /// The time from which [`transmit`](Self::transmit) has a frame. It may lie in the past.
    fn transmit_at(&self) -> Option<Instant> {
        if !self.event_frames.is_empty() || self.arm_has_next() || self.control_has_next() {
            return Some(Instant::ZERO);
        }
        Earliest::of(self.cyclic.transmit_at())
            .or(self.errors_at)
            .or(self.arm.transmit_at())
            .or(self.control.transmit_at())
            .get()
    }

    /// Returns true if [`transmit`](Self::transmit) has a frame.
    pub(crate) fn is_due(&self, now: Instant) -> bool {
        self.transmit_at().is_some_and(|at| at <= now)
    }

    /// The next frame for the bus, the most urgent first. `line_counters` are those of the line to the arm.
    pub(crate) fn transmit(
        &mut self,
        now: Instant,
        counters: &mut Counters,
        line_counters: &Counters,
    ) -> Option<Frame> {
        let frame = self.next_frame(now, counters, line_counters);
        if frame.is_some() {
            count(&mut counters.can_frames_sent, 1);
            self.handed = self.handed.saturating_add(1);
        }
        frame
    }

    /// The controller still holds `waiting` frames. Returns true if there may be a new timeout or frame.
    pub(crate) fn sent(&mut self, waiting: u8, now: Instant) -> bool {
        let gone = self.handed.saturating_sub(waiting);
        if gone == 0 {
            return false;
        }
        self.handed = waiting;
        let arm = leave(&mut self.arm_handed, gone);
        if arm {
            self.arm.transmitted(now);
        }
        let control = leave(&mut self.control_handed, gone);
        if control {
            self.control.transmitted(now);
        }
        arm || control
    }

    fn next_frame(&mut self, now: Instant, counters: &Counters, line_counters: &Counters) -> Option<Frame> {
        if let Some(frame) = self.cyclic.transmit(now) {
            return Some(frame);
        }
        if let Some(at) = self.errors_at.take_if(|at| *at <= now) {
            self.errors_at = Some(grid::next(at, ERRORS_PERIOD, now));
            return Some(Errors::from(&line_counters.plus(counters)).to_frame(self.config.node));
        }
        if let Some(data) = self.event_frames.pop() {
            return Frame::new(Function::Event.id(self.config.node), &data).ok();
        }
        self.feed();
        let handed = self.handed.saturating_add(1);
        if let Some(frame) = self.arm.transmit(now) {
            self.arm_handed = handed;
            return Some(frame);
        }
        let frame = self.control.transmit(now)?;
        self.control_handed = handed;
        Some(frame)
    }

    /// The time at which [`tick`](Self::tick) or [`transmit`](Self::transmit) has work to do.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        // Frames due since the last tick wait for the controller, not for a timeout.
        let transmit_at = self.transmit_at().filter(|at| *at > self.ticked);
        Earliest::of(transmit_at)
            .or(self.arm.timeout())
            .or(self.control.timeout())
            .or(self.cyclic.command_timeout())
            .get()
    }

    /// Advances the time to `now`. A command without its other half is refused.
    pub(crate) fn tick(&mut self, now: Instant, counters: &mut Counters) -> Option<Refusal> {
        self.ticked = now;
        count_events(self.arm.tick(now), counters);
        count_events(self.control.tick(now), counters);
        self.cyclic.tick(now)
    }

    /// The controller went bus-off: ISO-TP transfers in progress are aborted.
    pub(crate) fn on_bus_off(&mut self, counters: &mut Counters) {
        let given_up = self.arm.abort().saturating_add(self.control.abort());
        count(&mut counters.isotp_failures, given_up);
    }

    /// The port is about to be replaced: pending frames and transfers are dropped.
    pub(crate) fn close(&mut self, counters: &mut Counters) {
        self.on_bus_off(counters);
        let untaken = [self.arm.received(), self.control.received()].into_iter().flatten();
        count(&mut counters.isotp_failures, untaken.count());
        count(&mut counters.dropped_can_answers, self.answers.len());
        count(&mut counters.dropped_events, self.event_frames.len());
        let mut message = [0; EVENTS];
        while self.next_event(&mut message) > 0 {
            count(&mut counters.dropped_events, 1);
        }
        self.drop_half_command(counters);
    }

    /// Counts a command that waits for its other half: the wait ends here.
    fn drop_half_command(&self, counters: &mut Counters) {
        let waits = self.cyclic.command_timeout().is_some();
        count(&mut counters.commands_incomplete, waits.into());
    }
}

/// Time of the first error counts.
fn first_errors(config: &config::Can) -> Option<Instant> {
    (config.telemetry_hz > 0).then_some(Instant::ZERO)
}

/// Subtracts the frames that left. Returns true if the last counted one is among them.
fn leave(handed: &mut u8, gone: u8) -> bool {
    let before = core::mem::replace(handed, handed.saturating_sub(gone));
    before > 0 && *handed == 0
}

/// The outcome of a frame for a connection.
enum Outcome {
    /// A PDU is complete.
    Whole,
    /// A PDU was refused.
    Refused,
    Other,
}

/// Counts transfers that failed.
fn count_events(events: isotp::Events, counters: &mut Counters) -> Outcome {
    let mut outcome = Outcome::Other;
    for event in events {
        match event {
            isotp::Event::Failed(_) => count(&mut counters.isotp_failures, 1),
            isotp::Event::Refused(_) => outcome = Outcome::Refused,
            isotp::Event::Received => outcome = Outcome::Whole,
            isotp::Event::Ignored(_) => {}
        }
    }
    outcome
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn event_is_queued_whole_or_not_at_all() {
        let mut port = CanPort::new(config::Can::default());
        assert!(!port.event(&[2; EVENTS]));
        assert!(port.event(&[3; EVENTS - 1]));
        assert!(!port.event(&[4; 1]));
        let mut message = [0; EVENTS];
        assert_eq!(port.next_event(&mut message), EVENTS - 1);
        assert_eq!(message[..EVENTS - 1], [3; EVENTS - 1]);
        assert_eq!(port.next_event(&mut message), 0);
    }
}
