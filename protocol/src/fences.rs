//! Fences: requests whose answers show that earlier answers are lost.
//!
//! Each fence that goes out has another key than those without an answer, as long as there is one: then its answer can be
//! no other's. On a line that is silent for longer, the last key is repeated, as a sign of life. When that is answered,
//! the first key is sent until one of its answers can only be to a fence that went out since. A line that loses more than
//! half of its frames may never get there: it is recognised, and fences end.

use crate::exchange::Exchange;
use crate::messages::Messages;
use crate::time::{Duration, Instant};

/// Maximum number of handovers of one fence that may be answered: of two, the order of answers tells which is left.
const MAX_MISSING: u16 = 2;
/// The number of places in the exchange for the first key: one for those from before a silence, one for those after it.
const FIRST_PLACES: usize = 2;
/// The shortest time from a fence to the next one, without an answer.
const PAUSE: Duration = Duration::from_millis(3);
/// The number of stale windows for which a line answers fences, and its order shows nothing.
const LOSSY: u64 = 40;
/// The number of lost fences that shows that an arm answers none.
const MAX_LOST: u16 = 6;
/// The number of fences in a row that shows that an arm answers them no longer, while it answers calls.
const MAX_IGNORED: u16 = 16;

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

/// The state of a line, by its fences.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Line {
    /// A fence has a key of which its answer can be told.
    Heard,
    /// All keys have answers missing, and the last one is repeated.
    Silent,
    /// That was answered. The answers from before may be lost, or on the way.
    Back,
}

/// The fences of one client.
pub(crate) struct Fences {
    /// The fence that is being transmitted, and the number of its bytes that are out.
    writing: Option<(Fence, usize)>,
    line: Line,
    /// The first answer since the line was silent, and order has shown nothing yet.
    back: Option<Instant>,
    /// The indices of the last fence, and of the next one of those with equally few answers missing.
    last: usize,
    index: usize,
    /// The time of the last fence. No other goes out before `due`.
    sent: Instant,
    due: Instant,
    /// The time from the next fence to the one after it, without an answer.
    pause: Duration,
    /// An arm that has answered a fence answers them all.
    is_answered: bool,
    /// The number of fences that were lost before one was answered.
    lost: u16,
    /// A call was answered since the last fence.
    is_heard: bool,
    /// The number of fences since the last one that was answered, each behind an answer to a call.
    ignored: u16,
    is_off: bool,
}

impl Fences {
    /// Places in the exchange: one for each key, and one for a new fence of the first key.
    pub(crate) const fn places<M: Messages>() -> usize {
        M::FENCES.len() + FIRST_PLACES - 1
    }

    pub(crate) const fn new() -> Self {
        Self {
            writing: None,
            line: Line::Heard,
            back: None,
            last: 0,
            index: 0,
            sent: Instant::ZERO,
            due: Instant::ZERO,
            pause: PAUSE,
            is_answered: false,
            lost: 0,
            is_heard: false,
            ignored: 0,
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
        let key = |frame: &[u8]| messages.request(frame).map(|info| info.key);
        let missing = |frame: &[u8]| key(frame).map_or(0, |key| exchange.missing_answers(key));
        let all = M::FENCES.iter().copied().enumerate().cycle();
        let from_next = all.skip(self.index).take(M::FENCES.len());
        let best = from_next.min_by_key(|(_, frame)| missing(frame));
        let fence = match best.filter(|(_, frame)| missing(frame) < MAX_MISSING) {
            Some((index, frame)) => {
                (self.line, self.back) = (Line::Heard, None);
                (self.last, self.index) = (index, index + 1);
                Fence { frame, is_new: false }
            }
            None => {
                let is_back = self.line == Line::Back;
                // Until it is answered.
                self.line = Line::Silent;
                let open = key(first).map_or(0, |key| exchange.open_of(key, Who::Fence));
                Fence {
                    frame: if is_back { first } else { last },
                    // One place is for those from before, and one for all that go out since.
                    is_new: is_back && open < FIRST_PLACES,
                }
            }
        };
        self.writing = Some((fence, 0));
    }

    /// The bytes that are to be transmitted.
    pub(crate) fn pending<M: Messages>(&self) -> &'static [u8] {
        // A client without fences has no code for them.
        if M::FENCES.is_empty() {
            return &[];
        }
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
        let pause = self.pause.max(latency).min(longest).max(PAUSE);
        self.writing = None;
        (self.sent, self.due, self.pause) = (now, now + pause, pause + pause);
        self.ignored = self.ignored.saturating_add(u16::from(self.is_heard));
        self.is_off |= self.ignored >= MAX_IGNORED;
        self.is_heard = false;
        Some(complete)
    }

    /// A fence was answered at `now`.
    pub(crate) fn answered<const N: usize, M: Messages>(
        &mut self,
        exchange: &Exchange<M, Who, N>,
        now: Instant,
        window: Duration,
    ) {
        self.is_answered = true;
        self.ignored = 0;
        // The same one again, if no other is better: its answer tells of those that went out before its last one.
        self.index = self.last;
        self.pause = PAUSE.max(now.since(self.sent));
        // The others may be answered, too.
        self.due = match exchange.open(Who::Fence) {
            0 => now,
            _ => self.due.min(now + self.pause),
        };
        if self.line != Line::Silent {
            return;
        }
        self.line = Line::Back;
        let back = *self.back.get_or_insert(now);
        self.is_off |= now.since(back).as_micros() > LOSSY.saturating_mul(window.as_micros());
    }

    /// A call was answered.
    pub(crate) const fn heard(&mut self) {
        self.is_heard = true;
    }

    /// The answer to a later request shows that this number of fences is lost.
    pub(crate) const fn lost(&mut self, count: u16) {
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
