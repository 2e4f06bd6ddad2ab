//! The receiving half of an endpoint.

use armwire::time::Instant;

use super::pci::{CONTINUE, FLOW_CONTROL, OVERFLOW};
use super::{Config, Error, Event, Events, Ignored, Link, NEVER, RefusedPdu, block};
use crate::can::{Frame, MAX_FD};

/// The state of a transfer. The endpoint owns the bytes: this code is then compiled once for all lengths.
pub(super) struct Receiver {
    state: State,
    /// The timeout of the next consecutive frame.
    deadline: Instant,
    /// Length of the PDU, and number of bytes received.
    len: usize,
    got: usize,
    /// Length of the first frame. All others but the last have the same.
    frame_len: u8,
    /// The sequence number of the next consecutive frame.
    number: u8,
    /// Consecutive frames until the next flow control.
    left: u16,
    /// Status of the flow control frame to send.
    answer: Option<u8>,
    /// The flow control frame was handed over and was not reported as transmitted.
    handed: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    Idle,
    /// A consecutive frame is expected, once flow control is out.
    Receiving,
    /// The PDU is complete and has not been released.
    Whole,
}

impl Receiver {
    pub(super) const fn new() -> Self {
        Self {
            state: State::Idle,
            deadline: Instant::ZERO,
            len: 0,
            got: 0,
            frame_len: 0,
            number: 0,
            left: 0,
            answer: None,
            handed: false,
        }
    }

    /// The length of the PDU, if it is complete.
    pub(super) fn whole(&self) -> Option<usize> {
        (self.state == State::Whole).then_some(self.len)
    }

    pub(super) fn release(&mut self) {
        if self.state == State::Whole {
            self.state = State::Idle;
        }
    }

    /// Aborts the transfer. Returns true if there was one.
    pub(super) fn abort(&mut self) -> bool {
        (self.answer, self.handed) = (None, false);
        let is_receiving = self.state == State::Receiving;
        if is_receiving {
            self.state = State::Idle;
        }
        is_receiving
    }

    pub(super) fn timeout(&self) -> Instant {
        match self.state {
            State::Receiving => self.deadline,
            _ => NEVER,
        }
    }

    pub(super) fn tick(&mut self, config: &Config, now: Instant) -> Option<Event> {
        if self.state != State::Receiving || now < self.deadline {
            return None;
        }
        self.abort();
        Some(Event::Failed(Error::NoConsecutiveFrame {
            waited: config.n_cr,
            expected: self.len,
            got: self.got,
        }))
    }

    /// Returns true if a flow control frame is due.
    pub(super) const fn has_answer(&self) -> bool {
        self.answer.is_some()
    }

    /// The flow control frame to send, if one is due.
    pub(super) fn transmit(&mut self, config: &Config, now: Instant) -> Option<Frame> {
        let status = self.answer.take()?;
        self.handed = true;
        self.deadline = now + config.n_cr;
        let head = [FLOW_CONTROL | status, config.block_size, config.st_min.to_byte()];
        Some(Frame::padded(config.tx, config.link == Link::Fd, &head, &[]))
    }

    /// The flow control frame has left. Does nothing if called again.
    pub(super) fn transmitted(&mut self, config: &Config, now: Instant) {
        if core::mem::take(&mut self.handed) {
            self.deadline = now + config.n_cr;
        }
    }

    /// Handles a single frame.
    pub(super) fn single(&mut self, buffer: &mut [u8], data: &[u8]) -> Events {
        let interrupted = self.interrupt();
        let event = match self.room(buffer, data.len() as u32) {
            Ok(()) => {
                self.len = data.len();
                self.got = 0;
                self.take(buffer, data);
                self.answer = None;
                self.state = State::Whole;
                Event::Received
            }
            Err(refused) => Event::Refused(refused),
        };
        Events {
            first: interrupted,
            second: Some(event),
        }
    }

    /// Handles a first frame: `data` and two or six more bytes, of a PDU of `len` bytes.
    pub(super) fn first(
        &mut self,
        buffer: &mut [u8],
        (frame_len, len, data): (usize, u32, &[u8]),
        config: &Config,
        now: Instant,
    ) -> Events {
        let interrupted = self.interrupt();
        let event = match self.room(buffer, len) {
            Ok(()) => {
                self.len = len as usize;
                self.got = 0;
                self.take(buffer, data);
                // No frame is longer.
                self.frame_len = frame_len.min(MAX_FD) as u8;
                self.number = 1;
                self.go_on(config);
                self.state = State::Receiving;
                self.deadline = now + config.n_cr;
                None
            }
            Err(refused) => {
                self.answer = Some(OVERFLOW);
                Some(Event::Refused(refused))
            }
        };
        Events {
            first: interrupted,
            second: event,
        }
    }

    /// Handles a consecutive frame: `data` and one more byte.
    pub(super) fn consecutive(
        &mut self,
        buffer: &mut [u8],
        (number, data): (u8, &[u8]),
        config: &Config,
        now: Instant,
    ) -> Option<Event> {
        if self.state != State::Receiving || self.answer.is_some() {
            return Some(Event::Ignored(Ignored::UnexpectedConsecutive { got: number }));
        }
        let got = data.len().saturating_add(1);
        let rest = self.len.saturating_sub(self.got).saturating_add(1);
        let frame_len = usize::from(self.frame_len);
        let expected = rest.min(frame_len);
        if got < expected {
            return Some(Event::Ignored(Ignored::Short { expected, got }));
        }
        if got > frame_len {
            let expected = frame_len;
            return Some(Event::Ignored(Ignored::Long { expected, got }));
        }
        if number != self.number {
            self.state = State::Idle;
            return Some(Event::Failed(Error::WrongSequenceNumber {
                expected: self.number,
                got: number,
            }));
        }
        self.deadline = now + config.n_cr;
        self.number = (number + 1) & 0x0F;
        self.take(buffer, data);
        if self.got == self.len {
            self.state = State::Whole;
            return Some(Event::Received);
        }
        self.left = self.left.saturating_sub(1);
        if self.left == 0 {
            self.go_on(config);
        }
        None
    }

    /// Aborts the transfer, because another PDU begins.
    fn interrupt(&mut self) -> Option<Event> {
        if self.state != State::Receiving {
            return None;
        }
        self.abort();
        Some(Event::Failed(Error::Interrupted {
            expected: self.len,
            got: self.got,
        }))
    }

    fn room(&self, buffer: &[u8], got: u32) -> Result<(), RefusedPdu> {
        let max = buffer.len();
        match self.state {
            State::Whole => Err(RefusedPdu::Occupied { got }),
            _ if got as usize > max => Err(RefusedPdu::TooLong { max, got }),
            _ => Ok(()),
        }
    }

    /// Appends the part of `data` that belongs to the PDU.
    fn take(&mut self, buffer: &mut [u8], data: &[u8]) {
        let room = buffer.get_mut(self.got..self.len).unwrap_or_default();
        for (to, from) in room.iter_mut().zip(data) {
            *to = *from;
        }
        self.got = self.len.min(self.got.saturating_add(data.len()));
    }

    /// Schedules flow control that lets the sender continue.
    fn go_on(&mut self, config: &Config) {
        self.left = block(config.block_size);
        self.answer = Some(CONTINUE);
    }
}
