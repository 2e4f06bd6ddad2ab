//! The arm's side of the adapter: the UART, the arbitration, the serial port on USB, the dead-man timer and the poll
//! clock.
//!
//! One initiator at a time has the line: the host on USB in the middle of a sequence, or the initiator whose request is
//! in flight. A frame that answers a request goes to its initiator. All other bytes of the arm go to the host on USB,
//! byte by byte unless another initiator waits for an answer.
//!
//! The state has three owners, and each field is written by its owner only:
//!
//! * [`Wire`] is what arrives: the decoder, the requests in flight, and the serial port towards the host on USB.
//! * [`Outbox`] is what goes out: the bytes of the host on USB, the requests of all others, and whose turn it is.
//! * [`Guard`] is what may go out: the streams of motion, a stop, the line's rate and its reservation.
//!
//! `Outbox` reads the other two through a [`View`](outbox::View) when it chooses the next burst. Otherwise the owners
//! know nothing of each other: what one has found out it returns, for example the initiator that a frame answers, and
//! `Line` tells the others. All of them write into the [`Journal`], and none decides by it.

mod byte_time;
pub(crate) mod deferred;
mod from_arm;
mod guard;
mod journal;
mod outbox;
mod queues;
mod rate;
mod reservation;
mod serial_port;
mod stop;
mod streams;
mod to_arm;
mod wire;

use armwire::time::{Duration, Instant};

use crate::config::{ArmKind, Config};
use crate::control::{Initiator, Latencies, Refusal};
use crate::counters::Counters;
use crate::earliest::Earliest;

use guard::Guard;
use journal::Journal;
use outbox::Outbox;
use wire::Wire;

pub(crate) use guard::{ControlPort, EndedStream, EndedStreams, STREAMERS};
pub(crate) use outbox::NotTaken;
pub use outbox::{POLL_LEAD_TIME, TO_ARM_BUFFER, Transmit};
pub use wire::{PACKET, RxThreshold, TO_HOST_BUFFER};

/// Time that bytes for the arm may wait, or the UART go unread, before the adapter counts as stuck.
const STUCK_TIME: Duration = Duration::from_millis(1_000);

/// The line to the arm, and the serial port on USB.
pub(crate) struct Line {
    kind: ArmKind,
    wire: Wire,
    outbox: Outbox,
    guard: Guard,
    journal: Journal,
}

impl Line {
    pub(crate) fn new(config: &Config) -> Self {
        Self {
            kind: config.arm,
            wire: Wire::new(),
            outbox: Outbox::new(config),
            guard: Guard::new(config),
            journal: Journal::new(),
        }
    }

    pub(crate) const fn counters(&self) -> &Counters {
        &self.journal.counters
    }

    /// Bytes that passed in both directions.
    pub(crate) const fn passed_bytes(&self) -> u32 {
        let c = &self.journal.counters;
        c.arm_to_host_bytes.wrapping_add(c.host_to_arm_bytes)
    }

    pub(crate) const fn latencies(&self) -> &Latencies {
        &self.journal.latencies
    }

    /// Returns true if a packet for the host on USB is due.
    pub(crate) fn is_packet_due(&self) -> bool {
        self.wire.to_host().is_due()
    }

    /// Returns true if a host has configured the USB device.
    pub(crate) fn is_attached(&self) -> bool {
        self.wire.to_host().is_attached()
    }

    /// Returns true if a host has the serial port open.
    pub(crate) fn is_port_open(&self) -> bool {
        self.wire.to_host().is_open()
    }

    pub(crate) const fn set_poll_lead_time(&mut self, lead: Duration) {
        self.outbox.set_poll_lead_time(lead);
    }

    /// Applies a new configuration. Returns the streams that this ends.
    pub(crate) fn configure(&mut self, was: &Config, config: &Config, now: Instant) -> EndedStreams {
        self.outbox.configure(config);
        self.guard.configure(config);
        let ended = if config.arm != was.arm {
            self.change_arm(config.arm, now)
        } else if !config.can.commands || config.can.bus() != was.can.bus() {
            self.outbox.refuse_command(Refusal::Stale, now, &mut self.journal);
            [None, None, self.guard.end_stream(Initiator::Command, 0, false)]
        } else {
            EndedStreams::default()
        };
        if config.poll != was.poll || config.arm != was.arm {
            self.outbox.restart_poll(config.poll, self.guard.is_reserved(), now);
        }
        ended
    }

    /// Changes the kind of arm: exchanges with the previous one end, and all streams.
    #[cold]
    fn change_arm(&mut self, kind: ArmKind, now: Instant) -> EndedStreams {
        if let Some(initiator) = self.wire.end_exchanges(&mut self.journal) {
            self.end_exchange(initiator, now);
        }
        self.kind = kind;
        self.wire.drop_unfinished();
        self.outbox.change_arm(now, &mut self.journal);
        let ended = STREAMERS.map(|initiator| self.guard.end_stream(initiator, 0, false));
        self.outbox
            .identify_again(kind, self.guard.is_reserved(), now, &mut self.journal);
        self.outbox
            .refuse_can_requests(Refusal::NotAFrame, now, &mut self.journal);
        self.restart_stop(now);
        self.outbox.touch(now);
        self.change_rate(now, |rate, queued| rate.set_arm(kind, queued));
        ended
    }

    /// The time of the next [`tick`](Self::tick) unless another event comes first. It may lie in the past.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        Earliest::of(self.outbox.poll_timeout())
            .or(self.wire.timeout())
            .or(self.outbox.turn_timeout(self.view()))
            .or(self.outbox.command_timeout())
            .or(self.guard.stop.timeout())
            .or(self.rate_timeout())
            .or(self.next_silence())
            .get()
    }

    /// Advances the time to `now`: late answers expire, polls become due, old commands are dropped, silent hosts lose
    /// their streams, which are returned.
    pub(crate) fn tick(&mut self, now: Instant) -> EndedStreams {
        self.tick_requests(now);
        self.tick_stop(now);
        if self.rate_timeout().is_some_and(|at| at <= now) {
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
        if initiator == Initiator::Usb && self.is_host_delayed() {
            self.guard.dead_man.keep_alive(initiator, now);
            return None;
        }
        self.host_silent(initiator, now)
    }

    /// Returns true if bytes for the arm have not moved, or the UART has not been read, for a second.
    pub(crate) fn is_stuck(&self, now: Instant) -> bool {
        let unsent = self.outbox.queued() > 0 || self.guard.rate.changes();
        // While an answer is outstanding, bytes may wait for it. That wait has a timeout.
        let stands = self.wire.open_initiator().is_none();
        now.since(self.wire.last_read()) > STUCK_TIME
            || unsent && stands && now.since(self.outbox.last_moved()) > STUCK_TIME
    }
}

#[cfg(test)]
impl Line {
    /// Number of pending requests of hosts on CAN, and of pending bytes of the host on USB.
    pub(crate) fn waiting(&self) -> (usize, usize) {
        self.outbox.waiting()
    }
}
