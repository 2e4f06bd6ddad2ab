//! The assignment of answers to requests.
//!
//! A *send* is a request that was handed to the line and wants an answer. It is *pending* until its initiator gives it up, then
//! *stale*. The rules:
//!
//! * An answer belongs to the oldest unresolved send of its key that was handed over before the answer's first byte: by the
//!   decoder's offset, and by time where bytes are stamped. A send is resolved by its answer, or, once stale, when it is due
//!   plus the stale window. A repeat is of the same send, which then has as many answers.
//! * A request that wants an answer may go when no stale send of its key by any initiator is unresolved, none of its key by another
//!   initiator, and none with another `Expect`. Requests without an answer wait for nothing. The caller
//!   decides the order of those that wait.
//! * `N` counts sends, and nothing is evicted. Sends beyond them *saturate* the exchange until the stale window of the last of
//!   them has passed: no request may go meanwhile.
//! * With transaction ids nothing waits. A stale send then makes room for a new one if it must, because its answer, being
//!   numbered, can be taken for no other's.
//! * Only an answer moves a deadline: an arm answers one request after the other, so those behind it have their time from then.
//!
//! An arm whose answers are later than the stale window can be mixed up.

use core::cell::Cell;

use crate::dialect::{Dialect, InfoOf};
use crate::time::{Duration, Instant};

/// When a request was handed to the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Handover {
    /// The number of bytes that had arrived: the decoder's [`received`](crate::decoder::Decoder::received).
    pub offset: u64,
    /// When its last byte is on the line.
    pub at: Instant,
    /// When its answer is due.
    pub due: Instant,
}

/// The place of a frame's first byte among the received bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FirstByte {
    /// The number of bytes before it.
    pub offset: u64,
    /// When it arrived, where bytes are stamped.
    pub at: Option<Instant>,
}

/// The request that a frame answers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Match<I> {
    /// A pending request.
    Answer {
        /// Its initiator.
        who: I,
        /// When its last byte was on the line.
        sent: Instant,
    },
    /// A stale request of this initiator.
    Late(I),
    /// No request.
    Unsolicited,
}

/// A request that was handed over and wants an answer.
struct Sent<D: Dialect, I> {
    key: D::Key,
    expect: D::Expect,
    who: I,
    offset: u64,
    at: Instant,
    due: Instant,
    /// The longest time to the answer, from the end of the request or from the previous answer.
    patience: Duration,
    /// The number of times that it was handed over and not answered: repeats are of the same call.
    times: u16,
    stale: bool,
}

impl<D: Dialect, I: Copy + Eq> Sent<D, I> {
    fn new(info: InfoOf<D>, who: I, handover: Handover) -> Self {
        Self {
            key: info.key,
            expect: info.expect,
            who,
            offset: handover.offset,
            at: handover.at,
            due: handover.due,
            patience: handover.due.since(handover.at),
            times: 1,
            stale: false,
        }
    }

    /// Whether a request of `who` must wait until this send is resolved.
    fn blocks(&self, info: &InfoOf<D>, who: I) -> bool {
        self.expect != info.expect || self.key == info.key && (self.stale || self.who != who)
    }
}

/// Sends that are not counted one by one.
struct Saturation {
    until: Instant,
    patience: Duration,
}

/// The sends on one line that are not resolved, at most `N`. `I` tells the initiators apart, `()` where there is one.
pub struct Exchange<D: Dialect, I, const N: usize> {
    stale_window: Duration,
    /// In the order in which they were handed over, without gaps.
    sends: Slots<Sent<D, I>, N>,
    saturated: Option<Saturation>,
}

impl<D: Dialect, I: Copy + Eq, const N: usize> Exchange<D, I, N> {
    /// An exchange without sends. An answer that comes within the stale window after its due time is taken for no other's.
    pub const fn new(stale_window: Duration) -> Self {
        Self {
            stale_window,
            sends: Slots::new(),
            saturated: None,
        }
    }

    /// The expectation of the line: the answer to the oldest unresolved send.
    pub fn expect(&self, dialect: &D) -> D::Expect {
        match self.sends.iter().next() {
            Some(oldest) => oldest.expect,
            None => dialect.unsolicited(),
        }
    }

    /// Whether a request may go now.
    pub fn can_send(&self, info: &InfoOf<D>, who: I) -> bool {
        if info.response.is_none() {
            return true;
        }
        let has_room = self.sends.len() < N;
        if D::HAS_TRANSACTION_ID {
            return has_room || self.sends.iter().any(|sent| sent.stale);
        }
        has_room && self.saturated.is_none() && !self.sends.iter().any(|sent| sent.blocks(info, who))
    }

    /// A request was handed over. Returns whether its send is counted.
    pub fn begin(&mut self, info: InfoOf<D>, who: I, handover: Handover) -> bool {
        if info.response.is_none() {
            return true;
        }
        if D::HAS_TRANSACTION_ID && self.sends.len() == N {
            self.sends.remove_first_where(|sent| sent.stale);
        }
        let mut sent = Sent::new(info, who, handover);
        // An arm answers one request after the other: this one is not due before those that it still works on.
        let pending = self.sends.iter().filter(|sent| !D::HAS_TRANSACTION_ID && !sent.stale);
        sent.due = pending.map(|pending| pending.due).fold(sent.due, Instant::max);
        let due = sent.due;
        // An answer to one of those that are not counted must not be taken for an answer to a newer one.
        if self.saturated.is_none() && self.sends.push(sent) {
            return true;
        }
        let until = self
            .saturated
            .as_ref()
            .map_or(Instant::ZERO, |saturation| saturation.until);
        self.saturated = Some(Saturation {
            until: until.max(due + self.stale_window),
            patience: handover.due.since(handover.at),
        });
        false
    }

    /// A request was handed over again, and may be answered once more. It is due when this repeat is.
    pub fn repeat(&mut self, info: InfoOf<D>, who: I, handover: Handover) {
        let of_call = |sent: &&mut Sent<D, I>| sent.who == who && sent.key == info.key;
        let sent = self.sends.iter_mut().find(of_call);
        let Some(sent) = sent else {
            self.begin(info, who, handover);
            return;
        };
        sent.times = sent.times.saturating_add(1);
        sent.due = handover.due;
        sent.stale = false;
    }

    /// A frame arrived, its last byte at `now`: which request it answers. [Resolve](Self::expire) before what was over when it
    /// came, not what was over when it was read.
    pub fn on_frame(&mut self, dialect: &D, frame: &[u8], first: FirstByte, now: Instant) -> Match<I> {
        let window = self.stale_window;
        let answered = self.sends.iter_mut().find(|sent| {
            sent.offset <= first.offset
                && first.at.is_none_or(|at| sent.at <= at)
                && dialect.is_response_to(sent.key, frame)
        });
        let Some(sent) = answered else {
            return Match::Unsolicited;
        };
        sent.times = sent.times.saturating_sub(1);
        let (who, sent, stale) = (sent.who, sent.at, sent.stale);
        self.sends.remove_first_where(|sent| sent.times == 0);
        for behind in self.sends.iter_mut().filter(|other| sent <= other.at && !other.stale) {
            behind.due = behind.due.max(now + behind.patience);
        }
        if let Some(saturation) = &mut self.saturated {
            saturation.until = saturation.until.max(now + saturation.patience + window);
        }
        match stale {
            true => Match::Late(who),
            false => Match::Answer { who, sent },
        }
    }

    /// This initiator gives up its pending sends: they are stale from now on.
    pub fn give_up(&mut self, who: I) {
        for sent in self.sends.iter_mut().filter(|sent| sent.who == who) {
            sent.stale = true;
        }
    }

    /// When to call [`on_timeout`](Self::on_timeout), if nothing happens before.
    pub fn timeout(&self) -> Option<Instant> {
        let window = self.stale_window;
        let sends = self.sends.iter().map(|sent| match sent.stale {
            true => sent.due + window,
            false => sent.due,
        });
        sends
            .chain(self.saturated.as_ref().map(|saturation| saturation.until))
            .min()
    }

    /// Resolves the stale sends whose window is over.
    pub fn expire(&mut self, now: Instant) {
        let window = self.stale_window;
        self.sends.remove_where(|sent| sent.stale && sent.due + window <= now);
        let _ = self.saturated.take_if(|saturation| saturation.until <= now);
    }

    /// [Resolves](Self::expire) stale sends, then gives up the oldest pending send whose answer is missing at `now` and says whose
    /// it was. Call it until it returns `None`.
    pub fn on_timeout(&mut self, now: Instant) -> Option<I> {
        self.expire(now);
        let missing = self.sends.iter_mut().find(|sent| !sent.stale && sent.due <= now)?;
        missing.stale = true;
        Some(missing.who)
    }

    /// When the first answer is due that this initiator waits for.
    pub fn due(&self, who: I) -> Option<Instant> {
        let pending = self.sends.iter().filter(|sent| sent.who == who && !sent.stale);
        pending.map(|sent| sent.due).min()
    }

    /// The initiator of the oldest pending send: an answer to it may be on its way.
    pub fn holder(&self) -> Option<I> {
        self.sends.iter().find(|sent| !sent.stale).map(|sent| sent.who)
    }

    /// Whether no send is unresolved.
    pub fn is_idle(&self) -> bool {
        self.sends.len() == 0 && self.saturated.is_none()
    }

    /// Whether more was sent than is counted.
    pub const fn is_saturated(&self) -> bool {
        self.saturated.is_some()
    }

    /// Forgets all sends, because there is another arm on the line. Returns how many were pending.
    pub fn clear(&mut self) -> usize {
        let pending = self.sends.iter().filter(|sent| !sent.stale).count();
        *self = Self::new(self.stale_window);
        pending
    }
}

/// Up to `N` values in order, without gaps.
struct Slots<T, const N: usize>([Option<T>; N]);

impl<T, const N: usize> Slots<T, N> {
    const fn new() -> Self {
        Self([const { None }; N])
    }

    fn iter(&self) -> impl Iterator<Item = &T> {
        self.0.iter().map_while(Option::as_ref)
    }

    fn iter_mut(&mut self) -> impl Iterator<Item = &mut T> {
        self.0.iter_mut().map_while(Option::as_mut)
    }

    fn len(&self) -> usize {
        self.iter().count()
    }

    /// Whether there was room.
    fn push(&mut self, value: T) -> bool {
        match self.0.iter_mut().find(|slot| slot.is_none()) {
            Some(slot) => {
                *slot = Some(value);
                true
            }
            None => false,
        }
    }

    fn remove(&mut self, index: usize) -> Option<T> {
        let slots = Cell::from_mut(&mut self.0[..]).as_slice_of_cells().get(index..)?;
        let removed = slots.first()?.take();
        for (to, from) in slots.iter().zip(slots.iter().skip(1)) {
            let Some(next) = from.take() else { break };
            to.set(Some(next));
        }
        removed
    }

    fn remove_first_where(&mut self, condition: impl Fn(&T) -> bool) -> Option<T> {
        let index = self.iter().position(condition)?;
        self.remove(index)
    }

    fn remove_where(&mut self, condition: impl Fn(&T) -> bool) {
        while self.remove_first_where(&condition).is_some() {}
    }
}
