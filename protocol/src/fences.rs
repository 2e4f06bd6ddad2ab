//! Fences: requests whose answers show that earlier answers are lost.
//!
//! Each fence that goes out has another key than those without an answer, as long as there is one: then its answer can be
//! no other's. On a line that is silent for longer, the last key is repeated, as a sign of life. When that is answered,
//! the first key goes out once more than it has answers missing: one of so many answers is to a new fence.

use crate::exchange::Exchange;
use crate::messages::Messages;
use crate::time::{Duration, Instant};

/// Maximum number of handovers of one fence that may be answered: of two, the order of answers tells which is left.
const MAX_MISSING: u16 = 2;
/// The shortest time from a fence to the next one, without an answer.
const PAUSE: Duration = Duration::from_millis(3);
/// The number of lost fences that shows that an arm answers none.
const MAX_LOST: usize = 6;

/// The initiator of a send of a client.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Who {
    Call,
    Fence,
}

/// A fence.
#[derive(Clone, Copy)]
pub(crate) struct Fence {
    pub(crate) frame: &'static [u8],
    /// It is told from those of its key that went out before.
    pub(crate) is_new: bool,
}

/// The fences of one client.
pub(crate) struct Fences {
    /// The fence that is being transmitted, and the number of its bytes that are out.
    writing: Option<(Fence, usize)>,
    /// The index of the next fence, of those with equally few answers missing.
    index: usize,
    /// The index of the last fence.
    last: usize,
    /// No fence goes out before.
    due: Instant,
    /// The time from the next fence to the one after it, without an answer.
    pause: Duration,
    /// The time of the last one.
    sent: Instant,
    /// All fences had answers missing when the last one went out.
    is_silent: bool,
    /// The number of fences of the first key that go out at once.
    burst: u16,
    /// An arm that has answered a fence answers them all.
    is_answered: bool,
    /// The number of fences that were lost before one was answered.
    lost: usize,
    is_off: bool,
}

impl Fences {
    pub(crate) const fn new() -> Self {
        Self {
            writing: None,
            index: 0,
            last: 0,
            due: Instant::ZERO,
            pause: PAUSE,
            sent: Instant::ZERO,
            is_silent: false,
            burst: 0,
            is_answered: false,
            lost: 0,
            is_off: false,
        }
    }

    /// Returns true if the arm is known to answer fences, or may do so.
    pub(crate) const fn are_on<M: Messages>(&self) -> bool {
        !M::FENCES.is_empty() && !self.is_off
    }

    /// Returns true if the arm is known to answer fences, or to answer none.
    pub(crate) const fn are_known(&self) -> bool {
        self.is_answered || self.is_off
    }

    /// Returns true if the arm is known to answer fences.
    pub(crate) const fn are_answered(&self) -> bool {
        self.is_answered && !self.is_off
    }

    /// Starts the next fence, if one is due.
    pub(crate) fn start<M: Messages, const N: usize>(
        &mut self,
        messages: &M,
        exchange: &Exchange<M, Who, N>,
        now: Instant,
    ) {
        let (Some(&first), Some(&last)) = (M::FENCES.first(), M::FENCES.last()) else {
            return;
        };
        if self.writing.is_some() || now < self.due {
            return;
        }
        let missing = |frame: &[u8]| {
            let info = messages.request(frame);
            info.map_or(0, |info| exchange.missing_answers(info.key))
        };
        if missing(first) < MAX_MISSING {
            self.burst = 0;
        }
        let all = M::FENCES.iter().copied().enumerate().cycle();
        let from_next = all.skip(self.index).take(M::FENCES.len());
        let fence = if self.burst > 0 {
            // Those after the first one belong to it.
            let is_new = missing(first) < self.burst;
            self.burst -= 1;
            Fence { frame: first, is_new }
        } else {
            let best = from_next.min_by_key(|(_, frame)| missing(frame));
            let (index, frame) = best
                .filter(|(_, frame)| missing(frame) < MAX_MISSING)
                .unwrap_or_else(|| {
                    self.is_silent = true;
                    (0, last)
                });
            (self.last, self.index) = (index, index + 1);
            Fence { frame, is_new: false }
        };
        self.writing = Some((fence, 0));
    }

    /// The bytes that are to be transmitted.
    pub(crate) fn pending(&self) -> &'static [u8] {
        let frame = self.writing.and_then(|(fence, at)| fence.frame.get(at..));
        frame.unwrap_or_default()
    }

    /// `n` of these bytes were transmitted at `now`. Returns the fence that is complete with them. `latency` is the time
    /// of a round trip, `longest` that between two fences.
    pub(crate) fn transmitted(
        &mut self,
        n: usize,
        now: Instant,
        latency: Duration,
        longest: Duration,
    ) -> Option<Fence> {
        let (fence, at) = self.writing.as_mut()?;
        *at = at.saturating_add(n);
        let complete = (*at >= fence.frame.len()).then_some(*fence)?;
        self.writing = None;
        self.sent = now;
        if self.burst == 0 {
            let pause = self.pause.max(latency).min(longest).max(PAUSE);
            (self.due, self.pause) = (now + pause, pause + pause);
        }
        Some(complete)
    }

    /// A fence was answered at `now`.
    pub(crate) fn answered<M: Messages, const N: usize>(
        &mut self,
        messages: &M,
        exchange: &Exchange<M, Who, N>,
        now: Instant,
    ) {
        self.is_answered = true;
        // The same one again, if no other is better: its answer tells of those that went out before its last one.
        self.index = self.last;
        self.pause = PAUSE.max(now.since(self.sent));
        // The others may be answered, too.
        let are_all_answered = exchange.open(Who::Fence) == 0;
        self.due = if are_all_answered { now } else { now + self.pause };
        if core::mem::take(&mut self.is_silent)
            && let Some(first) = M::FENCES.first().and_then(|frame| messages.request(frame))
        {
            self.burst = exchange.missing_answers(first.key).saturating_add(1);
            self.due = now;
        }
    }

    /// The answer to a later request shows that this number of fences is lost.
    pub(crate) const fn lost(&mut self, count: usize) {
        self.lost = self.lost.saturating_add(count);
        self.is_off |= !self.is_answered && self.lost >= MAX_LOST;
    }

    /// The arm's answers do not keep the order of their requests.
    pub(crate) const fn out_of_order(&mut self) {
        self.is_off = true;
    }

    /// The time of the next fence.
    pub(crate) const fn due(&self) -> Instant {
        self.due
    }
}
