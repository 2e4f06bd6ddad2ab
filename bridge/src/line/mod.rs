//! The arm's side of the adapter: the UART, the arbitration, the serial port on USB, the dead-man timer and the poll
//! clock.
//!
//! One initiator at a time has the line: the host on USB in the middle of a sequence, or the initiator whose request is
//! in flight. A frame that answers a request goes to its initiator. All other bytes of the arm go to the host on USB,
//! byte by byte unless another initiator waits for an answer.

mod arbiter;
mod dead_man;
mod from_host;
mod poll;
mod rate;
mod requests;
mod to_host;

use armwire::decoder::{Decoder, Kind};
use armwire::dialect::{Dialect, Effect};
use armwire::exchange::{Exchange, FirstByte, Handover, Match};
use armwire::framing::Framing;

use crate::arm::{Info, OwnRequest};
use crate::config::{ArmKind, Config};
use crate::control::{Event, Failure, FrameBytes, Initiator, Latencies, LineState, MAX_FRAME, Refusal};
use crate::counters::{Counters, UartErrors, count};
use crate::earliest::Earliest;
use crate::events::{EventQueue, Queued};
use crate::line_coding::{LineCoding, Refused, UartConfig};
use armwire::time::{Duration, Instant};

use arbiter::{Arbiter, Contender};
use dead_man::{DeadMan, STREAMERS};
use from_host::FromHost;
use poll::Poll;
use rate::LineRate;
use requests::{Request, Requests};
use to_host::ToHost;

pub use from_host::TO_ARM_BUFFER;
pub use poll::POLL_LEAD_TIME;
pub(crate) use rate::ControlPort;
pub use to_host::{PACKET, TO_HOST_BUFFER};

/// Maximum number of requests in flight that are tracked one by one.
const MAX_PENDING: usize = 8;

/// Time after its timeout during which an answer may still arrive.
pub(crate) const STALE_WINDOW: Duration = Duration::from_millis(50);

/// The adapter's own share of an answer's time: two bytes in the transmitter, and the latency of the receiver.
const MARGIN: Duration = Duration::from_millis(1);

/// Maximum age of the known state of the line while bytes arrive, in nanoseconds.
const MAX_AGE_NANOS: u32 = 1_000_000;

/// Time that bytes for the arm may wait, or the UART go unread, before the adapter counts as stuck.
const STUCK_TIME: Duration = Duration::from_millis(1_000);

/// The number of bytes that the UART must receive before any work can be due, apart from an idle line and errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxThreshold {
    /// This many bytes of any value, at least 1.
    pub max: usize,
    /// At least this many if the last of them is the terminator.
    pub min: usize,
    /// The last byte of the next frame. `None` if it is unknown, or if the number of missing bytes is known.
    pub terminator: Option<u8>,
}

impl RxThreshold {
    /// Returns true if these `bytes`, the last of which is `last`, reach the threshold.
    pub fn is_met(&self, bytes: usize, last: u8) -> bool {
        bytes >= self.max || bytes >= self.min && self.terminator == Some(last)
    }
}

/// The UART's next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transmit {
    /// Send bytes, then report it by [`uart_transmitted`](crate::Bridge::uart_transmitted).
    Burst {
        /// The number of bytes, at least 1.
        len: usize,
        /// Start of the first byte, at most [`POLL_LEAD_TIME`] ahead: wait for it, and send nothing in between. `None`:
        /// start at once.
        start: Option<Instant>,
    },
    /// Reconfigure the UART after the last bit is out, then report [`Configured`](crate::UartEvent::Configured).
    Configure(UartConfig),
}

/// A burst that was handed to the UART.
#[derive(Clone, Copy)]
struct Burst {
    initiator: Initiator,
    len: usize,
    start: Option<Instant>,
    /// The request, if it is tracked. Bytes of the host on USB are decoded after they went out.
    info: Option<Info>,
    /// Start of the request's wait.
    since: Option<Instant>,
    kind: BurstKind,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum BurstKind {
    Request,
    TorqueOn,
    TorqueOff,
    /// Zeros that end a frame that the arm may have received in part.
    Zeros,
}

/// Hosts on CAN that have gone silent.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Silenced {
    /// The hosts that send requests.
    pub(crate) can: bool,
    /// The host that sends commands.
    pub(crate) command: bool,
}

impl Silenced {
    const fn add(&mut self, initiator: Initiator) {
        self.can |= matches!(initiator, Initiator::Can);
        self.command |= matches!(initiator, Initiator::Command);
    }
}

/// The reason for a request that was not accepted.
pub(crate) enum NotTaken {
    /// The queue is full now.
    Full,
    Refused(Refusal),
}

/// The line to the arm, and the serial port on USB.
pub(crate) struct Line {
    kind: ArmKind,
    /// Decodes the bytes of the arm.
    decoder: Decoder<MAX_FRAME>,
    exchange: Exchange<ArmKind, Initiator, MAX_PENDING>,
    to_host: ToHost,
    from_host: FromHost,
    requests: Requests,
    arbiter: Arbiter,
    poll: Poll,
    rate: LineRate,
    dead_man: DeadMan,
    /// The last burst handed to the UART, until it is accounted for.
    burst: Option<Burst>,
    /// The result of the last identification.
    identified: Option<Result<Option<FrameBytes>, Failure>>,
    command_timeout: Duration,
    /// Polls and CAN are being refused because the host on USB holds the line.
    is_held: bool,
    /// Listeners other than the host on USB receive all frames.
    is_watched: bool,
    deliveries: EventQueue,
    /// Time of the last read of the UART, of the last byte of the arm, and of the last byte sent.
    last_rx_poll: Instant,
    last_rx: Instant,
    last_tx: Instant,
    counters: Counters,
    latencies: Latencies,
}

impl Line {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            kind: config.arm,
            decoder: Decoder::new(),
            exchange: Exchange::new(STALE_WINDOW),
            to_host: ToHost::new(),
            from_host: FromHost::new(),
            requests: Requests::default(),
            arbiter: Arbiter::new(),
            poll: Poll::new(config.poll),
            rate: LineRate::new(config.arm),
            dead_man: DeadMan::new(config.host_timeout, config.arm.own(OwnRequest::TorqueOff).is_some()),
            burst: None,
            identified: None,
            command_timeout: Duration::from_millis(config.can.command_timeout_ms.into()),
            is_held: false,
            is_watched: false,
            deliveries: EventQueue::new(),
            last_rx_poll: Instant::ZERO,
            last_rx: Instant::ZERO,
            last_tx: Instant::ZERO,
            counters: Counters::default(),
            latencies: Latencies::default(),
        }
    }

    pub(crate) const fn counters(&self) -> &Counters {
        &self.counters
    }

    /// Bytes that passed in both directions.
    pub(crate) const fn passed_bytes(&self) -> u32 {
        let c = &self.counters;
        c.arm_to_host_bytes.wrapping_add(c.host_to_arm_bytes)
    }

    pub(crate) const fn latencies(&self) -> &Latencies {
        &self.latencies
    }

    pub(crate) const fn to_host(&self) -> &ToHost {
        &self.to_host
    }

    // ---- From the arm ----

    /// Handles bytes from the UART, the last of which arrived at `at`. Returns the number of frames that ended.
    pub(crate) fn received(&mut self, bytes: &[u8], at: Instant) -> usize {
        self.last_rx_poll = at;
        if bytes.is_empty() {
            return 0;
        }
        self.last_rx = at;
        count(&mut self.counters.arm_to_host_bytes, bytes.len());
        let mut frames: usize = 0;
        let mut rest = bytes;
        while !rest.is_empty() {
            rest = self.decoder.push(rest);
            self.pass();
            frames = frames.saturating_add(self.take_items(at));
        }
        if frames > 0 {
            self.to_host.release(self.decoder.offset());
        }
        frames
    }

    /// The line was idle for one byte time: received bytes become due. Returns the number of frames that this ended.
    pub(crate) fn idle(&mut self, now: Instant) -> usize {
        self.decoder.idle();
        let frames = self.take_items(now);
        self.to_host.release(self.decoder.offset());
        frames
    }

    /// The UART reported errors. The bytes received with them are passed on unchanged.
    pub(crate) fn errors(&mut self, errors: &UartErrors) {
        let c = &mut self.counters;
        for (counter, errors) in [
            (&mut c.framing_errors, errors.framing),
            (&mut c.parity_errors, errors.parity),
            (&mut c.noise_errors, errors.noise),
            (&mut c.overrun_errors, errors.overrun),
            (&mut c.ring_overruns, errors.ring_overrun),
            (&mut c.late_stamps, errors.late_stamps),
        ] {
            *counter = counter.wrapping_add(errors);
        }
    }

    pub(crate) fn rx_threshold(&self) -> RxThreshold {
        let expect = self.exchange.expect(&self.kind);
        let heard = MAX_AGE_NANOS.checked_div(self.rate.byte_nanos()).unwrap_or(0) as usize;
        let room = self.to_host.to_full_packet();
        let need = self.decoder.need(&self.kind, expect).max(1);
        // The terminator may also occur inside a frame: it marks the end only where the length is unknown.
        match self.kind.terminator(expect).filter(|_| self.decoder.pending() == 0) {
            Some(terminator) => RxThreshold {
                max: heard.max(need).min(room),
                min: need,
                terminator: Some(terminator),
            },
            None => {
                let max = need.min(heard.max(1)).min(room);
                RxThreshold {
                    max,
                    min: max,
                    terminator: None,
                }
            }
        }
    }

    /// Passes undecided bytes to the host on USB, unless they may belong to another initiator.
    fn pass(&mut self) {
        if self.decoder.pending() > 0 && !self.is_anothers() {
            let (offset, window) = (self.decoder.offset(), self.decoder.window());
            self.to_host.pass(offset, window, &mut self.counters);
        }
    }

    /// Takes the decoder's items, and returns the number of frames.
    fn take_items(&mut self, at: Instant) -> usize {
        let mut frames: usize = 0;
        while let Some(span) = self.decoder.advance(&self.kind, self.exchange.expect(&self.kind)) {
            let item = self.decoder.item(span);
            if item.kind != Kind::Frame {
                if let Kind::Noise(_) = item.kind {
                    count(&mut self.counters.noise_bytes, item.bytes.len());
                }
                self.to_host.pass(item.offset, item.bytes, &mut self.counters);
                continue;
            }
            frames = frames.saturating_add(1);
            count(&mut self.counters.frames, 1);
            let before = on_wire(self.rate.byte_nanos(), item.bytes.len().saturating_sub(1));
            let first = FirstByte {
                offset: item.offset,
                at: Some(at - before),
            };
            self.exchange.expire(at - before);
            let initiator = match self.exchange.on_frame(&self.kind, item.bytes, first, at) {
                Match::Answer { who, sent } => {
                    self.latencies.answer.add(at.since(sent));
                    Some(who)
                }
                Match::Late(_) => {
                    count(&mut self.counters.late_answers, 1);
                    None
                }
                Match::Unsolicited => {
                    count(&mut self.counters.unasked_frames, 1);
                    None
                }
            };
            match initiator {
                None | Some(Initiator::Usb) => self.to_host.pass(item.offset, item.bytes, &mut self.counters),
                Some(_) => self.to_host.skip(item.offset, item.bytes.len()),
            }
            let is_wanted = self.is_watched || matches!(initiator, Some(Initiator::Can));
            if is_wanted && !self.deliveries.push_frame(at, initiator, item.bytes) {
                let dropped = match initiator {
                    Some(Initiator::Can) => &mut self.counters.dropped_can_answers,
                    _ => &mut self.counters.dropped_events,
                };
                count(dropped, 1);
            }
            if initiator == Some(Initiator::Adapter) {
                self.identified = Some(Ok(FrameBytes::from_slice(item.bytes).ok()));
            }
            if let Some(initiator) = initiator.filter(|_| self.holder().is_none()) {
                self.exchange_ended(initiator, at);
            }
        }
        frames
    }

    /// The next frame, with its bytes in `bytes`, or event for the hosts' side.
    pub(crate) fn delivery(&mut self, bytes: &mut FrameBytes) -> Option<(Instant, Queued)> {
        self.deliveries.pop(bytes)
    }

    /// Returns true if the frames of any packet fit.
    pub(crate) const fn has_delivery_room(&self) -> bool {
        self.deliveries.has_room()
    }

    pub(crate) const fn has_delivery(&self) -> bool {
        !self.deliveries.is_empty()
    }

    /// Enables the delivery of all frames to listeners other than the host on USB.
    pub(crate) const fn watch(&mut self, is_watched: bool) {
        self.is_watched = is_watched;
    }

    /// The result of an [identification](Self::identify), returned once: `None` in it if the arm did not answer.
    pub(crate) const fn identified(&mut self) -> Option<Result<Option<FrameBytes>, Failure>> {
        self.identified.take()
    }

    /// The initiator whose request is in flight.
    pub(crate) fn holder(&self) -> Option<Initiator> {
        self.exchange.holder()
    }

    /// Returns true if the next answer is for an initiator other than the host on USB: the arm's bytes are held back
    /// until their frame is known.
    fn is_anothers(&self) -> bool {
        self.holder().is_some_and(|holder| holder != Initiator::Usb)
    }

    /// The last request of an initiator is answered, or its answer is missing.
    fn exchange_ended(&mut self, initiator: Initiator, now: Instant) {
        self.last_tx = now;
        match initiator {
            Initiator::Poll => {
                let missed = self.poll.ended(now);
                count(&mut self.counters.missed_polls, missed);
            }
            Initiator::Adapter => {
                self.identified.get_or_insert(Ok(None));
            }
            Initiator::Usb | Initiator::Can | Initiator::Command => {}
        }
        self.pass();
    }

    // ---- To the arm ----

    /// Returns true if [`transmit`](Self::transmit) has work.
    pub(crate) fn is_transmit_due(&self, now: Instant) -> bool {
        self.uart_change().is_some() || self.next(now).is_some()
    }

    /// Copies the next bytes for the arm to the front of `out`, [`MAX_FRAME`] bytes at least, or returns the
    /// configuration that the UART must change to first. `None` if nothing is due now.
    pub(crate) fn transmit(&mut self, out: &mut [u8], now: Instant) -> Option<Transmit> {
        self.tick_requests(now);
        self.tick_turn(now);
        if let Some(uart) = self.uart_change() {
            return Some(Transmit::Configure(uart));
        }
        let initiator = self.next(now)?;
        let mut burst = Burst {
            initiator,
            len: 0,
            start: None,
            info: None,
            since: None,
            kind: BurstKind::Request,
        };
        if initiator == Initiator::Usb {
            // One request at a time while others use the line.
            let one = !self.are_others_silent(now) || self.arbiter.is_shared(now);
            let len = self.rate.before_change(out.len());
            burst.len = self
                .from_host
                .peek(self.kind, one, out.get_mut(..len).unwrap_or_default());
        } else if out.len() < MAX_FRAME {
            return None;
        } else if self.from_host.is_cut {
            // No frame ends with zeros. Without them, an arm that waits for the rest of a frame would read another's
            // request as that rest.
            out.get_mut(..MAX_FRAME)?.fill(0);
            (burst.len, burst.kind) = (MAX_FRAME, BurstKind::Zeros);
        } else {
            let (bytes, info) = self.waiting_request(initiator)?;
            out.get_mut(..bytes.len())?.copy_from_slice(bytes);
            (burst.len, burst.info) = (bytes.len(), info);
            (burst.since, burst.kind) = self.take_request(initiator);
            if initiator == Initiator::Poll {
                burst.start = self.poll.slot().filter(|slot| *slot > now);
            }
        }
        self.burst = Some(burst).filter(|burst| burst.len > 0);
        self.burst.map(|burst| Transmit::Burst {
            len: burst.len,
            start: burst.start,
        })
    }

    /// The pending request of an initiator other than the host on USB.
    fn waiting_request(&self, initiator: Initiator) -> Option<(&[u8], Option<Info>)> {
        let own = match initiator {
            Initiator::Can | Initiator::Command => {
                let request = self.requests.of(initiator)?;
                return Some((&request.bytes, request.info));
            }
            Initiator::Poll => OwnRequest::Poll,
            _ if self.requests.torque_off.is_some() => OwnRequest::TorqueOff,
            _ => OwnRequest::Identify,
        };
        let bytes = self.kind.own(own)?;
        Some((bytes, self.kind.request(bytes)))
    }

    /// Removes the pending request of an initiator. Returns the start of its wait.
    fn take_request(&mut self, initiator: Initiator) -> (Option<Instant>, BurstKind) {
        let requests = &mut self.requests;
        match initiator {
            Initiator::Usb | Initiator::Poll => (None, BurstKind::Request),
            Initiator::Can => match requests.can.pop_front() {
                Some(request) if self.kind.is_torque_on(&request.bytes) => (Some(request.since), BurstKind::TorqueOn),
                request => (request.map(|request| request.since), BurstKind::Request),
            },
            Initiator::Command => {
                let since = requests.command.take().map(|request| request.since);
                (since, BurstKind::Request)
            }
            Initiator::Adapter => match requests.torque_off.take() {
                Some(since) => (Some(since), BurstKind::TorqueOff),
                None => (requests.identify.take(), BurstKind::Request),
            },
        }
    }

    /// The UART has been sending the bytes of the last [`transmit`](Self::transmit) since `now`: accounts for them.
    pub(crate) fn transmitted(&mut self, now: Instant) {
        let Some(burst) = self.burst.take() else {
            return;
        };
        count(&mut self.counters.host_to_arm_bytes, burst.len);
        let start = burst.start.unwrap_or(now);
        self.last_tx = start;
        if burst.kind == BurstKind::Zeros {
            count(&mut self.counters.requests_adapter, 1);
            self.from_host.is_cut = false;
            return self.arbiter.spoke(Initiator::Adapter);
        }
        let c = &mut self.counters;
        let counter = match burst.initiator {
            Initiator::Usb => return self.host_transmitted(burst.len, now),
            Initiator::Can => &mut c.requests_can,
            Initiator::Poll => &mut c.requests_poll,
            Initiator::Command => &mut c.requests_command,
            Initiator::Adapter => &mut c.requests_adapter,
        };
        count(counter, 1);
        if burst.initiator == Initiator::Poll {
            if let Some(slot) = self.poll.slot() {
                self.latencies.poll.add(now.since(slot));
                count(&mut self.counters.late_polls, usize::from(now > slot));
            }
            self.poll.began();
        }
        if burst.kind == BurstKind::TorqueOn {
            self.dead_man.end(burst.initiator);
        }
        if let Some(since) = burst.since {
            self.latencies.turn.add(now.since(since));
        }
        let is_urgent = burst.initiator == Initiator::Poll && self.poll.is_urgent();
        self.arbiter.taken(burst.initiator, is_urgent, start);
        let end = start + on_wire(self.rate.byte_nanos(), burst.len);
        self.track(burst.initiator, burst.info, end);
    }

    /// Accounts for bytes of the host on USB.
    fn host_transmitted(&mut self, len: usize, now: Instant) {
        if self.is_host_held_back() {
            self.dead_man.heard(Initiator::Usb, now);
        }
        self.from_host.begin(now);
        self.arbiter.taken(Initiator::Usb, false, now);
        self.rate.sent(len);
        // An arm may read bytes at another rate as the beginning of any frame.
        let is_heard = self.rate.is_arms();
        self.from_host.is_cut |= !is_heard;
        let byte_nanos = self.rate.byte_nanos();
        let end = now + on_wire(byte_nanos, len);
        let mut rest = len;
        while rest > 0 {
            let taken = self.from_host.sent(rest, now);
            if taken == 0 {
                break;
            }
            rest = rest.saturating_sub(taken);
            while let Some((item, behind)) = self.from_host.next_item(self.kind) {
                if item.kind != Kind::Frame {
                    continue;
                }
                let info = self.kind.request(item.bytes);
                let is_torque_on = self.kind.is_torque_on(item.bytes);
                self.from_host.is_cut = !is_heard;
                count(&mut self.counters.requests_usb, 1);
                self.latencies.turn.add(self.from_host.waited());
                let behind = on_wire(byte_nanos, rest.saturating_add(behind));
                self.track(Initiator::Usb, info, end - behind);
                // No arm reads bytes at another rate, and `hold-line` disables torque-off.
                if is_heard && !self.rate.is_on_hold() {
                    if info.is_some_and(|info| info.effect == Effect::Motion) {
                        self.dead_man.motion(Initiator::Usb, now);
                    } else if is_torque_on {
                        self.dead_man.end(Initiator::Usb);
                    }
                }
            }
        }
    }

    /// Tracks a request whose last byte is out at `end`, if it has an answer.
    fn track(&mut self, initiator: Initiator, info: Option<Info>, end: Instant) {
        let Some((info, response)) = info.and_then(|info| Some((info, info.response?))) else {
            return;
        };
        let longest = usize::from(response.longest).min(MAX_FRAME);
        let handover = Handover {
            offset: self.decoder.received(),
            at: end,
            due: end + response.turnaround + on_wire(self.rate.byte_nanos(), longest) + MARGIN,
        };
        self.exchange.begin(info, initiator, handover);
        count(
            &mut self.counters.untracked_requests,
            self.exchange.is_saturated().into(),
        );
    }

    /// The initiator that may send now, if there is one.
    fn next(&self, now: Instant) -> Option<Initiator> {
        if self.requests.torque_off.is_some() && !self.from_host.is_speaking() {
            // Torque-off waits for no answer.
            return Some(Initiator::Adapter);
        }
        if self.is_anothers() {
            return None;
        }
        // The host continues its sequence, or sends more requests while no other initiator has one.
        if self.from_host.is_speaking() || self.are_others_silent(now) {
            return self.contender(Initiator::Usb, now).map(|_| Initiator::Usb);
        }
        if self.holder().is_some() {
            return None;
        }
        self.arbiter
            .next(&Initiator::ALL.map(|initiator| self.contender(initiator, now)))
    }

    /// Returns true if no initiator but the host on USB is ready, which is the usual case.
    fn are_others_silent(&self, now: Instant) -> bool {
        self.requests.is_empty() && self.poll.due_since(now).is_none()
    }

    /// The initiator, if it is ready for a turn.
    fn contender(&self, initiator: Initiator, now: Instant) -> Option<Contender> {
        let since = self.since(initiator, now)?;
        let may_go = match initiator {
            Initiator::Usb => self.rate.change(self.from_host.len()).is_none() && self.may_host_go(now),
            Initiator::Command => true,
            Initiator::Adapter if self.requests.torque_off.is_some() => true,
            Initiator::Can | Initiator::Poll | Initiator::Adapter => self.may_go(initiator),
        };
        may_go.then_some(Contender {
            since,
            is_urgent: initiator == Initiator::Poll && self.poll.is_urgent(),
        })
    }

    /// The start of an initiator's wait.
    fn since(&self, initiator: Initiator, now: Instant) -> Option<Instant> {
        match initiator {
            Initiator::Usb => (self.from_host.len() > 0).then(|| self.from_host.moved()),
            Initiator::Can => self.requests.can.front().map(|request| request.since),
            Initiator::Command => self.requests.command.as_ref().map(|request| request.since),
            Initiator::Poll => self.poll.due_since(now),
            Initiator::Adapter => self.requests.torque_off.or(self.requests.identify),
        }
    }

    /// Returns true if the answer to an initiator's request could be distinguished from all answers that may still
    /// arrive.
    fn may_go(&self, initiator: Initiator) -> bool {
        // Usually no answer is missing, and the request does not matter.
        if self.exchange.is_idle() {
            return true;
        }
        self.waiting_request(initiator)
            .is_some_and(|(_, info)| info.is_none_or(|info| self.exchange.can_send(&info, initiator)))
    }

    /// Returns true if the host on USB may send. Alone on the line it always may, as it receives every answer. On a
    /// shared line it is limited to the number of tracked requests, and to requests whose answer cannot be another's.
    fn may_host_go(&self, now: Instant) -> bool {
        // A sequence in progress is not held back, and no arm answers at another rate.
        if self.exchange.is_idle() || self.from_host.is_speaking() || !self.rate.is_arms() {
            return true;
        }
        let is_alone = !self.arbiter.is_shared(now) && self.are_others_silent(now);
        is_alone
            || self
                .from_host
                .peek_request(self.kind)
                .is_none_or(|info| self.exchange.can_send(&info, Initiator::Usb))
    }

    // ---- Requests of initiators other than the host on USB ----

    /// Queues a request of a host on CAN that was complete at `came`.
    pub(crate) fn request(&mut self, bytes: &[u8], came: Instant) -> Result<(), NotTaken> {
        if self.requests.can.is_full() {
            return Err(NotTaken::Full);
        }
        let request = Some(bytes).filter(|bytes| self.kind.is_request(bytes));
        let Some(request) = request.and_then(|bytes| Request::new(self.kind, bytes, came)) else {
            return Err(NotTaken::Refused(Refusal::NotAFrame));
        };
        if self.is_held {
            return Err(NotTaken::Refused(Refusal::LineHeld));
        }
        if request.is_motion() {
            self.dead_man.motion(Initiator::Can, came);
        }
        // The queue is not full.
        let _ = self.requests.can.push_back(request);
        Ok(())
    }

    /// Queues a motion request of cyclic commands. It replaces the one that waits.
    pub(crate) fn command(&mut self, bytes: &[u8], now: Instant) {
        if self.is_held {
            return self.refuse(Initiator::Command, Refusal::LineHeld, now);
        }
        let waiting = self.requests.command.take();
        self.requests.command = Request::new(self.kind, bytes, now);
        self.dead_man.motion(Initiator::Command, now);
        if waiting.is_some() {
            self.refuse(Initiator::Command, Refusal::QueueFull, now);
        }
    }

    /// Queues an identification request. Its result is [`identified`](Self::identified).
    pub(crate) fn identify(&mut self, now: Instant) {
        if self.kind.own(OwnRequest::Identify).is_none() {
            self.identified = Some(Ok(None));
        } else if self.is_held {
            self.refuse(Initiator::Adapter, Refusal::LineHeld, now);
            self.identified = Some(Err(Failure::LineHeld));
        } else {
            self.requests.identify = Some(now);
        }
    }

    /// Drops the requests of hosts on CAN, because the bus is reconfigured.
    pub(crate) fn drop_can_requests(&mut self) {
        count(&mut self.counters.refused_can_requests, self.requests.can.len());
        self.requests.can.clear();
    }

    fn refuse_can_requests(&mut self, reason: Refusal, now: Instant) {
        while self.requests.can.pop_front().is_some() {
            self.refuse(Initiator::Can, reason, now);
        }
    }

    fn refuse_command(&mut self, reason: Refusal, now: Instant) {
        if self.requests.command.take().is_some() {
            self.refuse(Initiator::Command, reason, now);
        }
    }

    #[cold]
    fn refuse(&mut self, initiator: Initiator, reason: Refusal, now: Instant) {
        self.count_refusal(reason);
        self.deliver(&Event::Refused { initiator, reason }, now);
    }

    /// Counts a refusal, on behalf of the hosts' side too.
    pub(crate) const fn count_refusal(&mut self, reason: Refusal) {
        let c = &mut self.counters;
        let counter = match reason {
            Refusal::QueueFull => &mut c.refused_can_requests,
            Refusal::NotAFrame => &mut c.refused_can_frames,
            Refusal::Incomplete => &mut c.commands_incomplete,
            Refusal::Stale => &mut c.commands_stale,
            Refusal::OutOfRange => &mut c.commands_out_of_range,
            Refusal::LineHeld => &mut c.refused_line_held,
            Refusal::OtherRate => &mut c.refused_other_rate,
        };
        *counter = counter.wrapping_add(1);
    }

    fn deliver(&mut self, event: &Event, at: Instant) {
        if !self.deliveries.push(at, event) {
            count(&mut self.counters.dropped_events, 1);
        }
    }

    // ---- The configuration ----

    /// Applies a new configuration.
    pub(crate) fn configure(&mut self, was: &Config, config: &Config, now: Instant) {
        self.command_timeout = Duration::from_millis(config.can.command_timeout_ms.into());
        self.dead_man
            .configure(config.host_timeout, config.arm.own(OwnRequest::TorqueOff).is_some());
        if config.arm != was.arm {
            self.change_arm(config.arm, now);
        } else if !config.can.commands || config.can.bus() != was.can.bus() {
            self.refuse_command(Refusal::Stale, now);
            self.end_stream(Initiator::Command, 0, false, now);
        }
        if config.poll != was.poll || config.arm != was.arm {
            self.poll = Poll::new(config.poll);
            self.poll.pause(self.is_held, now);
            self.poll.tick(now);
        }
    }

    /// Changes the kind of arm: exchanges with the previous one end.
    #[cold]
    fn change_arm(&mut self, kind: ArmKind, now: Instant) {
        let holder = self.holder();
        let missing = self.exchange.clear();
        count(&mut self.counters.unanswered_requests, missing);
        if let Some(initiator) = holder {
            self.exchange_ended(initiator, now);
        }
        self.kind = kind;
        self.decoder.clear();
        self.from_host.forget_turn();
        self.requests.torque_off = None;
        self.refuse_command(Refusal::NotAFrame, now);
        for initiator in STREAMERS {
            self.end_stream(initiator, 0, false, now);
        }
        if self.requests.identify.take().is_some() {
            self.identify(now);
        }
        self.refuse_can_requests(Refusal::NotAFrame, now);
        self.from_host.touch(now);
        self.rate.set_arm(kind, self.from_host.len());
        self.follow_holder(now);
    }

    // ---- The serial port on USB ----

    /// The host enabled or disabled the adapter's configuration.
    pub(crate) fn usb_configured(&mut self, configured: bool, now: Instant) {
        self.to_host.configured(configured, &mut self.counters);
        self.rate.reset(self.from_host.len());
        self.release_line(ControlPort::Usb, now);
    }

    pub(crate) fn usb_reset(&mut self, now: Instant) {
        count(&mut self.counters.usb_resets, 1);
        self.usb_configured(false, now);
    }

    pub(crate) fn usb_suspended(&mut self, now: Instant) {
        count(&mut self.counters.usb_suspends, 1);
        self.rate.release(self.from_host.len());
        self.follow_holder(now);
    }

    /// Returns true if the port was opened or closed.
    pub(crate) fn dtr(&mut self, high: bool, now: Instant) -> bool {
        if self.to_host.is_attached() {
            self.rate.dtr(high, self.from_host.len(), now);
            self.follow_holder(now);
        }
        self.to_host.dtr(high, &mut self.counters)
    }

    /// A packet of this length that was handed over could not be sent.
    pub(crate) fn packet_lost(&mut self, len: usize) {
        count(&mut self.counters.unheard_bytes, len);
    }

    /// Returns true if the next packet of the host may be accepted. While a line coding waits to take effect it may
    /// not: its bytes are for the new one.
    pub(crate) fn has_packet_room(&self) -> bool {
        !self.rate.changes() && self.from_host.room() >= PACKET
    }

    /// Handles a packet of the host. Returns true if the next one fits.
    pub(crate) fn packet_received(&mut self, packet: &[u8], now: Instant) -> bool {
        count(&mut self.counters.packets_from_host, 1);
        if self.rate.is_unmet() && !packet.is_empty() && !self.take_rate(now) {
            self.refuse_packet(packet.len(), now);
        } else {
            if !self.is_held {
                self.dead_man.heard(Initiator::Usb, now);
            }
            let refused = self.from_host.push(packet, now);
            count(&mut self.counters.refused_bytes, refused);
        }
        self.has_packet_room()
    }

    /// The next packet for the host.
    pub(crate) fn packet(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        self.to_host.transmit(packet, &mut self.counters)
    }

    // ---- The line's rate, and who holds the line ----

    /// The host on USB set a line coding.
    pub(crate) fn set_line_coding(&mut self, bytes: [u8; 7], now: Instant) -> Result<(), Refused> {
        let coding = LineCoding::from_cdc(bytes).inspect_err(|_| count(&mut self.counters.refused_line_codings, 1))?;
        self.from_host.touch(now);
        self.rate.request(coding, self.from_host.len(), now);
        self.follow_holder(now);
        Ok(())
    }

    pub(crate) const fn line_coding(&self) -> LineCoding {
        self.rate.requested()
    }

    /// The state of the line for [`Reply::Line`](crate::control::Reply::Line).
    pub(crate) fn state(&self) -> LineState {
        self.rate.state(self.from_host.len())
    }

    /// The configuration that the UART must change to before anything else goes out. The change waits for the answer to
    /// another initiator's request; for torque-off it waits for none.
    pub(crate) fn uart_change(&self) -> Option<UartConfig> {
        let uart = self.rate.change(self.from_host.len())?;
        (self.requests.torque_off.is_some() || !self.is_anothers()).then_some(uart)
    }

    /// The UART was reconfigured. An unfinished frame will not end. Returns the number of frames that this ended.
    pub(crate) fn uart_configured(&mut self, uart: UartConfig, now: Instant) -> usize {
        let frames = self.idle(now);
        self.from_host.cut();
        self.rate.changed(uart);
        self.follow_holder(now);
        count(&mut self.counters.line_codings, 1);
        frames
    }

    /// Returns true if the UART must stop transmitting: torque-off waits, and the arm cannot read bytes at this rate.
    pub(crate) fn is_cut_due(&self) -> bool {
        self.requests.torque_off.is_some() && !self.rate.is_arms()
    }

    /// Returns true if the host on USB may have a rate other than the arm's.
    fn may_change_rate(&self) -> bool {
        !self.dead_man.is_can_streaming() && self.requests.torque_off.is_none()
    }

    /// Puts the rate of the host on USB into effect with its next byte. Returns true if it did.
    #[cold]
    fn take_rate(&mut self, now: Instant) -> bool {
        let takes = self.may_change_rate() && !self.rate.is_revoked();
        if takes {
            self.rate.take(self.from_host.len(), now);
            self.follow_holder(now);
        }
        takes
    }

    /// Drops bytes of the host on USB whose rate is not in effect.
    #[cold]
    fn refuse_packet(&mut self, bytes: usize, now: Instant) {
        count(&mut self.counters.refused_rate_bytes, bytes);
        if self.rate.refuse() {
            self.refuse(Initiator::Usb, Refusal::OtherRate, now);
        }
    }

    /// Torque-off goes out at the arm's rate: bytes of the host on USB at another rate are cut off.
    fn take_line_back(&mut self, now: Instant) {
        if self.rate.revoke() {
            let dropped = self.drop_host_bytes();
            count(&mut self.counters.refused_rate_bytes, dropped);
            self.from_host.forget_turn();
            self.from_host.is_cut = true;
            self.follow_holder(now);
        }
    }

    /// A host on the control port requests exclusive use of the line for USB.
    pub(crate) fn hold_line(&mut self, port: ControlPort, now: Instant) -> Result<(), Failure> {
        if self.requests.torque_off.is_some() || self.dead_man.is_any_streaming() {
            return Err(Failure::StreamArmed);
        }
        if !self.rate.hold(port, now) {
            return Err(Failure::Busy);
        }
        self.follow_holder(now);
        Ok(())
    }

    /// A host on the control port releases the line.
    pub(crate) fn release_line(&mut self, port: ControlPort, now: Instant) {
        self.rate.unhold(port);
        self.follow_holder(now);
    }

    /// Refuses the requests of polls and CAN when a hold begins, and resumes polls when it ends.
    #[inline(never)]
    fn follow_holder(&mut self, now: Instant) {
        let held = self.rate.is_held(self.from_host.len());
        if core::mem::replace(&mut self.is_held, held) == held {
            return;
        }
        let missed = self.poll.pause(held, now);
        count(&mut self.counters.missed_polls, missed);
        if !held {
            return;
        }
        if !self.poll.is_off() {
            self.refuse(Initiator::Poll, Refusal::LineHeld, now);
        }
        self.refuse_command(Refusal::LineHeld, now);
        self.refuse_can_requests(Refusal::LineHeld, now);
        if self.requests.identify.take().is_some() {
            self.identify(now);
        }
    }

    // ---- The dead-man timer ----

    /// Returns true if the torque must go off in case the adapter restarts now.
    pub(crate) fn is_armed(&self) -> bool {
        self.is_torque_off_waiting() || self.dead_man.switches_off() && self.dead_man.is_any_streaming()
    }

    /// Returns true if torque-off waits to go out.
    pub(crate) fn is_torque_off_waiting(&self) -> bool {
        let is_handed_over = self.burst.is_some_and(|burst| burst.kind == BurstKind::TorqueOff);
        self.requests.torque_off.is_some() || is_handed_over
    }

    /// The adapter's previous run stopped while it was armed: torque-off goes out first.
    pub(crate) fn restarted_while_armed(&mut self) {
        if self.kind.own(OwnRequest::TorqueOff).is_some() {
            self.requests.torque_off = Some(Instant::ZERO);
            self.from_host.is_cut = true;
        }
    }

    /// Prepares a restart: switches the torque off if a stream is armed. `last_request` is the length of the last
    /// request on CAN, for which the line had no room.
    pub(crate) fn disarm(&mut self, last_request: usize, now: Instant) -> Silenced {
        let mut silenced = Silenced::default();
        for initiator in STREAMERS {
            if self.dead_man.switches_off() && self.dead_man.is_streaming(initiator) {
                self.host_silent(initiator, last_request, now);
                silenced.add(initiator);
            }
        }
        silenced
    }

    /// A host ends its stream of motion without torque-off.
    pub(crate) fn release_stream(&mut self, initiator: Initiator) {
        self.dead_man.end(initiator);
    }

    /// No host had a chance to be active until now.
    pub(crate) fn hosts_heard(&mut self, now: Instant) {
        self.dead_man.all_heard(now);
    }

    /// Returns true if the host on USB cannot send because the buffer to the arm is full.
    fn is_host_held_back(&self) -> bool {
        !self.has_packet_room() && !self.is_held
    }

    fn silence_timeout(&self, initiator: Initiator) -> Option<Instant> {
        let waits_since = match initiator {
            Initiator::Can => self.requests.can_motion_since(),
            _ => None,
        };
        self.dead_man.timeout(initiator, waits_since)
    }

    /// A host that streamed motion went silent: its unsent bytes are outdated.
    fn host_silent(&mut self, initiator: Initiator, last_request: usize, now: Instant) {
        let dropped = match initiator {
            Initiator::Usb => {
                self.from_host.cut();
                self.rate.dropped();
                self.drop_host_bytes()
            }
            Initiator::Can => {
                let dropped = self.requests.can_bytes().saturating_add(last_request);
                self.requests.can.clear();
                dropped
            }
            _ => self.requests.command.take().map_or(0, |request| request.bytes.len()),
        };
        let torque_off = self.dead_man.switches_off();
        if torque_off {
            self.requests.torque_off.get_or_insert(now);
            self.take_line_back(now);
        }
        // A pending change of rate was dropped with the bytes.
        self.follow_holder(now);
        self.end_stream(initiator, dropped, torque_off, now);
    }

    /// Drops the bytes of the host on USB that were not handed to the UART, and returns their number.
    fn drop_host_bytes(&mut self) -> usize {
        let handed_over = self.burst.filter(|burst| burst.initiator == Initiator::Usb);
        self.from_host.truncate(handed_over.map_or(0, |burst| burst.len))
    }

    /// Ends a host's stream and reports it, if there was one.
    fn end_stream(&mut self, initiator: Initiator, dropped: usize, torque_off: bool, now: Instant) {
        if !self.dead_man.end(initiator) {
            return;
        }
        count(&mut self.counters.host_silences, 1);
        count(&mut self.counters.silenced_bytes, dropped);
        let event = Event::HostSilent {
            initiator,
            dropped: dropped as u16,
            torque_off,
        };
        self.deliver(&event, now);
    }

    // ---- Time ----

    /// The time of the next [`tick`](Self::tick) unless another event comes first. It may lie in the past.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        Earliest::of(self.poll.timeout())
            .or(self.exchange.timeout())
            .or(self.turn_timeout())
            .or(self.command_timeout())
            .or(self.rate.timeout(self.may_change_rate()))
            .or(self.silence_timeout(Initiator::Usb))
            .or(self.silence_timeout(Initiator::Can))
            .or(self.silence_timeout(Initiator::Command))
            .get()
    }

    /// Advances the time to `now`: late answers expire, polls become due, old commands are dropped, silent hosts lose
    /// their streams. `last_request` is the length of the last request on CAN, for which the line had no room.
    pub(crate) fn tick(&mut self, last_request: usize, now: Instant) -> Silenced {
        let mut silenced = Silenced::default();
        self.tick_requests(now);
        if self.rate.timeout(self.may_change_rate()).is_some_and(|at| at <= now) {
            self.tick_rate(now);
        }
        for initiator in STREAMERS {
            if self.silence_timeout(initiator).is_none_or(|at| at > now) {
                continue;
            }
            match initiator {
                // USB does not report that the host wants to send.
                Initiator::Usb if self.is_host_held_back() => self.dead_man.heard(initiator, now),
                _ => {
                    self.host_silent(initiator, last_request, now);
                    silenced.add(initiator);
                }
            }
        }
        // Torque-off may have begun to wait for the line.
        self.tick_turn(now);
        silenced
    }

    /// Expires late answers, makes polls due, and drops old commands.
    fn tick_requests(&mut self, now: Instant) {
        while let Some(initiator) = self.exchange.on_timeout(now) {
            count(&mut self.counters.unanswered_requests, 1);
            if self.holder().is_none() {
                self.exchange_ended(initiator, now);
            }
        }
        let missed = self.poll.tick(now);
        count(&mut self.counters.missed_polls, missed);
        if self.command_timeout().is_some_and(|at| at <= now) {
            self.refuse_command(Refusal::Stale, now);
        }
    }

    /// Ends the turn of a host on USB that has paused, if others wait.
    fn tick_turn(&mut self, now: Instant) {
        if self.turn_timeout().is_some_and(|at| at <= now) {
            self.from_host.end_turn();
        }
    }

    /// Changes the line's rate, or ends a hold.
    #[cold]
    fn tick_rate(&mut self, now: Instant) {
        let moved = self.from_host.moved().max(self.last_rx);
        self.rate.tick(self.may_change_rate(), moved, self.from_host.len(), now);
        self.follow_holder(now);
    }

    /// The time at which the pending command becomes too old to move the arm.
    fn command_timeout(&self) -> Option<Instant> {
        let command = self.requests.command.as_ref()?;
        Some(command.since + self.command_timeout)
    }

    /// The time at which the host on USB, which has paused, loses its turn to others that wait.
    fn turn_timeout(&self) -> Option<Instant> {
        if !self.from_host.is_speaking() || self.holder().is_some() && self.requests.torque_off.is_none() {
            return None;
        }
        let [_, others @ ..] = Initiator::ALL;
        let ready = others.map(|initiator| self.contender(initiator, Instant::ZERO));
        let since = ready.iter().flatten().map(|contender| contender.since).min()?;
        Some(self.from_host.turn_timeout(since, self.last_rx))
    }

    /// Returns true if bytes for the arm have not moved, or the UART has not been read, for a second.
    pub(crate) fn is_stuck(&self, now: Instant) -> bool {
        let unsent = self.from_host.len() > 0 || self.rate.changes();
        // While an answer is outstanding, bytes may wait for it. That wait has a timeout.
        let stands = self.holder().is_none();
        let moved = self.from_host.moved().max(self.last_tx);
        now.since(self.last_rx_poll) > STUCK_TIME || unsent && stands && now.since(moved) > STUCK_TIME
    }
}

/// The duration of a frame on a line on which a byte takes this many nanoseconds.
fn on_wire(byte_nanos: u32, len: usize) -> Duration {
    Duration::from_micros(u64::from((len as u32).saturating_mul(byte_nanos) / 1_000))
}

#[cfg(test)]
impl Line {
    /// Number of pending requests of hosts on CAN, and of pending bytes of the host on USB.
    pub(crate) fn waiting(&self) -> (usize, usize) {
        (self.requests.can.len(), self.from_host.len())
    }
}
