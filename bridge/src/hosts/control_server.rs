//! The control port: requests and replies on USB and on CAN, and events for their subscribers.

use crate::config::{Config, Saved};
use crate::control::{
    ArmIdentity, Event, Failure, FrameBytes, FromAdapter, FromHost, Initiator, MAX_COBS, MAX_EVENT, MAX_MESSAGE,
    Malformed, Reader, Reply, Stamp, Subscription, decode, encode, encode_cobs,
};
use crate::control_codec::{COBS, add_cobs};
use crate::counters::{Counters, count};
use crate::events::{EventQueue, Queued};
use crate::line::{ControlPort, PACKET};
use crate::queue::Queue;
use armwire::time::Instant;

use super::can_port::{CanPort, MAX_REQUEST};
use super::flash::Flash;

/// Capacity for bytes to the host on USB.
const OUT: usize = 448;

/// A request with a delayed reply, and its outcome once known.
pub(super) struct Pending<T> {
    /// The port that waits for the reply. `None` if its host has disconnected.
    port: Option<ControlPort>,
    sequence: u8,
    outcome: Option<T>,
}

impl<T> Pending<T> {
    pub(super) const fn new(port: ControlPort, sequence: u8) -> Option<Self> {
        Some(Self {
            port: Some(port),
            sequence,
            outcome: None,
        })
    }

    /// Sets the outcome. Without a waiting host the request ends here.
    fn end(pending: &mut Option<Self>, outcome: T) {
        if let Some(pending) = pending {
            pending.outcome = Some(outcome);
        }
        let _ = pending.take_if(|pending| pending.port.is_none());
    }

    /// The port's host has disconnected. Its request still completes, and no other of its kind is accepted until then.
    fn forget(pending: &mut Option<Self>, port: ControlPort) {
        if let Some(pending) = pending.as_mut().filter(|pending| pending.port == Some(port)) {
            pending.port = None;
        }
        let _ = pending.take_if(|pending| pending.port.is_none() && pending.outcome.is_some());
    }

    /// Takes the outcome for this port's host, if it is known.
    fn take(pending: &mut Option<Self>, port: ControlPort) -> Option<(u8, T)> {
        let is_known = |pending: &mut Self| pending.port == Some(port) && pending.outcome.is_some();
        let pending = pending.take_if(is_known)?;
        Some((pending.sequence, pending.outcome?))
    }
}

/// The control interface on USB.
struct UsbPort {
    reader: Reader<MAX_REQUEST>,
    /// The last packet, and the number of its bytes that have been read.
    packet: [u8; PACKET],
    len: usize,
    read: usize,
    out: Queue<OUT>,
    /// The last packet to the host was full: the transfer is still open.
    is_open: bool,
}

impl UsbPort {
    const fn new() -> Self {
        Self {
            reader: Reader::new(),
            packet: [0; PACKET],
            len: 0,
            read: 0,
            out: Queue::new(),
            is_open: false,
        }
    }

    /// The next message. `None` if none is complete.
    fn next(&mut self) -> Option<Result<FromHost, Malformed>> {
        let unread = self.packet.get(self.read..self.len).unwrap_or_default();
        let rest = self.reader.push(unread).len();
        self.read = self.len.saturating_sub(rest);
        self.reader.next()
    }

    /// The host has disconnected.
    fn clear(&mut self) {
        self.reader.clear();
        (self.len, self.read, self.is_open) = (0, 0, false);
        self.out.clear();
    }

    /// Queues a message if at least `spare` bytes remain free afterwards. Returns true if it was queued.
    fn queue(&mut self, message: &[u8], spare: usize) -> bool {
        let fits = message.len().saturating_add(spare) <= self.out.room();
        if fits {
            self.out.push(message);
        }
        fits
    }
}

/// The control port on USB and on CAN.
pub(super) struct ControlServer {
    usb: UsbPort,
    usb_subscription: Subscription,
    can_subscription: Subscription,
    /// Frames for subscribers, encoded when nothing more urgent is due.
    frames: EventQueue,
    /// A request to identify the arm, and its answer, `None` for none.
    pub(super) arm: Option<Pending<Result<Option<FrameBytes>, Failure>>>,
    pub(super) flash: Flash,
    /// Requests to stop the arm, one of each port.
    stops: [Option<Pending<Result<(), Failure>>>; 2],
}

impl ControlServer {
    pub(super) const fn new() -> Self {
        const NOTHING: Subscription = Subscription {
            frames: false,
            events: false,
        };
        Self {
            usb: UsbPort::new(),
            usb_subscription: NOTHING,
            can_subscription: NOTHING,
            frames: EventQueue::new(),
            arm: None,
            flash: Flash::new(),
            stops: [None, None],
        }
    }

    // ---- Disconnection ----

    /// The host on a port has disconnected.
    pub(super) fn forget(&mut self, port: ControlPort) {
        *self.subscription(port) = Subscription::default();
        Pending::forget(&mut self.arm, port);
        self.flash.forget(port);
        for stop in &mut self.stops {
            Pending::forget(stop, port);
        }
        if port == ControlPort::Usb {
            self.usb.clear();
        }
    }

    /// Returns true if a host on CAN waits for a delayed reply.
    pub(super) fn is_can_reply_pending(&self) -> bool {
        let arm = self.arm.as_ref().and_then(|pending| pending.port);
        let port = ControlPort::Can;
        arm == Some(port) || self.flash.is_awaited(port) || self.stop_pending(port)
    }

    // ---- Requests and replies ----

    pub(super) const fn has_packet_room(&self) -> bool {
        self.usb.read == self.usb.len
    }

    /// The host on USB sent a packet.
    pub(super) fn packet_received(&mut self, packet: &[u8]) {
        self.usb.len = packet.len().min(PACKET);
        self.usb.read = 0;
        for (to, from) in self.usb.packet.iter_mut().zip(packet) {
            *to = *from;
        }
    }

    /// The next request on this port, if its reply fits.
    pub(super) fn next_request(&mut self, port: ControlPort, can: &mut CanPort) -> Option<Result<FromHost, Malformed>> {
        match port {
            ControlPort::Usb => self.usb.next(),
            ControlPort::Can => {
                let request = decode(can.control.received()?);
                can.control.release();
                Some(request)
            }
        }
    }

    /// Returns true if a reply fits on this port.
    pub(super) fn has_reply_room(&self, port: ControlPort, can: &CanPort) -> bool {
        match port {
            ControlPort::Usb => self.usb.out.room() >= MAX_COBS,
            ControlPort::Can => !can.control.is_sending(),
        }
    }

    pub(super) fn reply(&mut self, port: ControlPort, sequence: u8, reply: Reply, can: &mut CanPort) {
        let message = FromAdapter::Reply { sequence, reply };
        match port {
            ControlPort::Usb => {
                let mut bytes = [0; MAX_COBS];
                let len = encode_cobs(&message, &mut bytes).unwrap_or(0);
                self.usb.queue(bytes.get(..len).unwrap_or_default(), 0);
            }
            ControlPort::Can => {
                let mut bytes = [0; MAX_MESSAGE];
                let len = encode(&message, &mut bytes).unwrap_or(0);
                // The caller checked for room.
                let _ = can.control.send(bytes.get(..len).unwrap_or_default());
            }
        }
    }

    /// The identification has ended: with an answer, without one, or with a failure.
    pub(super) fn arm_identified(&mut self, answer: Result<Option<FrameBytes>, Failure>) {
        Pending::end(&mut self.arm, answer);
    }

    /// Returns true if a host on this port waits for the reply to its stop.
    fn stop_pending(&self, port: ControlPort) -> bool {
        self.stops.iter().flatten().any(|pending| pending.port == Some(port))
    }

    /// A host on this port waits for a stop of the arm. Returns false if another does already.
    pub(super) fn add_stop(&mut self, port: ControlPort, sequence: u8) -> bool {
        if self.stop_pending(port) {
            return false;
        }
        let free = self.stops.iter_mut().find(|stop| stop.is_none());
        free.map(|stop| *stop = Pending::new(port, sequence)).is_some()
    }

    /// The arm was stopped, or could not be.
    pub(super) fn stopped(&mut self, result: Result<(), Failure>) {
        for stop in &mut self.stops {
            Pending::end(stop, result);
        }
    }

    /// The delayed reply for this port's host, if it is known.
    pub(super) fn finished(&mut self, port: ControlPort, config: &Config) -> Option<(u8, Reply)> {
        if let Some((sequence, answer)) = Pending::take(&mut self.arm, port) {
            let identity = |answer| {
                Reply::Arm(ArmIdentity {
                    kind: config.arm,
                    answer,
                })
            };
            return Some((sequence, answer.map_or_else(Reply::Failed, identity)));
        }
        if let Some((sequence, result)) = self.stops.iter_mut().find_map(|stop| Pending::take(stop, port)) {
            return Some((sequence, result.map_or_else(Reply::Failed, |()| Reply::Done)));
        }
        let (sequence, result) = self.flash.take_outcome(port)?;
        let done = |saved: Option<Saved>| saved.map_or(Reply::Done, Reply::Saved);
        Some((sequence, result.map_or_else(Reply::Failed, done)))
    }

    // ---- Subscribers ----

    const fn subscription(&mut self, port: ControlPort) -> &mut Subscription {
        match port {
            ControlPort::Usb => &mut self.usb_subscription,
            ControlPort::Can => &mut self.can_subscription,
        }
    }

    pub(super) const fn subscribe(&mut self, port: ControlPort, subscription: Subscription) {
        *self.subscription(port) = subscription;
    }

    /// Returns true if a port subscribes to frames.
    pub(super) const fn wants_frames(&self) -> bool {
        self.usb_subscription.frames || self.can_subscription.frames
    }

    /// Publishes an event other than a frame, if it fits. Queued frames are published first.
    pub(super) fn publish_event(&mut self, at: Instant, event: &Event, can: &mut CanPort, counters: &mut Counters) {
        if self.usb_subscription.events || self.can_subscription.events {
            self.publish_all(can, counters);
            self.queue_event(at, event.clone(), |subscription| subscription.events, can, counters);
        }
    }

    /// Queues a frame for publication, if it fits.
    pub(super) fn queue_frame(
        &mut self,
        at: Instant,
        initiator: Option<Initiator>,
        bytes: &[u8],
        can: &mut CanPort,
        counters: &mut Counters,
    ) {
        let subscriptions = [&self.usb_subscription, &self.can_subscription];
        let subscribers = subscriptions.iter().filter(|subscription| subscription.frames).count();
        if subscribers == 0 {
            return;
        }
        // The oldest ones make room.
        while !self.frames.push_frame(at, initiator, bytes) {
            if !self.publish(can, counters) {
                count(&mut counters.dropped_events, subscribers);
                return;
            }
        }
    }

    /// Publishes all queued frames.
    pub(super) fn publish_all(&mut self, can: &mut CanPort, counters: &mut Counters) {
        while self.publish(can, counters) {}
    }

    /// Publishes the next queued frame. Returns false if there was none.
    pub(super) fn publish(&mut self, can: &mut CanPort, counters: &mut Counters) -> bool {
        let mut bytes = FrameBytes::new();
        let Some((at, Queued::Frame(initiator))) = self.frames.pop(&mut bytes) else {
            return false;
        };
        let event = Event::Frame { initiator, bytes };
        self.queue_event(at, event, |subscription| subscription.frames, can, counters);
        true
    }

    /// Encodes an event and queues it for the ports that subscribe to it, if it fits.
    #[inline(never)]
    fn queue_event(
        &mut self,
        at: Instant,
        event: Event,
        wants: fn(&Subscription) -> bool,
        can: &mut CanPort,
        counters: &mut Counters,
    ) {
        let at = Stamp(at.as_micros());
        let mut bytes = [0; MAX_EVENT];
        let len = encode(&FromAdapter::Event { at, event }, &mut bytes).unwrap_or(0);
        let bytes = bytes.get(..len).unwrap_or_default();
        if wants(&self.usb_subscription) {
            let mut message = [0; MAX_EVENT + COBS];
            let len = add_cobs(bytes, &mut message).unwrap_or(0);
            // Replies go before events.
            let is_queued = self.usb.queue(message.get(..len).unwrap_or_default(), MAX_COBS);
            count(&mut counters.dropped_events, usize::from(!is_queued));
        }
        if wants(&self.can_subscription) {
            let is_queued = can.event(bytes);
            count(&mut counters.dropped_events, usize::from(!is_queued));
        }
    }

    /// Returns true if [`packet`](Self::packet) has work to do.
    pub(super) fn is_packet_due(&self) -> bool {
        !self.usb.out.is_empty() || self.usb.is_open || !self.frames.is_empty() && self.usb_subscription.frames
    }

    /// Returns true if a frame waits for publication on the bus.
    pub(super) fn is_can_due(&self) -> bool {
        !self.frames.is_empty() && self.can_subscription.frames
    }

    /// Moves the next packet for the host on USB into `packet` and returns its length, 0 for a zero-length packet.
    /// `None` if none is due, or after one step towards it.
    pub(super) fn packet(
        &mut self,
        packet: &mut [u8; PACKET],
        can: &mut CanPort,
        counters: &mut Counters,
    ) -> Option<usize> {
        // The publication of a frame takes as long as the rest of its processing.
        if self.usb.out.len() < PACKET && self.publish(can, counters) {
            return None;
        }
        if self.usb.out.is_empty() && !self.usb.is_open {
            return None;
        }
        let len = self.usb.out.pop(packet);
        self.usb.is_open = len == PACKET;
        Some(len)
    }
}
