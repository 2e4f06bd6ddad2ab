//! The matching of answers to requests.
//!
//! This layer is for firmware, monitors and implementations of other arms. It is less stable than the
//! [client](crate::Client): see [Stability](crate#stability).
//!
//! A *send* is a request that was handed to the line and expects an answer. It is *pending* until its initiator stops
//! waiting, then *stale*. The rules:
//!
//! * An answer belongs to the oldest unresolved send of its key that was handed over before the answer's first byte: by
//!   the decoder's offset, and by time if bytes have time stamps. A send is resolved by its answer. A stale one is also
//!   resolved by the answer to a send that was handed over later, because an arm answers in the order of its requests;
//!   and at its timeout plus the stale window. A repeat belongs to the same send, which then has as many answers.
//! * A request with an answer may be sent if there is no unresolved stale send of its key by any initiator, no
//!   unresolved send of its key by another initiator, and no unresolved send with another `Expect`. Requests without an
//!   answer never wait. The caller decides the order of waiting requests.
//! * `N` limits the number of tracked sends, and nothing is evicted. Further sends *saturate* the exchange until the
//!   stale window of the last of them has ended. No request may be sent in that time.
//! * With transaction ids no request waits. A new send may then replace a stale one, because a numbered answer cannot
//!   be assigned to another send.
//! * Only an answer moves a deadline: an arm answers one request after the other, and the timeouts of later requests
//!   start then.
//! * A *reading* is one of many requests for a state at a steady rate. It waits for no stale send of its key by its own
//!   initiator. It *follows* them, whose answers come first; or it *overtakes* them, where order does not show which
//!   answers are lost, and takes an answer before them: each answer has the state, and only their number is exact. The
//!   sends that it overtakes become one, with as many answers, which ends no earlier than the reading's own stale window.
//! * The answer to a send that was resolved by order is out of order. It is counted, and order resolves no send any more.
//!
//! An answer later than the stale window can be assigned to the wrong request.

use core::cell::Cell;

use crate::correlation::{Correlation, InfoOf};
use crate::time::{Duration, Instant};

/// The handover of a request to the line.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Handover {
    /// The number of bytes received before: the decoder's [`received`](crate::decoder::Decoder::received).
    pub offset: u64,
    /// The time of its handover.
    pub at: Instant,
    /// The timeout of its answer.
    pub due: Instant,
}

/// The longest time to an answer whose state is as new as its receipt.
const PROMPT: Duration = Duration::from_millis(10);

/// The time of the state in an answer: that of its receipt, or of its request if it took more than 10 ms. The line, or the
/// arm, may have held a later answer back.
pub fn time_of_state(sent: Instant, received: Instant) -> Instant {
    if received.since(sent) <= PROMPT { received } else { sent }
}

/// The position of a frame's first byte among the received bytes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct FirstByte {
    /// The number of bytes before it.
    pub offset: u64,
    /// Its arrival, if bytes have time stamps.
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
        /// The time of its last byte on the line.
        sent: Instant,
    },
    /// A stale request.
    Late {
        /// Its initiator.
        who: I,
        /// The time of its last byte on the line.
        sent: Instant,
    },
    /// No request.
    Unsolicited,
}

/// A request that was handed over and expects an answer.
struct Sent<D: Correlation, I> {
    key: D::Key,
    expect: D::Expect,
    who: I,
    offset: u64,
    /// No answer to an earlier handover is possible.
    at: Instant,
    /// The last handover.
    last: Instant,
    due: Instant,
    /// Maximum time to the answer, from the end of the request or from the previous answer.
    timeout: Duration,
    /// The number of handovers that were not answered: repeats belong to the same call.
    times: u16,
    stale: bool,
}

impl<D: Correlation, I: Copy + Eq> Sent<D, I> {
    fn new(info: InfoOf<D>, who: I, handover: Handover) -> Self {
        Self {
            key: info.key,
            expect: info.expect,
            who,
            offset: handover.offset,
            at: handover.at,
            last: handover.at,
            due: handover.due,
            timeout: handover.due.since(handover.at),
            times: 1,
            stale: false,
        }
    }

    /// Returns true if this frame answers it.
    fn is_answered_by(&self, correlation: &D, frame: &[u8], first: FirstByte) -> bool {
        self.offset <= first.offset
            && first.at.is_none_or(|at| self.at <= at)
            && correlation.is_response_to(self.key, frame)
    }

    /// Returns true for an unresolved send of this key by `who`.
    fn is_of(&self, key: D::Key, who: I) -> bool {
        self.key == key && self.who == who
    }

    /// Takes one of its answers. The answer to its last handover may be left.
    fn answered(&mut self) {
        self.times = self.times.saturating_sub(1);
        if self.times == 1 {
            self.at = self.last;
        }
    }

    /// Returns true if a request of `who` must wait until this send is resolved.
    fn blocks(&self, info: &InfoOf<D>, who: I) -> bool {
        self.expect != info.expect || self.key == info.key && (self.stale || self.who != who)
    }
}

/// Sends that are not tracked one by one.
struct Saturation {
    until: Instant,
    timeout: Duration,
}

/// The unresolved sends on one line, at most `N`. `I` identifies the initiator; use `()` for a single one.
pub struct Exchange<D: Correlation, I, const N: usize> {
    stale_window: Duration,
    /// In the order of their first handovers, without gaps.
    sends: Slots<Sent<D, I>, N>,
    saturated: Option<Saturation>,
    /// The key of the last send that was resolved by order, and the time by which the answer would have come.
    lost: Option<(D::Key, Instant)>,
    out_of_order: u16,
}

impl<D: Correlation, I: Copy + Eq, const N: usize> Exchange<D, I, N> {
    /// An exchange without sends. An answer within the stale window after its timeout is never assigned to another
    /// send.
    pub const fn new(stale_window: Duration) -> Self {
        Self {
            stale_window,
            sends: Slots::new(),
            saturated: None,
            lost: None,
            out_of_order: 0,
        }
    }

    /// Changes the stale window, of all sends.
    pub const fn set_stale_window(&mut self, window: Duration) {
        self.stale_window = window;
    }

    /// The decoder's expectation: the answer to the oldest unresolved send.
    pub fn expect(&self, correlation: &D) -> D::Expect {
        match self.sends.iter().next() {
            Some(oldest) => oldest.expect,
            None => correlation.unsolicited(),
        }
    }

    /// Returns true if a request may be sent now.
    pub fn can_send(&self, info: &InfoOf<D>, who: I) -> bool {
        self.is_free(info, who, |_| false, 0)
    }

    /// Returns true if a reading may be sent now that follows those before it.
    pub fn can_follow(&self, info: &InfoOf<D>, who: I) -> bool {
        self.is_free(info, who, |sent| sent.is_of(info.key, who), 0)
    }

    /// Returns true if a reading may be sent now that [overtakes](Self::overtake) those before it.
    pub fn can_overtake(&self, info: &InfoOf<D>, who: I) -> bool {
        let is_overtaken = |sent: &Sent<D, I>| sent.stale && sent.is_of(info.key, who);
        // One of them remains.
        let freed = self.sends.iter().filter(|sent| is_overtaken(sent)).count();
        self.is_free(info, who, is_overtaken, freed.saturating_sub(1))
    }

    /// Returns true if a request may be sent now that waits for no `passed` send, and frees places.
    fn is_free(&self, info: &InfoOf<D>, who: I, passed: impl Fn(&Sent<D, I>) -> bool, freed: usize) -> bool {
        if info.response.is_none() {
            return true;
        }
        if D::HAS_TRANSACTION_ID {
            return self.sends.len() < N || self.sends.iter().any(|sent| sent.stale);
        }
        let has_room = self.sends.len().saturating_sub(freed) < N;
        let blocks = |sent: &Sent<D, I>| !passed(sent) && sent.blocks(info, who);
        has_room && self.saturated.is_none() && !self.sends.iter().any(blocks)
    }

    /// A reading was handed over that [may overtake](Self::can_overtake) those before it.
    pub fn overtake(&mut self, info: InfoOf<D>, who: I, handover: Handover) {
        if D::HAS_TRANSACTION_ID {
            self.begin(info, who, handover);
            return;
        }
        let is_overtaken = |sent: &Sent<D, I>| sent.stale && sent.is_of(info.key, who);
        let mut overtaken = self.sends.remove_first_where(is_overtaken);
        if let Some(sent) = &mut overtaken {
            while let Some(other) = self.sends.remove_first_where(is_overtaken) {
                sent.times = sent.times.saturating_add(other.times);
                sent.due = sent.due.max(other.due);
            }
            // If the reading takes an earlier answer, its own is still to come.
            (sent.last, sent.due) = (handover.at, sent.due.max(handover.due));
        }
        self.begin(info, who, handover);
        if let Some(sent) = overtaken {
            // Behind the reading, which takes the next answer.
            self.sends.push(sent);
        }
    }

    /// The number of unresolved sends of this initiator.
    pub fn open(&self, who: I) -> usize {
        self.sends.iter().filter(|sent| sent.who == who).count()
    }

    /// The number of unresolved sends of this key by this initiator.
    pub(crate) fn open_of(&self, key: D::Key, who: I) -> usize {
        self.sends.iter().filter(|sent| sent.is_of(key, who)).count()
    }

    /// The number of handovers of this initiator that may be answered.
    pub fn missing_answers_of(&self, who: I) -> u16 {
        let sends = self.sends.iter().filter(|sent| sent.who == who);
        sends.fold(0, |sum, sent| sum.saturating_add(sent.times))
    }

    /// The number of handovers of this key that may be answered, by any initiator.
    pub fn missing_answers(&self, key: D::Key) -> u16 {
        let sends = self.sends.iter().filter(|sent| sent.key == key);
        sends.fold(0, |sum, sent| sum.saturating_add(sent.times))
    }

    /// The number of answers that came out of order.
    pub const fn out_of_order(&self) -> u16 {
        self.out_of_order
    }

    /// A request was handed over. Returns true if its send is tracked.
    pub fn begin(&mut self, info: InfoOf<D>, who: I, handover: Handover) -> bool {
        if info.response.is_none() {
            return true;
        }
        if D::HAS_TRANSACTION_ID && self.sends.len() == N {
            self.sends.remove_first_where(|sent| sent.stale);
        }
        let mut sent = Sent::new(info, who, handover);
        // An arm answers one request after the other: this answer is not due before the pending ones.
        let pending = self.sends.iter().filter(|sent| !D::HAS_TRANSACTION_ID && !sent.stale);
        sent.due = pending.map(|pending| pending.due).fold(sent.due, Instant::max);
        let due = sent.due;
        // An answer to an untracked send must not be taken for an answer to a newer one.
        if self.saturated.is_none() && self.sends.push(sent) {
            return true;
        }
        let until = self
            .saturated
            .as_ref()
            .map_or(Instant::ZERO, |saturation| saturation.until);
        self.saturated = Some(Saturation {
            until: until.max(due + self.stale_window),
            timeout: handover.due.since(handover.at),
        });
        false
    }

    /// The request of the last send was handed over again: one more answer is possible. Its timeout is that of the repeat.
    pub fn repeat(&mut self, info: InfoOf<D>, who: I, handover: Handover) {
        let of_call = |sent: &&mut Sent<D, I>| sent.is_of(info.key, who);
        let sent = self.sends.iter_mut().filter(of_call).last();
        let Some(sent) = sent else {
            self.begin(info, who, handover);
            return;
        };
        sent.times = sent.times.saturating_add(1);
        (sent.last, sent.due) = (handover.at, handover.due);
        sent.stale = false;
    }

    /// A frame arrived, its last byte at `now`. Returns the request that it answers.
    ///
    /// The time stamp of its first byte, if it has one, [resolves](Self::expire) the sends that had ended by then. Without
    /// it a frame may have arrived long before, and resolves none.
    pub fn on_frame(&mut self, correlation: &D, frame: &[u8], first: FirstByte, now: Instant) -> Match<I> {
        if let Some(at) = first.at {
            self.expire(at);
        }
        let window = self.stale_window;
        let is_answered = |sent: &&mut Sent<D, I>| sent.is_answered_by(correlation, frame, first);
        let Some(answered) = self.sends.iter_mut().find(is_answered) else {
            self.check_order(correlation, frame, now);
            return Match::Unsolicited;
        };
        let (who, sent, stale) = (answered.who, answered.at, answered.stale);
        answered.answered();
        if correlation.keeps_order() && self.out_of_order == 0 {
            self.resolve_before(sent, now);
        }
        self.sends.remove_where(|sent| sent.times == 0);
        for behind in self.sends.iter_mut().filter(|other| sent <= other.at && !other.stale) {
            behind.due = behind.due.max(now + behind.timeout);
        }
        if let Some(saturation) = &mut self.saturated {
            saturation.until = saturation.until.max(now + saturation.timeout + window);
        }
        match stale {
            true => Match::Late { who, sent },
            false => Match::Answer { who, sent },
        }
    }

    /// Resolves the stale sends whose last handover was before this time: a later request was answered.
    fn resolve_before(&mut self, time: Instant, now: Instant) {
        for earlier in self.sends.iter_mut().filter(|other| other.stale && other.last < time) {
            earlier.times = 0;
            self.lost = Some((earlier.key, now + earlier.timeout));
        }
    }

    /// Counts a frame that answers a send which order has resolved.
    fn check_order(&mut self, correlation: &D, frame: &[u8], now: Instant) {
        if correlation.keeps_order()
            && let Some((key, until)) = self.lost
            && now <= until
            && self.saturated.is_none()
            && correlation.is_response_to(key, frame)
        {
            self.out_of_order = self.out_of_order.saturating_add(1);
        }
    }

    /// Returns true if this frame answers the only unresolved send, a pending one of `who`: with it, the exchange becomes
    /// [idle](Self::is_idle).
    pub fn is_last_answer(&self, correlation: &D, who: I, frame: &[u8], first: FirstByte) -> bool {
        let mut sends = self.sends.iter();
        match (sends.next(), sends.next(), &self.saturated) {
            (Some(sent), None, None) => {
                let is_awaited = !sent.stale && sent.who == who && sent.times == 1;
                is_awaited && sent.is_answered_by(correlation, frame, first)
            }
            _ => false,
        }
    }

    /// Makes the pending sends of this initiator stale.
    pub fn give_up(&mut self, who: I) {
        for sent in self.sends.iter_mut().filter(|sent| sent.who == who) {
            sent.stale = true;
        }
    }

    /// The time of the next [`on_timeout`](Self::on_timeout), unless another event comes first.
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

    /// Resolves the stale sends whose window has ended.
    pub fn expire(&mut self, now: Instant) {
        let window = self.stale_window;
        self.sends.remove_where(|sent| sent.stale && sent.due + window <= now);
        let _ = self.saturated.take_if(|saturation| saturation.until <= now);
    }

    /// [Resolves](Self::expire) stale sends. Then makes the oldest pending send with a missing answer stale and returns
    /// its initiator. `None` once no answer is missing.
    #[must_use = "more answers may be missing"]
    pub fn on_timeout(&mut self, now: Instant) -> Option<I> {
        self.expire(now);
        let missing = self.sends.iter_mut().find(|sent| !sent.stale && sent.due <= now)?;
        missing.stale = true;
        Some(missing.who)
    }

    /// The earliest timeout among this initiator's pending answers.
    pub fn due(&self, who: I) -> Option<Instant> {
        let pending = self.sends.iter().filter(|sent| sent.who == who && !sent.stale);
        pending.map(|sent| sent.due).min()
    }

    /// The initiator of the oldest open exchange: its send is pending, and the answer may be in flight.
    pub fn open_initiator(&self) -> Option<I> {
        self.sends.iter().find(|sent| !sent.stale).map(|sent| sent.who)
    }

    /// Returns true if all sends are resolved.
    pub fn is_idle(&self) -> bool {
        self.sends.len() == 0 && self.saturated.is_none()
    }

    /// Returns true if there are more sends than are tracked.
    pub const fn is_saturated(&self) -> bool {
        self.saturated.is_some()
    }

    /// Discards all sends, for another arm on the line. Returns the number of pending ones.
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

    /// Appends a value. Returns false if it does not fit.
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
