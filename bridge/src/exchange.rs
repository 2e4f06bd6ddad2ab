//! Requests that are with the arm: whose they are, what answers them, and from when on an answer is missing.

use armwire::Micros;
use armwire::alpha1::Expect;

use crate::arm::{Asked, Key, UNASKED};
use crate::control::Asker;
use crate::earliest::earliest;

/// Requests that are remembered at a time. Only the host on USB can send one before the last is answered.
const FLIGHTS: usize = 8;

/// Missing answers that are remembered at a time.
const OWED: usize = 4;

/// How long after it was due an answer may still come.
pub(crate) const LATENESS: Micros = Micros::from_millis(50);

/// The requests of one asker, of which the arm has answered none yet.
pub(crate) struct Exchange {
    asker: Asker,
    flights: [Option<Flight>; FLIGHTS],
    /// How many there are.
    open: u8,
    /// More were sent than are remembered: nobody else may use the line until no answer can come any more.
    more: Option<Micros>,
    /// When all answers that are still missing are given up.
    due: Micros,
    owed: [Option<Owed>; OWED],
}

/// A request that is with the arm.
#[derive(Clone, Copy)]
struct Flight {
    key: Key,
    expect: Expect,
    patience: Micros,
    /// When its last byte is out.
    sent: Micros,
}

/// An answer that was missing and may still come.
#[derive(Clone, Copy)]
struct Owed {
    key: Key,
    until: Micros,
}

/// What a frame of the arm turned out to be.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Heard {
    /// The answer to a request of this asker, so long after it.
    Answer(Asker, Micros),
    /// The answer to a request that was given up.
    Late,
    /// Nobody has asked for it.
    Unasked,
}

impl Exchange {
    pub(crate) const fn new() -> Self {
        Self {
            asker: Asker::Adapter,
            flights: [None; FLIGHTS],
            open: 0,
            more: None,
            due: Micros(0),
            owed: [None; OWED],
        }
    }

    /// Whose requests are with the arm. `None` when the arm owes nobody an answer.
    pub(crate) fn holder(&self) -> Option<Asker> {
        (self.open > 0 || self.more.is_some()).then_some(self.asker)
    }

    /// A request that the arm answers within `patience` went out, the last byte of it at `sent`.
    ///
    /// Of several askers only after those of the one before have ended.
    pub(crate) fn begin(&mut self, asker: Asker, asked: Asked, sent: Micros, patience: Micros) {
        self.due = match self.holder() {
            Some(_) => self.due.max(sent + patience),
            None => sent + patience,
        };
        self.asker = asker;
        match self.flights.iter_mut().find(|flight| flight.is_none()) {
            Some(place) => {
                self.open = self.open.saturating_add(1);
                *place = Some(Flight {
                    key: asked.key,
                    expect: asked.expect,
                    patience,
                    sent,
                });
            }
            None => self.more = self.more.max(Some(patience)),
        }
    }

    /// What the arm may say next.
    pub(crate) fn expect(&self) -> Expect {
        let first = self.flights.iter().flatten().min_by_key(|flight| flight.sent);
        first.map_or(UNASKED, |flight| flight.expect)
    }

    /// The arm said a frame with this key, which ended at `now`. It is `fresh` if all of it came after the last request was
    /// handed over.
    pub(crate) fn hear(&mut self, key: Option<Key>, fresh: bool, now: Micros) -> Heard {
        let Some(key) = key else { return Heard::Unasked };
        let answered = |flight: &&mut Option<Flight>| {
            flight.is_some_and(|flight| fresh && flight.key == key && flight.sent <= now)
        };
        let answered = self.flights.iter_mut().filter(answered);
        if let Some(flight) = answered.min_by_key(|flight| flight.map(|flight| flight.sent)) {
            let sent = flight.take().map_or(now, |flight| flight.sent);
            self.open = self.open.saturating_sub(1);
            // An arm answers one after the other.
            let rest = self.flights.iter().flatten().map(|flight| flight.patience);
            for patience in rest.chain(self.more) {
                self.due = self.due.max(now + patience);
            }
            return Heard::Answer(self.asker, now.since(sent));
        }
        if let Some(patience) = self.more {
            self.due = self.due.max(now + patience);
        }
        match self
            .owed
            .iter_mut()
            .find(|owed| owed.is_some_and(|owed| owed.key == key))
        {
            Some(owed) => {
                *owed = None;
                Heard::Late
            }
            None => Heard::Unasked,
        }
    }

    /// Whether a request with this key must wait, because its answer could not be told from one that was given up.
    pub(crate) fn is_owed(&self, key: Key) -> bool {
        self.owed.iter().flatten().any(|owed| owed.key == key)
    }

    /// When to call [`tick`](Self::tick), unless something happens before.
    pub(crate) fn timeout(&self) -> Option<Micros> {
        let [a, b, c, d] = self.owed.map(|owed| owed.map(|owed| owed.until));
        earliest(&[self.holder().map(|_| self.due), a, b, c, d])
    }

    /// It is `now`: how many answers are given up.
    pub(crate) fn tick(&mut self, now: Micros) -> usize {
        for owed in &mut self.owed {
            let _ = owed.take_if(|owed| owed.until <= now);
        }
        if self.holder().is_none() || now < self.due {
            return 0;
        }
        (self.open, self.more) = (0, None);
        let until = self.due + LATENESS;
        let mut missing = 0;
        for flight in self.flights.iter_mut().filter_map(Option::take) {
            missing += 1;
            let key = flight.key;
            // The place of the same, a free one, or the oldest.
            let rank = |owed: &&mut Option<Owed>| match owed {
                Some(owed) if owed.key == key => None,
                owed => Some(owed.map(|owed| owed.until)),
            };
            if let Some(place) = self.owed.iter_mut().min_by_key(rank) {
                *place = Some(Owed { key, until });
            }
        }
        missing
    }

    /// Nothing that was asked is waited for any more.
    pub(crate) fn abandon(&mut self) -> usize {
        self.due = Micros(0);
        let missing = self.tick(Micros(0));
        self.owed = [None; OWED];
        missing
    }
}
