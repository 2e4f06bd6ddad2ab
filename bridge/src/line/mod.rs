//! The arm's side of the adapter: the UART, the arbitration, the serial port on USB, the dead-man timer and the poll
//! clock.
//!
//! One initiator at a time has the line: the host on USB in the middle of a sequence, or the initiator whose request is
//! in flight. A frame that answers a request goes to its initiator. All other bytes of the arm go to the host on USB,
//! byte by byte unless another initiator waits for an answer.

mod arbiter;
mod dead_man;
mod from_arm;
mod from_host;
mod gate;
mod hold;
mod poll;
mod queues;
mod rate;
mod requests;
mod serial_port;
mod stop;
mod streams;
mod to_arm;
mod to_host;
mod turns;

use armwire::decoder::Decoder;
use armwire::exchange::Exchange;
use armwire::time::{Duration, Instant};

use crate::arm::OwnRequest;
use crate::config::{ArmKind, Config};
use crate::control::{Failure, FrameBytes, Initiator, Latencies, MAX_FRAME, Refusal};
use crate::counters::{Counters, count};
use crate::earliest::Earliest;
use crate::events::EventQueue;

use arbiter::Arbiter;
use dead_man::DeadMan;
use from_host::FromHost;
use poll::Poll;
use rate::LineRate;
use requests::Requests;
use stop::Stop;
use to_arm::Burst;
use to_host::ToHost;

pub(crate) use dead_man::STREAMERS;
pub use from_arm::RxThreshold;
pub use from_host::TO_ARM_BUFFER;
pub use poll::POLL_LEAD_TIME;
pub(crate) use queues::NotTaken;
pub(crate) use rate::ControlPort;
pub(crate) use streams::{EndedStream, EndedStreams};
pub use to_arm::Transmit;
pub use to_host::{PACKET, TO_HOST_BUFFER};

/// Maximum number of requests in flight that are tracked one by one.
const MAX_PENDING: usize = 8;

/// Time after its timeout during which an answer may still arrive.
pub(crate) const STALE_WINDOW: Duration = Duration::from_millis(50);

/// Time that bytes for the arm may wait, or the UART go unread, before the adapter counts as stuck.
const STUCK_TIME: Duration = Duration::from_millis(1_000);

/// The line to the arm, and the serial port on USB.
pub(crate) struct Line {
    kind: ArmKind,
    /// Decodes the bytes of the arm.
    decoder: Decoder<ArmKind, MAX_FRAME>,
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
    stop: Stop,
    /// The adapter's request in flight is an identification.
    is_identifying: bool,
    /// The result of the last identification.
    identified: Option<Result<Option<FrameBytes>, Failure>>,
    command_timeout: Duration,
    /// Polls and CAN are being refused because the host on USB holds the line.
    is_held: bool,
    /// Receivers other than the host on USB get all frames.
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
            stop: Stop::new(),
            is_identifying: false,
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

    /// Applies a new configuration. Returns the streams that this ends.
    pub(crate) fn configure(&mut self, was: &Config, config: &Config, now: Instant) -> EndedStreams {
        self.command_timeout = Duration::from_millis(config.can.command_timeout_ms.into());
        self.dead_man
            .configure(config.host_timeout, config.arm.own(OwnRequest::TorqueOff).is_some());
        let ended = if config.arm != was.arm {
            self.change_arm(config.arm, now)
        } else if !config.can.commands || config.can.bus() != was.can.bus() {
            self.refuse_command(Refusal::Stale, now);
            [None, None, self.end_stream(Initiator::Command, 0, false)]
        } else {
            EndedStreams::default()
        };
        if config.poll != was.poll || config.arm != was.arm {
            self.poll = Poll::new(config.poll);
            self.poll.pause(self.is_held, now);
            self.poll.tick(now);
        }
        ended
    }

    /// Changes the kind of arm: exchanges with the previous one end, and all streams.
    #[cold]
    fn change_arm(&mut self, kind: ArmKind, now: Instant) -> EndedStreams {
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
        let ended = STREAMERS.map(|initiator| self.end_stream(initiator, 0, false));
        if self.requests.identify.take().is_some() {
            self.identify(now);
        }
        self.refuse_can_requests(Refusal::NotAFrame, now);
        self.restart_stop(now);
        self.from_host.touch(now);
        self.rate.set_arm(kind, self.from_host.len());
        self.follow_holder(now);
        ended
    }

    /// The time of the next [`tick`](Self::tick) unless another event comes first. It may lie in the past.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        Earliest::of(self.poll.timeout())
            .or(self.exchange.timeout())
            .or(self.turn_timeout())
            .or(self.command_timeout())
            .or(self.stop.timeout())
            .or(self.rate.timeout(self.may_change_rate()))
            .or(self.silence_timeout(Initiator::Usb))
            .or(self.silence_timeout(Initiator::Can))
            .or(self.silence_timeout(Initiator::Command))
            .get()
    }

    /// Advances the time to `now`: late answers expire, polls become due, old commands are dropped, silent hosts lose
    /// their streams, which are returned.
    pub(crate) fn tick(&mut self, now: Instant) -> EndedStreams {
        self.tick_requests(now);
        self.tick_stop(now);
        if self.rate.timeout(self.may_change_rate()).is_some_and(|at| at <= now) {
            self.tick_rate(now);
        }
        let ended = STREAMERS.map(|initiator| self.tick_silence(initiator, now));
        // Torque-off may have begun to wait for the line.
        self.tick_turn(now);
        ended
    }

    /// Ends the stream of a host that has been silent for its timeout.
    fn tick_silence(&mut self, initiator: Initiator, now: Instant) -> Option<EndedStream> {
        if self.silence_timeout(initiator).is_none_or(|at| at > now) {
            return None;
        }
        // USB does not report that the host wants to send.
        if initiator == Initiator::Usb && self.is_host_held_back() {
            self.dead_man.keep_alive(initiator, now);
            return None;
        }
        self.host_silent(initiator, now)
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

#[cfg(test)]
impl Line {
    /// Number of pending requests of hosts on CAN, and of pending bytes of the host on USB.
    pub(crate) fn waiting(&self) -> (usize, usize) {
        (self.requests.can.len(), self.from_host.len())
    }
}
