//! The serial port of a device: it extracts request frames from bytes and delays answers.

use std::collections::VecDeque;

use armwire::alpha1::{Alpha1, Expect, MAX_FRAME, Outcome, hid};
use armwire::correlation::Correlation;
use armwire::decoder::{Decoder, Kind as ItemKind};
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

    /// Returns the frame of the next request. Call it until it returns `None`.
    pub(super) fn next_request(&mut self) -> Option<Vec<u8>> {
        loop {
            let item = self.decoder.next(&Alpha1, Expect::Requests)?;
            match item.kind {
                ItemKind::Frame if Alpha1.parse_request(item.bytes).is_ok() => {
                    self.counters.requests += 1;
                    return Some(item.bytes.to_vec());
                }
                ItemKind::Frame => self.counters.unknown += 1,
                ItemKind::Noise(_) | ItemKind::Broken(_) => self.counters.noise_bytes += item.bytes.len() as u64,
                ItemKind::Padding => {}
            }
        }
    }

    /// Returns the outcome for an answer, and counts refusals.
    pub(super) fn outcome(&mut self, accepted: bool) -> Outcome {
        self.counters.refused += u64::from(!accepted);
        if accepted { Outcome::Success } else { Outcome::Failure }
    }

    /// Queues the answer to a request received at `now`, if there is one.
    pub(super) fn reply(&mut self, now: Instant, request: &[u8], answer: Option<Vec<u8>>) {
        let Some(mut bytes) = answer else {
            let answered = Alpha1.request(request).is_some_and(|info| info.response.is_some());
            self.counters.refused += u64::from(answered);
            return;
        };
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
