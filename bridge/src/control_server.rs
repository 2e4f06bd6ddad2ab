//! The control port: hears requests on USB and on CAN, does what they ask, and tells subscribers what happens.

use crate::Instant;

use crate::bridge::{Action, Bridge};
use crate::can_port::{CanPort, MAX_REQUEST};
use crate::config::{Config, ConfigError};
use crate::control::{
    ArmIdentity, COBS, Event, Failure, FrameBytes, FromAdapter, FromHost, Identity, Initiator, MAX_COBS, MAX_EVENT,
    MAX_MESSAGE, Malformed, Reader, Reply, Request, Stamp, Subscription, VERSION, decode, encode, encode_cobs,
};
use crate::control_codec::add_cobs;
use crate::counters::count;
use crate::frame_queue::FrameQueue;
use crate::queue::Queue;
use crate::{Counters, PACKET};

/// Bytes that wait for the host on USB.
const OUT: usize = 448;

/// Where a host is connected.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Port {
    Usb,
    Can,
}

/// What the control port knows and owes.
pub(crate) struct ControlServer {
    pub(crate) identity: Identity,
    usb: UsbPort,
    usb_subscription: Subscription,
    can_subscription: Subscription,
    /// Of which subscribers are told when there is time: until then, others have something to send.
    untold: FrameQueue,
    /// A request to identify the arm, and the arm's answer, `None` for none.
    arm: Option<Pending<Result<Option<FrameBytes>, Failure>>>,
    /// A request to write or forget what is in flash, and what became of it.
    flash: Option<Pending<Result<(), Failure>>>,
    save: Option<Action>,
    restart: Option<Action>,
}

/// A request that is not answered at once.
struct Pending<T> {
    /// Who waits for the answer. `None` when whoever asked has gone.
    port: Option<Port>,
    sequence: u8,
    /// What to answer, once it is known.
    outcome: Option<T>,
}

impl<T> Pending<T> {
    const fn new(port: Port, sequence: u8) -> Option<Self> {
        Some(Self {
            port: Some(port),
            sequence,
            outcome: None,
        })
    }

    /// The outcome is known. If nobody waits for it, that is the end of it.
    fn end(pending: &mut Option<Self>, outcome: T) {
        if let Some(pending) = pending {
            pending.outcome = Some(outcome);
        }
        let _ = pending.take_if(|pending| pending.port.is_none());
    }

    /// Whoever waits on this port has gone. What was asked is not undone: nobody else may ask until it has ended.
    fn forget(pending: &mut Option<Self>, port: Port) {
        if let Some(pending) = pending.as_mut().filter(|pending| pending.port == Some(port)) {
            pending.port = None;
        }
        let _ = pending.take_if(|pending| pending.port.is_none() && pending.outcome.is_some());
    }
}

/// The control interface on USB.
struct UsbPort {
    reader: Reader<MAX_REQUEST>,
    /// The last packet, of which the first `read` bytes have been read.
    packet: [u8; PACKET],
    len: usize,
    read: usize,
    out: Queue<OUT>,
    /// The last packet to the host was full, so that the host waits for more.
    open: bool,
}

impl UsbPort {
    /// The next message. `None` when none is whole.
    fn next(&mut self) -> Option<Result<FromHost, Malformed>> {
        let unread = self.packet.get(self.read..self.len).unwrap_or_default();
        let rest = self.reader.push(unread).len();
        self.read = self.len.saturating_sub(rest);
        self.reader.next()
    }
}

impl ControlServer {
    pub(crate) const fn new(identity: Identity) -> Self {
        Self {
            identity,
            usb: UsbPort {
                reader: Reader::new(),
                packet: [0; PACKET],
                len: 0,
                read: 0,
                out: Queue::new(),
                open: false,
            },
            usb_subscription: Subscription {
                frames: false,
                events: false,
            },
            can_subscription: Subscription {
                frames: false,
                events: false,
            },
            untold: FrameQueue::new(),
            arm: None,
            flash: None,
            save: None,
            restart: None,
        }
    }

    /// Whether this adapter can be like that.
    pub(crate) fn check(&self, config: &Config) -> Result<(), ConfigError> {
        config.check()?;
        match config.can.data_bit_rate {
            Some(_) if !self.identity.can_fd => Err(ConfigError::NoCanFd),
            _ => Ok(()),
        }
    }

    /// The host on USB has gone.
    pub(crate) fn forget_usb(&mut self) {
        self.usb.reader.clear();
        (self.usb.len, self.usb.read, self.usb.open) = (0, 0, false);
        self.usb.out.clear();
        self.usb_subscription = Subscription::default();
        Pending::forget(&mut self.arm, Port::Usb);
        Pending::forget(&mut self.flash, Port::Usb);
    }

    /// The bus is another one, or the adapter is another node on it: whoever subscribed or asked is not there.
    pub(crate) fn forget_can(&mut self) {
        self.can_subscription = Subscription::default();
        Pending::forget(&mut self.arm, Port::Can);
        Pending::forget(&mut self.flash, Port::Can);
    }

    /// Whether a host on CAN waits for a reply that comes later.
    pub(crate) fn owes_can(&self) -> bool {
        let arm = self.arm.as_ref().and_then(|pending| pending.port);
        let flash = self.flash.as_ref().and_then(|pending| pending.port);
        [arm, flash].contains(&Some(Port::Can))
    }

    pub(crate) fn usb_room(&self) -> bool {
        self.usb.read == self.usb.len
    }

    pub(crate) fn usb_received(&mut self, packet: &[u8]) {
        self.usb.len = packet.len().min(PACKET);
        self.usb.read = 0;
        for (to, from) in self.usb.packet.iter_mut().zip(packet) {
            *to = *from;
        }
    }

    pub(crate) fn usb_due(&self) -> bool {
        let untold = self.usb_subscription.frames && !self.untold.is_empty();
        !self.usb.out.is_empty() || self.usb.open || untold
    }

    /// Whether the host on USB is told of frames.
    pub(crate) const fn tells_usb(&self) -> bool {
        self.usb_subscription.frames
    }

    /// Whether there is something to tell on the bus.
    pub(crate) const fn can_due(&self) -> bool {
        self.can_subscription.frames && !self.untold.is_empty()
    }

    /// Tells subscribers of one frame if the host on USB has less than a packet to fetch, and returns whether it did.
    pub(crate) fn prepare(&mut self, can: &mut CanPort, counters: &mut Counters) -> bool {
        self.usb.out.len() < PACKET && self.tell_frame(can, counters)
    }

    pub(crate) fn usb_transmit(
        &mut self,
        packet: &mut [u8; PACKET],
        can: &mut CanPort,
        counters: &mut Counters,
    ) -> Option<usize> {
        while self.prepare(can, counters) {}
        if self.usb.out.is_empty() && !self.usb.open {
            return None;
        }
        let len = self.usb.out.pop(packet);
        self.usb.open = len == PACKET;
        Some(len)
    }

    /// Subscribers, if there are any, are to be told of this frame, as far as there is room: with what waits already, if
    /// there is none behind it.
    pub(crate) fn frame(
        &mut self,
        at: Instant,
        initiator: Option<Initiator>,
        bytes: &[u8],
        can: &mut CanPort,
        counters: &mut Counters,
    ) {
        let subscribers = [self.usb_subscription, self.can_subscription];
        let subscribers = subscribers.iter().filter(|subscription| subscription.frames).count();
        if subscribers == 0 || self.untold.push(at, initiator, bytes) {
            return;
        }
        self.tell_frames(can, counters);
        let kept = self.untold.push(at, initiator, bytes);
        count(&mut counters.dropped_events, if kept { 0 } else { subscribers });
    }

    /// Tells subscribers of the frames that they were not told of yet.
    // One piece of code, not one for each call.
    #[inline(never)]
    pub(crate) fn tell_frames(&mut self, can: &mut CanPort, counters: &mut Counters) {
        while self.tell_frame(can, counters) {}
    }

    /// Tells subscribers of one of them, and returns whether there was one.
    fn tell_frame(&mut self, can: &mut CanPort, counters: &mut Counters) -> bool {
        // Whatever it is, it is overwritten.
        let mut event = FromAdapter::Event {
            at: Stamp(0),
            event: Event::BusOff { off: false },
        };
        let any = self.untold.pop(&mut event);
        if any {
            self.publish(&event, |subscription| subscription.frames, can, counters);
        }
        any
    }

    /// Whether anybody wants to be told of what is no frame.
    pub(crate) const fn is_heard(&self) -> bool {
        self.usb_subscription.events || self.can_subscription.events
    }

    /// Tells subscribers of what is no frame.
    pub(crate) fn tell(&mut self, event: Event, now: Instant, can: &mut CanPort, counters: &mut Counters) {
        let at = Stamp(now.as_micros());
        let event = FromAdapter::Event { at, event };
        self.publish(&event, |subscription| subscription.events, can, counters);
    }

    /// Tells those who want it of an event, as far as there is room.
    // One piece of code, not one for each call.
    #[inline(never)]
    fn publish(
        &mut self,
        event: &FromAdapter,
        wants: fn(Subscription) -> bool,
        can: &mut CanPort,
        counters: &mut Counters,
    ) {
        let mut bytes = [0; MAX_EVENT];
        let len = encode(event, &mut bytes).unwrap_or(0);
        let bytes = bytes.get(..len).unwrap_or_default();
        if wants(self.usb_subscription) {
            let mut message = [0; MAX_EVENT + COBS];
            let len = add_cobs(bytes, &mut message).unwrap_or(0);
            // Replies go before events.
            let told = self.queue_usb(message.get(..len).unwrap_or_default(), MAX_COBS);
            count(&mut counters.dropped_events, usize::from(!told));
        }
        if wants(self.can_subscription) {
            let told = can.event(bytes);
            count(&mut counters.dropped_events, usize::from(!told));
        }
    }

    /// The arm has said what it is, or has not; or it could not be asked.
    pub(crate) fn arm_identified(&mut self, answer: Result<Option<FrameBytes>, Failure>) {
        Pending::end(&mut self.arm, answer);
    }

    /// The next thing for firmware to do.
    pub(crate) fn action(&mut self, may_restart: bool) -> Option<Action> {
        self.save.take().or_else(|| self.restart.take_if(|_| may_restart))
    }

    /// What became of [`Action::Save`] or [`Action::Reset`].
    pub(crate) fn saved(&mut self, result: Result<(), Failure>) {
        Pending::end(&mut self.flash, result);
    }

    /// Queues a message for the host on USB if at least `spare` bytes of room are left then, and returns whether it did.
    fn queue_usb(&mut self, message: &[u8], spare: usize) -> bool {
        let fits = message.len().saturating_add(spare) <= self.usb.out.room();
        if fits {
            self.usb.out.push(message);
        }
        fits
    }

    /// Whether a reply finds room on this port.
    fn has_room(&self, port: Port, can: &CanPort) -> bool {
        match port {
            Port::Usb => self.usb.out.room() >= MAX_COBS,
            Port::Can => !can.control.is_sending(),
        }
    }

    fn reply(&mut self, port: Port, sequence: u8, reply: Reply, can: &mut CanPort) {
        let message = FromAdapter::Reply { sequence, reply };
        match port {
            Port::Usb => {
                let mut bytes = [0; MAX_COBS];
                let len = encode_cobs(&message, &mut bytes).unwrap_or(0);
                self.queue_usb(bytes.get(..len).unwrap_or_default(), 0);
            }
            Port::Can => {
                let mut bytes = [0; MAX_MESSAGE];
                let len = encode(&message, &mut bytes).unwrap_or(0);
                // There was room.
                let _ = can.control.send(bytes.get(..len).unwrap_or_default());
            }
        }
    }

    /// What a host on this port waits for and can now be told.
    fn finished(&mut self, port: Port, config: &Config) -> Option<(u8, Reply)> {
        let mine = |pending: &mut Pending<_>| pending.port == Some(port) && pending.outcome.is_some();
        if let Some(pending) = self.arm.take_if(mine) {
            let reply = match pending.outcome {
                Some(Err(failure)) => Reply::Failed(failure),
                outcome => Reply::Arm(ArmIdentity {
                    kind: config.arm,
                    answer: outcome.and_then(Result::ok).flatten(),
                }),
            };
            return Some((pending.sequence, reply));
        }
        let mine = |pending: &mut Pending<_>| pending.port == Some(port) && pending.outcome.is_some();
        let pending = self.flash.take_if(mine)?;
        let reply = match pending.outcome {
            Some(Err(failure)) => Reply::Failed(failure),
            Some(Ok(())) | None => Reply::Done,
        };
        Some((pending.sequence, reply))
    }
}

impl Bridge {
    /// Answers what hosts have asked on the control port, as far as there is room for the answers.
    pub(crate) fn serve(&mut self, now: Instant) {
        self.share();
        self.tell_frames();
        // What one asks may end what another waits for.
        while self.serve_port(Port::Usb, now) | self.serve_port(Port::Can, now) {}
    }

    /// Makes what [`control_transmit`](Self::control_transmit) would have to make first, a message each time, and returns
    /// whether it did. Where others wait for the processor, call it before, until it returns that there is no more.
    ///
    /// ```
    /// let mut bridge = armwire_bridge::Bridge::default();
    /// assert!(!bridge.control_prepare()); // nobody has subscribed
    /// ```
    pub fn control_prepare(&mut self) -> bool {
        self.share();
        self.control.prepare(&mut self.can, &mut self.counters)
    }

    /// Tells subscribers of the frames that they were not told of yet.
    pub(crate) fn tell_frames(&mut self) {
        self.control.tell_frames(&mut self.can, &mut self.counters);
    }

    /// Serves one port, and returns whether there was anything to do.
    fn serve_port(&mut self, port: Port, now: Instant) -> bool {
        let mut any = false;
        while self.control.has_room(port, &self.can) {
            let reply = match self.control.finished(port, &self.config) {
                Some(reply) => Some(reply),
                None => match self.next_request(port) {
                    Some(request) => self.handle_request(port, request, now),
                    None => break,
                },
            };
            any = true;
            if let Some((sequence, reply)) = reply {
                self.control.reply(port, sequence, reply, &mut self.can);
            }
        }
        any
    }

    fn next_request(&mut self, port: Port) -> Option<Result<FromHost, Malformed>> {
        let request = match port {
            Port::Usb => self.control.usb.next()?,
            Port::Can => {
                let request = decode(self.can.control.received()?);
                self.can.control.release();
                request
            }
        };
        count(&mut self.counters.control_requests, 1);
        Some(request)
    }

    /// Does what a host asks. `None` when the reply comes later.
    fn handle_request(
        &mut self,
        port: Port,
        request: Result<FromHost, Malformed>,
        now: Instant,
    ) -> Option<(u8, Reply)> {
        let FromHost { sequence, request } = match request {
            Ok(request) => request,
            Err(malformed) => {
                count(&mut self.counters.control_unsupported, 1);
                let reply = Reply::Unsupported { version: VERSION };
                return Some((malformed.sequence.unwrap_or(0), reply));
            }
        };
        let reply = match request {
            Request::Identify => Reply::Identity(self.control.identity.clone()),
            Request::IdentifyArm if self.control.arm.is_some() => Reply::Failed(Failure::Busy),
            Request::IdentifyArm => {
                self.control.arm = Pending::new(port, sequence);
                self.identify_arm(now);
                return None;
            }
            Request::GetConfig => Reply::Config(self.config),
            Request::SetConfig(config) => match self.configure(config, port, now) {
                Ok(()) => Reply::Done,
                Err(error) => Reply::BadConfig(error),
            },
            Request::SaveConfig | Request::ResetConfig
                if self.control.flash.is_some() || self.control.save.is_some() =>
            {
                Reply::Failed(Failure::Busy)
            }
            Request::SaveConfig | Request::ResetConfig if self.is_armed() => Reply::Failed(Failure::StreamArmed),
            Request::SaveConfig => {
                self.control.flash = Pending::new(port, sequence);
                self.control.save = Some(Action::Save(self.config));
                return None;
            }
            Request::ResetConfig => {
                self.control.flash = Pending::new(port, sequence);
                self.control.save = Some(Action::Reset);
                self.adopt(Config::default(), port, now);
                return None;
            }
            Request::GetCounters => Reply::Counters(self.counters),
            Request::GetLatencies => Reply::Latencies(self.latencies),
            Request::Subscribe(subscription) => {
                match port {
                    Port::Usb => self.control.usb_subscription = subscription,
                    Port::Can => self.control.can_subscription = subscription,
                }
                Reply::Done
            }
            Request::Restart => {
                self.disarm(now);
                self.control.restart = Some(Action::Restart);
                Reply::Done
            }
            Request::RestartIntoBootLoader => {
                self.disarm(now);
                self.control.restart = Some(Action::RestartIntoBootLoader);
                Reply::Done
            }
            Request::EndStream => {
                match port {
                    Port::Usb => self.streams.usb.end(),
                    Port::Can => self.streams.can.end() | self.streams.command.end(),
                };
                Reply::Done
            }
            Request::GetLine => Reply::Line(self.rate.state(self.down.len())),
            Request::HoldLine => match self.hold_line(port, now) {
                Ok(()) => Reply::Done,
                Err(failure) => Reply::Failed(failure),
            },
            Request::ReleaseLine => {
                self.release_line(port, now);
                Reply::Done
            }
        };
        Some((sequence, reply))
    }

    /// Becomes what a host wants it to be, if it can.
    fn configure(&mut self, config: Config, by: Port, now: Instant) -> Result<(), ConfigError> {
        self.control.check(&config)?;
        self.adopt(config, by, now);
        Ok(())
    }
}
