//! Bytes to the arm: the next burst, and the request in it.

use armwire::correlation::{Correlation, Effect};
use armwire::decoder::Kind;
use armwire::exchange::Handover;
use armwire::time::{Duration, Instant};

use crate::arm::{Info, OwnRequest};
use crate::control::{Initiator, MAX_FRAME};
use crate::counters::count;
use crate::line_coding::UartConfig;

use super::Line;
use super::requests::StopRequest;

/// The adapter's own share of an answer's time: two bytes in the transmitter, and the latency of the receiver.
const MARGIN: Duration = Duration::from_millis(1);

/// The UART's next step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transmit {
    /// Send bytes, then report it by [`uart_transmitted`](crate::Bridge::uart_transmitted).
    Burst {
        /// The number of bytes, at least 1.
        len: usize,
        /// Start of the first byte, at most [`POLL_LEAD_TIME`](crate::POLL_LEAD_TIME) ahead: wait for it, and send nothing
        /// in between. `None`: start at once.
        start: Option<Instant>,
    },
    /// Reconfigure the UART after the last bit is out, then report [`Configured`](crate::UartEvent::Configured).
    Configure(UartConfig),
}

/// A burst that was handed to the UART.
#[derive(Clone, Copy)]
pub(super) struct Burst {
    pub(super) initiator: Initiator,
    pub(super) len: usize,
    pub(super) start: Option<Instant>,
    /// The request, if it is tracked. Bytes of the host on USB are decoded after they went out.
    pub(super) info: Option<Info>,
    /// Start of the request's wait.
    pub(super) since: Option<Instant>,
    pub(super) kind: BurstKind,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(super) enum BurstKind {
    Request,
    TorqueOn,
    TorqueOff,
    /// A stop holds the arm.
    Hold,
    /// A stop reads the joints.
    Reading,
    Identification,
    /// Zeros that end a frame that the arm may have received in part.
    Zeros,
}

impl Line {
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
            let one = !self.are_others_idle(now) || self.arbiter.is_shared(now);
            let len = self.rate.before_change(out.len());
            burst.len = self
                .from_host
                .peek(self.kind, one, out.get_mut(..len).unwrap_or_default());
        } else if out.len() < MAX_FRAME {
            return None;
        } else if self.from_host.is_cut() {
            // No frame ends with zeros. Without them, an arm that waits for the rest of a frame would take the next
            // request for it.
            let len = self.from_host.void_due().min(MAX_FRAME);
            out.get_mut(..len)?.fill(0);
            (burst.len, burst.kind) = (len, BurstKind::Zeros);
        } else {
            let (bytes, info) = self.waiting_request(initiator)?;
            out.get_mut(..bytes.len())?.copy_from_slice(bytes);
            (burst.len, burst.info) = (bytes.len(), info);
            if info.is_some_and(|info| info.effect == Effect::Motion) {
                self.stop.on_motion(self.kind, out.get(..burst.len).unwrap_or_default());
            }
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
    pub(super) fn waiting_request(&self, initiator: Initiator) -> Option<(&[u8], Option<Info>)> {
        let own = match initiator {
            Initiator::Can | Initiator::Command => {
                let request = self.requests.of(initiator)?;
                return Some((&request.bytes, request.info));
            }
            Initiator::Poll => OwnRequest::Poll,
            _ if self.requests.torque_off.is_some() => OwnRequest::TorqueOff,
            _ => match &self.requests.stop {
                Some(StopRequest::Hold(hold)) => return Some((&hold.bytes, hold.info)),
                Some(StopRequest::Reading(_)) => OwnRequest::Poll,
                None => OwnRequest::Identify,
            },
        };
        let bytes = self.kind.own(own)?;
        Some((bytes, self.kind.request(bytes)))
    }

    /// Removes the pending request of an initiator. Returns the start of its wait.
    pub(super) fn take_request(&mut self, initiator: Initiator) -> (Option<Instant>, BurstKind) {
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
                None => match requests.stop.take() {
                    Some(StopRequest::Hold(hold)) => (Some(hold.since), BurstKind::Hold),
                    Some(StopRequest::Reading(since)) => (Some(since), BurstKind::Reading),
                    None => (requests.identify.take(), BurstKind::Identification),
                },
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
            self.from_host.voided(burst.len);
            count(&mut self.counters.requests_adapter, 1);
            return self.arbiter.sent_raw(Initiator::Adapter);
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
        match burst.kind {
            BurstKind::Hold => self.held(now),
            BurstKind::Reading => self.stop.has_read = true,
            BurstKind::Identification => self.is_identifying = true,
            BurstKind::Request | BurstKind::TorqueOn | BurstKind::TorqueOff | BurstKind::Zeros => {}
        }
    }

    /// Accounts for bytes of the host on USB.
    pub(super) fn host_transmitted(&mut self, len: usize, now: Instant) {
        if self.is_host_held_back() {
            self.dead_man.keep_alive(Initiator::Usb, now);
        }
        self.from_host.begin(now);
        self.arbiter.taken(Initiator::Usb, false, now);
        self.rate.sent(len);
        // The arm may receive bytes at another rate as the beginning of a frame.
        let is_at_arms_rate = self.rate.is_arms();
        if !is_at_arms_rate {
            self.from_host.set_cut(true);
        }
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
                let is_motion = info.is_some_and(|info| info.effect == Effect::Motion);
                let is_torque_on = self.kind.is_torque_on(item.bytes);
                if is_motion {
                    self.stop.on_motion(self.kind, item.bytes);
                }
                self.from_host.set_cut(!is_at_arms_rate);
                count(&mut self.counters.requests_usb, 1);
                self.latencies.turn.add(self.from_host.waited());
                let behind = on_wire(byte_nanos, rest.saturating_add(behind));
                self.track(Initiator::Usb, info, end - behind);
                // The arm cannot read bytes at another rate, and `hold-line` disables torque-off.
                if is_at_arms_rate && !self.rate.is_on_hold() {
                    if is_motion {
                        self.dead_man.motion(Initiator::Usb, now);
                    } else if is_torque_on {
                        self.dead_man.end(Initiator::Usb);
                    }
                }
            }
            if is_at_arms_rate && self.from_host.end_void() {
                count(&mut self.counters.voids_usb, 1);
            }
        }
    }

    /// Tracks a request whose last byte is out at `end`, if it has an answer.
    pub(super) fn track(&mut self, initiator: Initiator, info: Option<Info>, end: Instant) {
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
}

/// The duration of a frame on a line on which a byte takes this many nanoseconds.
pub(super) fn on_wire(byte_nanos: u32, len: usize) -> Duration {
    Duration::from_micros(u64::from((len as u32).saturating_mul(byte_nanos) / 1_000))
}
