//! The serial port of a device: it extracts request frames from bytes and delays answers.

use std::collections::VecDeque;

use armwire::alpha1::{Alpha1, Expect, MAX_FRAME, Request, hid};
use armwire::correlation::Correlation;
use armwire::decoder::{Decoder, Item, Kind as ItemKind};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};

use crate::serial::Counters;

/// Maximum number of queued answers. Further answers are dropped.
pub(super) const MAX_REPLIES: usize = 8;

/// Type of line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    /// Full duplex.
    Serial,
    /// Full duplex, with each answer in USB HID reports: padded with zeros to 64 bytes.
    Reports,
    /// Half duplex on one wire, optionally with an echo of the host's bytes.
    SingleWire { echo: bool },
}

/// An answer that is queued or in transmission.
#[derive(Debug)]
struct Reply {
    due: Instant,
    bytes: Vec<u8>,
    sent: usize,
}

#[derive(Debug)]
pub(super) struct Port {
    kind: Kind,
    turnaround: Duration,
    /// Idle time of the line after which an incomplete frame is discarded.
    idle: Duration,
    decoder: Decoder<Alpha1, MAX_FRAME>,
    /// Time at which the line becomes idle, `None` after that.
    idle_at: Option<Instant>,
    echo: VecDeque<u8>,
    replies: VecDeque<Reply>,
    pub(super) counters: Counters,
}

impl Port {
    pub(super) fn new(kind: Kind, turnaround: Duration, idle: Duration) -> Self {
        Self {
            kind,
            turnaround,
            idle,
            decoder: Decoder::new(),
            idle_at: None,
            echo: VecDeque::new(),
            replies: VecDeque::new(),
            counters: Counters::default(),
        }
    }

    /// Takes a byte. On a single wire, a byte that arrives during an answer is lost.
    pub(super) fn receive(&mut self, now: Instant, byte: u8) {
        self.counters.bytes += 1;
        if let Kind::SingleWire { echo } = self.kind {
            if self.is_transmitting() {
                self.counters.collided += 1;
                return;
            }
            if echo {
                self.echo.push_back(byte);
            }
        }
        self.idle_at = Some(now + self.idle);
        // All earlier frames have been taken out: there is room.
        let _ = self.decoder.push(&[byte]);
    }

    /// Reports an idle line to the decoder.
    pub(super) fn idle(&mut self) {
        self.decoder.idle();
    }

    /// Returns the time at which the line became idle, once.
    pub(super) fn take_idle(&mut self, now: Instant) -> Option<Instant> {
        self.idle_at.take_if(|idle_at| *idle_at <= now)
    }

    /// Passes each request received at `now` to `execute`, and queues its answer, if there is one.
    pub(super) fn answer(&mut self, now: Instant, mut execute: impl FnMut(&Request<'_>) -> Option<Vec<u8>>) {
        while let Some(Item { kind, bytes, .. }) = self.decoder.next(&Alpha1, Expect::Requests) {
            match (kind, Alpha1.parse_request(bytes)) {
                (ItemKind::Frame, Ok(request)) => {
                    self.counters.requests += 1;
                    let is_answered = Alpha1.request(bytes).is_some_and(|info| info.response.is_some());
                    match execute(&request) {
                        Some(answer) => self.reply(now, answer),
                        None => self.counters.refused += u64::from(is_answered),
                    }
                }
                (ItemKind::Frame, Err(_)) => self.counters.unknown += 1,
                (ItemKind::Noise(_) | ItemKind::Broken(_), _) => self.counters.noise_bytes += bytes.len() as u64,
                (ItemKind::Padding, _) => {}
            }
        }
    }

    /// Queues an answer to a request received at `now`.
    fn reply(&mut self, now: Instant, mut bytes: Vec<u8>) {
        if self.replies.len() == MAX_REPLIES {
            self.counters.overrun += 1;
            return;
        }
        self.counters.answered += 1;
        if self.kind == Kind::Reports {
            bytes = hid::reports(&bytes).flatten().collect();
        }
        self.replies.push_back(Reply {
            due: now + self.turnaround,
            bytes,
            sent: 0,
        });
    }

    /// Returns the next byte to transmit, if one may start at `now`.
    pub(super) fn transmit(&mut self, now: Instant) -> Option<u8> {
        // An echo waits for the end of the answer in transmission.
        if !self.is_transmitting()
            && let Some(byte) = self.echo.pop_front()
        {
            return Some(byte);
        }
        let reply = self.replies.front_mut().filter(|reply| reply.due <= now)?;
        let byte = reply.bytes[reply.sent];
        reply.sent += 1;
        if reply.sent == reply.bytes.len() {
            self.replies.pop_front();
            // The next answer starts one turnaround after this one.
            if let Some(next) = self.replies.front_mut() {
                next.due = next.due.max(now + self.turnaround);
            }
        }
        Some(byte)
    }

    pub(super) fn poll_timeout(&self) -> Option<Instant> {
        let echo = (!self.echo.is_empty()).then_some(Instant::ZERO);
        let reply = self.replies.front().map(|reply| reply.due);
        [echo, reply, self.idle_at].into_iter().flatten().min()
    }

    /// Returns true if an answer is in transmission.
    fn is_transmitting(&self) -> bool {
        self.replies.front().is_some_and(|reply| reply.sent > 0)
    }
}
