//! The half of an endpoint that sends.

use armwire::Micros;

use super::pci::{self, CONSECUTIVE, CONTINUE, FIRST, WAIT};
use super::{Config, Error, Event, Ignored, Link, NEVER, SeparationTime, block};
use crate::can::{Frame, MAX_CLASSIC, MAX_FD};

/// Where it is in the PDU. The bytes themselves are the endpoint's, so that this is compiled once for all lengths.
pub(super) struct Sender {
    state: State,
    /// When the next frame is due, or flow control is late.
    at: Micros,
    /// Bytes in the PDU, and how many of them were handed over.
    len: usize,
    sent: usize,
    /// The sequence number of the next consecutive frame.
    number: u8,
    /// Consecutive frames until flow control, and the least time between them.
    left: u16,
    gap: SeparationTime,
    /// How often in a row the receiver has said that it is not ready.
    waits: u8,
    /// The last frame was handed over and has not left, as far as is known.
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
            at: Micros(0),
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

    /// Begins to send a PDU of `len` bytes, 1 to 4095.
    pub(super) const fn begin(&mut self, len: usize) {
        *self = Self {
            state: State::Begin,
            len,
            ..Self::new()
        };
    }

    /// Whether there was a PDU to give up.
    pub(super) const fn abort(&mut self) -> bool {
        let is_sending = !self.is_idle();
        (self.state, self.handed) = (State::Idle, false);
        is_sending
    }

    pub(super) fn timeout(&self) -> Micros {
        match self.state {
            State::Wait => self.at,
            _ => NEVER,
        }
    }

    pub(super) fn tick(&mut self, config: &Config, now: Micros) -> Option<Event> {
        if self.state != State::Wait || now < self.at {
            return None;
        }
        self.state = State::Idle;
        Some(Event::Failed(Error::NoFlowControl { waited: config.n_bs }))
    }

    pub(super) fn transmit_at(&self) -> Micros {
        match self.state {
            State::Begin | State::Go => self.at,
            State::Idle | State::Wait => NEVER,
        }
    }

    /// The next frame of the PDU at the start of `buffer`, if one is due.
    pub(super) fn transmit(&mut self, buffer: &[u8], config: &Config, now: Micros) -> Option<Frame> {
        if !matches!(self.state, State::Begin | State::Go) || now < self.at {
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

        self.handed = true;
        self.number = (self.number + 1) & 0x0F;
        self.sent = self.sent.saturating_add(room.saturating_sub(head.len()));
        if self.sent >= self.len {
            self.state = State::Idle;
        } else if self.state == State::Begin || self.left == 1 {
            self.waits = 0;
            self.wait(config, now);
        } else {
            self.left = self.left.saturating_sub(1);
            // The separation begins when the frame has left.
            self.at = match self.gap {
                SeparationTime::ZERO => now,
                _ => NEVER,
            };
        }
        Some(frame)
    }

    /// The last frame has left, unless that was said before.
    pub(super) fn transmitted(&mut self, config: &Config, now: Micros) {
        if !core::mem::take(&mut self.handed) {
            return;
        }
        match self.state {
            State::Wait => self.wait(config, now),
            State::Go => self.at = now + self.gap.micros(),
            State::Idle | State::Begin => {}
        }
    }

    /// Flow control came.
    pub(super) fn flow_control(
        &mut self,
        (status, block_size, gap): (u8, u8, SeparationTime),
        config: &Config,
        now: Micros,
    ) -> Option<Event> {
        if self.state != State::Wait {
            return Some(Event::Ignored(Ignored::UnexpectedFlowControl { got: status }));
        }
        // What is answered has left, whether or not that was said.
        self.handed = false;
        let error = match status {
            CONTINUE => {
                self.state = State::Go;
                self.at = now;
                self.left = block(block_size);
                self.gap = gap;
                return None;
            }
            WAIT if self.waits < config.max_waits => {
                self.waits += 1;
                self.wait(config, now);
                return None;
            }
            WAIT => Error::TooManyWaits { max: config.max_waits },
            pci::OVERFLOW => Error::Overflow { len: self.len },
            got => Error::InvalidFlowStatus { got },
        };
        self.state = State::Idle;
        Some(Event::Failed(error))
    }

    /// Flow control has its full time from now.
    fn wait(&mut self, config: &Config, now: Micros) {
        self.state = State::Wait;
        self.at = now + config.n_bs;
    }
}
