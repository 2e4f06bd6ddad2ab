//! Requests that are with the arm: whose they are, what answers them, and from when on an answer is missing.

use crate::{Duration, Instant};
use armwire::alpha1::Expect;
use heapless::Vec;

use crate::arm::{Asked, Key, UNASKED};
use crate::control::Initiator;
use crate::earliest::Earliest;

/// Requests that are remembered at a time. Only the host on USB can send one before the last is answered.
const FLIGHTS: usize = 8;

/// Kinds of requests besides, of which only the number is remembered.
const KINDS: usize = 8;

/// Kinds of missing answers that are remembered at a time: as many as can be with the arm.
const OWED: usize = FLIGHTS + KINDS;

/// How long after it was due an answer may still come.
pub(crate) const LATENESS: Duration = Duration::from_millis(50);

/// The requests of one initiator, of which the arm has answered none yet.
pub(crate) struct Exchange {
    initiator: Initiator,
    /// In the order in which they were sent.
    flights: Vec<Flight, FLIGHTS>,
    /// Those that were sent besides, by what answers them, and how many of still other kinds.
    more: Vec<More, KINDS>,
    others: u32,
    /// The longest that the arm may take for one of those.
    more_patience: Duration,
    /// When all answers that are still missing are given up.
    due: Instant,
    /// In the order in which they were given up.
    owed: Vec<Owed, OWED>,
    /// Until when an answer of any kind may still be late: more kinds were missing than are remembered.
    saturated: Instant,
}

/// A request that is with the arm.
#[derive(Clone, Copy)]
struct Flight {
    key: Key,
    expect: Expect,
    patience: Duration,
    /// When its last byte is out.
    sent: Instant,
}

/// Requests that are with the arm and of which not more is remembered.
#[derive(Clone, Copy)]
struct More {
    key: Key,
    count: u32,
}

/// Answers of a kind that were missing and may still come.
#[derive(Clone, Copy)]
struct Owed {
    key: Key,
    count: u32,
    until: Instant,
}

/// What a frame of the arm turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Heard {
    /// The answer to a request of this initiator, so long after it, if that is remembered.
    Answer(Initiator, Option<Duration>),
    /// The answer to a request that was given up.
    Late,
    /// Nobody has asked for it.
    Unasked,
}

impl Exchange {
    pub(crate) const fn new() -> Self {
        Self {
            initiator: Initiator::Adapter,
            flights: Vec::new(),
            more: Vec::new(),
            others: 0,
            more_patience: Duration::ZERO,
            due: Instant::ZERO,
            owed: Vec::new(),
            saturated: Instant::ZERO,
        }
    }

    /// Whose requests are with the arm. `None` when the arm owes nobody an answer.
    pub(crate) fn holder(&self) -> Option<Initiator> {
        (self.open() > 0).then_some(self.initiator)
    }

    /// Whether somebody else than the host on USB holds the line: what the arm says is held back until it is known whose
    /// it is.
    pub(crate) fn is_not_usbs(&self) -> bool {
        self.holder().is_some_and(|holder| holder != Initiator::Usb)
    }

    /// How many answers the arm owes whoever holds the line.
    fn open(&self) -> usize {
        if !self.has_more() {
            return self.flights.len();
        }
        let more = self.more.iter().map(|more| more.count);
        let more = more.fold(self.others, u32::saturating_add);
        self.flights.len().saturating_add(more as usize)
    }

    /// A request that the arm answers within `patience` went out, the last byte of it at `sent`.
    ///
    /// Of several initiators only after those of the one before have ended.
    pub(crate) fn begin(&mut self, initiator: Initiator, asked: Asked, sent: Instant, patience: Duration) {
        self.due = match self.holder() {
            Some(_) => self.due.max(sent + patience),
            None => sent + patience,
        };
        self.initiator = initiator;
        let flight = Flight {
            key: asked.key,
            expect: asked.expect,
            patience,
            sent,
        };
        if self.flights.push(flight).is_err() {
            self.more_patience = match self.has_more() {
                true => self.more_patience.max(patience),
                false => patience,
            };
            self.remember_one_more(asked.key);
        }
    }

    // Seldom needed, and not worth the room in those who need it.
    #[inline(never)]
    fn remember_one_more(&mut self, key: Key) {
        let known = self.more.iter_mut().find(|more| more.key == key);
        let refused = match known {
            Some(more) => {
                more.count = more.count.saturating_add(1);
                false
            }
            None => self.more.push(More { key, count: 1 }).is_err(),
        };
        if refused {
            self.others = self.others.saturating_add(1);
        }
    }

    /// Whether more requests are with the arm than are remembered one by one.
    fn has_more(&self) -> bool {
        !self.more.is_empty() || self.others > 0
    }

    /// What the arm may say next.
    pub(crate) fn expect(&self) -> Expect {
        self.flights.first().map_or(UNASKED, |flight| flight.expect)
    }

    /// The arm said a frame with this key, the first byte of which was in at `began` and the last at `now`. It is `fresh`
    /// if all of it came after the last request was handed over.
    pub(crate) fn hear(&mut self, key: Option<Key>, fresh: bool, began: Instant, now: Instant) -> Heard {
        let Some(key) = key else { return Heard::Unasked };
        // An arm answers in turn: the oldest request of the kind is the one that was given up.
        if let Some(owed) = self.owed.iter_mut().find(|owed| owed.key == key) {
            owed.count = owed.count.saturating_sub(1);
            self.owed.retain(|owed| owed.count > 0);
            return Heard::Late;
        }
        let mut answered = None;
        if fresh {
            self.flights.retain(|flight| {
                // The last byte of the request may have been on its way until then.
                let answers = answered.is_none() && flight.key == key && flight.sent <= began;
                if answers {
                    answered = Some(Some(flight.sent));
                }
                !answers
            });
            if answered.is_none() && self.has_more() && self.answers_one_of_more(key) {
                answered = Some(None);
            }
        }
        let Some(sent) = answered else { return Heard::Unasked };
        // An arm answers one after the other: those behind this one have their time from now on.
        let more = self.has_more().then_some(self.more_patience);
        for patience in self.flights.iter().map(|flight| flight.patience).chain(more) {
            self.due = self.due.max(now + patience);
        }
        Heard::Answer(self.initiator, sent.map(|sent| now.since(sent)))
    }

    /// Whether a frame with this key answers a request that is not remembered by itself, which it then has.
    #[inline(never)]
    fn answers_one_of_more(&mut self, key: Key) -> bool {
        if let Some(more) = self.more.iter_mut().find(|more| more.key == key) {
            more.count = more.count.saturating_sub(1);
            self.more.retain(|more| more.count > 0);
            return true;
        }
        // Of what kind the others are is not known.
        let others = self.others;
        self.others = others.saturating_sub(1);
        others > 0
    }

    /// Whether a request with this key must wait, because its answer could not be told from one that was given up.
    pub(crate) fn is_owed(&self, key: Key) -> bool {
        self.saturated > Instant::ZERO || self.owed.iter().any(|owed| owed.key == key)
    }

    /// Whether no answer was given up that may still come.
    pub(crate) fn owes_nothing(&self) -> bool {
        self.owed.is_empty() && self.saturated == Instant::ZERO
    }

    /// When to call [`tick`](Self::tick), unless something happens before.
    pub(crate) fn timeout(&self) -> Option<Instant> {
        let owed = self.owed.iter().map(|owed| owed.until).min();
        let saturated = Some(self.saturated).filter(|until| *until > Instant::ZERO);
        Earliest::of(owed)
            .or(saturated)
            .or(self.holder().map(|_| self.due))
            .get()
    }

    /// It is `now`: how many answers are given up.
    pub(crate) fn tick(&mut self, now: Instant) -> usize {
        // Nearly always there is nothing to look after.
        if self.owes_nothing() && self.holder().is_none() {
            return 0;
        }
        let missing = match self.holder() {
            Some(_) if now >= self.due => self.give_up(),
            _ => 0,
        };
        self.owed.retain(|owed| now < owed.until);
        if self.saturated <= now {
            self.saturated = Instant::ZERO;
        }
        missing
    }

    /// Remembers that the answers are missing that were waited for, and returns how many.
    #[inline(never)]
    fn give_up(&mut self) -> usize {
        let until = self.due + LATENESS;
        let missing = self.open();
        let flights = self.flights.iter().map(|flight| (flight.key, 1));
        for (key, count) in flights.chain(self.more.iter().map(|more| (more.key, more.count))) {
            if let Some(owed) = self.owed.iter_mut().find(|owed| owed.key == key) {
                (owed.count, owed.until) = (owed.count.saturating_add(count), until);
            } else if self.owed.push(Owed { key, count, until }).is_err() {
                // None of those remembered is forgotten for it: then any may be late.
                self.saturated = until;
            }
        }
        if self.others > 0 {
            self.saturated = until;
        }
        self.forget();
        missing
    }

    fn forget(&mut self) {
        self.flights.clear();
        self.more.clear();
        self.others = 0;
    }

    /// Nothing that was asked is waited for any more: how many answers are given up.
    pub(crate) fn abandon(&mut self) -> usize {
        let missing = self.open();
        self.forget();
        self.owed.clear();
        self.saturated = Instant::ZERO;
        missing
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::config::ArmKind;

    const MILLISECOND: Duration = Duration::from_millis(1);
    const SECOND: Duration = Duration::from_millis(1_000);

    fn after(span: Duration) -> Instant {
        Instant::ZERO + span
    }

    /// A request that Ling's arm answers with `function`.
    fn asked(function: u8) -> Asked {
        ArmKind::Ling.asked(&[0xAA, 0x06, function, 1, 0xFE, 0, 0xFF])
    }

    fn answer(exchange: &mut Exchange, function: u8, now: Instant) -> Heard {
        exchange.hear(Some(asked(function).key), true, now, now)
    }

    #[test]
    fn the_patience_for_many_requests_ends_with_them() {
        let mut exchange = Exchange::new();
        for _ in 0..=FLIGHTS {
            exchange.begin(Initiator::Usb, asked(0), Instant::ZERO, SECOND);
        }
        for _ in 0..=FLIGHTS {
            assert!(matches!(
                answer(&mut exchange, 0, after(MILLISECOND)),
                Heard::Answer(..)
            ));
        }
        assert_eq!((exchange.holder(), exchange.timeout()), (None, None));

        exchange.begin(Initiator::Can, asked(0), after(SECOND), MILLISECOND);
        assert_eq!(answer(&mut exchange, 2, after(SECOND)), Heard::Unasked);
        assert_eq!(exchange.timeout(), Some(after(SECOND) + MILLISECOND));
    }

    #[test]
    fn each_of_many_requests_is_answered_once_whatever_they_ask() {
        let mut exchange = Exchange::new();
        for n in 0..20 {
            exchange.begin(Initiator::Usb, asked(n), Instant::ZERO, SECOND);
        }
        for n in 0..20 {
            assert_eq!(exchange.holder(), Some(Initiator::Usb));
            assert!(matches!(
                answer(&mut exchange, n, after(MILLISECOND)),
                Heard::Answer(Initiator::Usb, _)
            ));
        }
        assert_eq!(exchange.holder(), None);
        for n in 0..20 {
            assert_eq!(answer(&mut exchange, n, after(MILLISECOND)), Heard::Unasked);
        }
    }

    #[test]
    fn a_late_answer_is_late_once_and_only_for_its_own_request() {
        let mut exchange = Exchange::new();
        exchange.begin(Initiator::Usb, asked(0), Instant::ZERO, MILLISECOND);
        exchange.begin(Initiator::Usb, asked(2), Instant::ZERO, MILLISECOND);
        assert_eq!(exchange.tick(after(MILLISECOND)), 2);
        assert_eq!(answer(&mut exchange, 0, after(MILLISECOND)), Heard::Late);
        assert_eq!(answer(&mut exchange, 0, after(MILLISECOND)), Heard::Unasked);
        assert_eq!(answer(&mut exchange, 2, after(MILLISECOND)), Heard::Late);
        assert!(exchange.owes_nothing());
    }

    #[test]
    fn what_is_abandoned_is_counted_and_owed_no_more() {
        let mut exchange = Exchange::new();
        assert_eq!(exchange.abandon(), 0);
        for n in 0..20 {
            exchange.begin(Initiator::Usb, asked(n), Instant::ZERO, SECOND);
        }
        assert_eq!(exchange.abandon(), 20);
        assert_eq!((exchange.holder(), exchange.timeout()), (None, None));
        assert_eq!(answer(&mut exchange, 0, after(SECOND)), Heard::Unasked);
    }

    #[test]
    fn as_many_answers_are_late_as_were_missing() {
        let mut exchange = Exchange::new();
        for _ in 0..2 {
            exchange.begin(Initiator::Usb, asked(0), Instant::ZERO, MILLISECOND);
        }
        assert_eq!(exchange.tick(after(MILLISECOND)), 2);
        exchange.begin(Initiator::Usb, asked(1), after(MILLISECOND), MILLISECOND);
        assert_eq!(exchange.tick(Instant::from_micros(2_000)), 1);
        for _ in 0..2 {
            assert!(exchange.is_owed(asked(0).key));
            assert_eq!(answer(&mut exchange, 0, Instant::from_micros(3_000)), Heard::Late);
        }
        assert_eq!(answer(&mut exchange, 0, Instant::from_micros(3_000)), Heard::Unasked);
        assert!(exchange.is_owed(asked(1).key));
    }
}
