//! The sending half of an endpoint.

use armwire::time::Instant;

use super::pci::{self, CONSECUTIVE, CONTINUE, FIRST, WAIT};
use super::{Config, Error, Event, Ignored, Link, NEVER, SeparationTime, block};
use crate::can::{Frame, MAX_CLASSIC, MAX_FD};

/// The state of a transfer. The endpoint owns the bytes: this code is then compiled once for all lengths.
pub(super) struct Sender {
    state: State,
    /// The time at which the next frame is due; otherwise the start of the wait for a transmission or for flow control.
    at: Instant,
    /// Length of the PDU, and number of bytes handed over.
    len: usize,
    sent: usize,
    /// The sequence number of the next consecutive frame.
    number: u8,
    /// Consecutive frames until flow control, and the minimum time between them.
    left: u16,
    gap: SeparationTime,
    /// Consecutive WAIT frames from the receiver.
    waits: u8,
    /// The last frame was handed over and was not reported as transmitted.
    handed: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// A single or first frame is next.
    Begin,
    /// Flow control is next.
    Wait,
    /// A consecutive frame is next.
    Go,
}

impl Sender {
    pub(super) const fn new() -> Self {
        Self {
            state: State::Idle,
            at: Instant::ZERO,
            len: 0,
            sent: 0,
            number: 0,
            left: 0,
            gap: SeparationTime::ZERO,
            waits: 0,
            handed: false,
        }
    }

    pub(super) const fn is_idle(&self) -> bool {
        matches!(self.state, State::Idle)
    }

    /// Starts the transfer of a PDU of `len` bytes, 1 to 4095.
    pub(super) const fn begin(&mut self, len: usize) {
        *self = Self {
            state: State::Begin,
            len,
            ..Self::new()
        };
    }

    /// Aborts the transfer. Returns true if there was one.
    pub(super) const fn abort(&mut self) -> bool {
        let is_sending = !self.is_idle();
        (self.state, self.handed) = (State::Idle, false);
        is_sending
    }

    // Not inlined: it has many callers, and each would contain the additions.
    #[inline(never)]
    pub(super) fn timeout(&self, config: &Config) -> Instant {
        match self.state {
            State::Idle | State::Begin => NEVER,
            State::Wait if !self.handed => self.at + config.n_bs,
            // This also covers a due frame for which the controller has no room: the receiver stops waiting for it.
            State::Wait | State::Go => self.at + config.n_as,
        }
    }

    pub(super) fn tick(&mut self, config: &Config, now: Instant) -> Option<Event> {
        if matches!(self.state, State::Idle | State::Begin) || now < self.timeout(config) {
            return None;
        }
        let error = match self.state {
            State::Wait if !self.handed => Error::NoFlowControl { waited: config.n_bs },
            _ => Error::NotTransmitted {
                waited: config.n_as,
                len: self.len,
                handed: self.sent,
            },
        };
        self.abort();
        Some(Event::Failed(error))
    }

    pub(super) fn transmit_at(&self) -> Instant {
        match self.state {
            // The separation time starts when the previous frame has left.
            State::Go if self.handed && self.gap != SeparationTime::ZERO => NEVER,
            State::Begin | State::Go => self.at,
            State::Idle | State::Wait => NEVER,
        }
    }

    /// The next frame of the PDU at the start of `buffer`, if one is due.
    pub(super) fn transmit(&mut self, buffer: &[u8], config: &Config, now: Instant) -> Option<Frame> {
        if !matches!(self.state, State::Begin | State::Go) || now < self.transmit_at() {
            return None;
        }
        let (room, max_single) = match config.link {
            Link::Classic => (MAX_CLASSIC, pci::MAX_SHORT_SINGLE),
            Link::Fd => (MAX_FD, pci::MAX_FD_SINGLE),
        };
        let [high, low] = (self.len as u16).to_be_bytes();
        let head: &[u8] = match self.state {
            State::Go => &[CONSECUTIVE | self.number],
            _ if self.len <= pci::MAX_SHORT_SINGLE => &[low],
            _ if self.len <= max_single => &[0, low],
            _ => &[FIRST | high, low],
        };
        let rest = buffer.get(self.sent..self.len).unwrap_or_default();
        let frame = Frame::padded(config.tx, config.link == Link::Fd, head, rest);

        (self.handed, self.at) = (true, now);
        self.number = (self.number + 1) & 0x0F;
        self.sent = self.sent.saturating_add(room.saturating_sub(head.len()));
        if self.sent >= self.len {
            self.state = State::Idle;
        } else if self.state == State::Begin || self.left == 1 {
            (self.state, self.waits) = (State::Wait, 0);
        } else {
            self.left = self.left.saturating_sub(1);
        }
        Some(frame)
    }

    /// The last frame has left. Does nothing if called again.
    pub(super) fn transmitted(&mut self, now: Instant) {
        if core::mem::take(&mut self.handed) {
            self.at = match self.state {
                State::Go => now + self.gap.duration(),
                _ => now,
            };
        }
    }

    /// Handles flow control.
    pub(super) fn flow_control(
        &mut self,
        (status, block_size, gap): (u8, u8, SeparationTime),
        config: &Config,
        now: Instant,
    ) -> Option<Event> {
        if self.state != State::Wait {
            return Some(Event::Ignored(Ignored::UnexpectedFlowControl { got: status }));
        }
        // An answered frame has left, reported or not. The next step has its full timeout from now.
        (self.handed, self.at) = (false, now);
        let error = match status {
            CONTINUE => {
                self.state = State::Go;
                self.left = block(block_size);
                self.gap = gap;
                return None;
            }
            WAIT if self.waits < config.max_waits => {
                self.waits += 1;
                return None;
            }
            WAIT => Error::TooManyWaits { max: config.max_waits },
            pci::OVERFLOW => Error::Overflow { len: self.len },
            got => Error::InvalidFlowStatus { got },
        };
        self.state = State::Idle;
        Some(Event::Failed(error))
    }
}
