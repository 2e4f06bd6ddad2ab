//! The half of an endpoint that sends.

use armwire::Micros;

use super::pci::{self, CONSECUTIVE, CONTINUE, FIRST, WAIT};
use super::{Config, Error, Event, Ignored, Link, SeparationTime};
use crate::can::{Frame, MAX_CLASSIC, MAX_FD};

/// Where it is in the PDU. The bytes themselves are the endpoint's, so that this is compiled once for all lengths.
pub(super) struct Sender {
    state: State,
    /// Bytes in the PDU, and how many of them were handed over.
    len: usize,
    sent: usize,
    /// The sequence number of the next consecutive frame.
    number: u8,
}

#[derive(Clone, Copy)]
enum State {
    Idle,
    /// A single or first frame is next.
    Begin,
    /// Flow control is next, and comes until the deadline.
    Wait {
        deadline: Micros,
        waits: u8,
    },
    /// A consecutive frame is next, not before it is due.
    Go {
        left: u16,
        gap: SeparationTime,
        due: Micros,
    },
}

impl Sender {
    pub(super) const fn new() -> Self {
        Self {
            state: State::Idle,
            len: 0,
            sent: 0,
            number: 0,
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

    pub(super) const fn abort(&mut self) {
        self.state = State::Idle;
    }

    pub(super) fn timeout(&self) -> Option<Micros> {
        match self.state {
            State::Wait { deadline, .. } => Some(deadline),
            _ => None,
        }
    }

    pub(super) fn tick(&mut self, config: &Config, now: Micros) -> Option<Event> {
        self.timeout().filter(|&deadline| deadline <= now)?;
        self.state = State::Idle;
        Some(Event::Failed(Error::NoFlowControl { waited: config.n_bs }))
    }

    pub(super) fn transmit_at(&self) -> Option<Micros> {
        match self.state {
            State::Begin => Some(Micros(0)),
            State::Go { due, .. } => Some(due),
            State::Idle | State::Wait { .. } => None,
        }
    }

    /// The next frame of the PDU at the start of `buffer`, if one is due.
    pub(super) fn transmit(&mut self, buffer: &[u8], config: &Config, now: Micros) -> Option<Frame> {
        self.transmit_at().filter(|&due| due <= now)?;
        let wait = State::Wait {
            deadline: now + config.n_bs,
            waits: 0,
        };
        let (room, max_single) = match config.link {
            Link::Classic => (MAX_CLASSIC, pci::MAX_SHORT_SINGLE),
            Link::Fd => (MAX_FD, pci::MAX_FD_SINGLE),
        };
        let [high, low] = (self.len as u16).to_be_bytes();
        let (head, next): (&[u8], _) = match self.state {
            State::Go { left, gap, .. } => {
                let next = match left {
                    1 => wait,
                    _ => State::Go {
                        left: left.saturating_sub(1),
                        gap,
                        due: now + gap.micros(),
                    },
                };
                (&[CONSECUTIVE | self.number], next)
            }
            _ if self.len <= pci::MAX_SHORT_SINGLE => (&[low], State::Idle),
            _ if self.len <= max_single => (&[0, low], State::Idle),
            _ => (&[FIRST | high, low], wait),
        };
        let rest = buffer.get(self.sent..self.len).unwrap_or_default();
        let frame = Frame::padded(config.tx, config.link == Link::Fd, head, rest);

        self.number = (self.number + 1) & 0x0F;
        self.sent = self.sent.saturating_add(room.saturating_sub(head.len()));
        self.state = if self.sent < self.len { next } else { State::Idle };
        Some(frame)
    }

    /// The last frame left the bus.
    pub(super) fn transmitted(&mut self, config: &Config, now: Micros) {
        match &mut self.state {
            State::Wait { deadline, .. } => *deadline = now + config.n_bs,
            State::Go { due, gap, .. } => *due = now + gap.micros(),
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
        let State::Wait { waits, .. } = self.state else {
            return Some(Event::Ignored(Ignored::UnexpectedFlowControl { got: status }));
        };
        let error = match status {
            CONTINUE => {
                // No PDU has as many frames as a block without end.
                let left = if block_size == 0 {
                    u16::MAX
                } else {
                    u16::from(block_size)
                };
                self.state = State::Go { left, gap, due: now };
                return None;
            }
            WAIT if waits < config.max_waits => {
                self.state = State::Wait {
                    deadline: now + config.n_bs,
                    waits: waits + 1,
                };
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
