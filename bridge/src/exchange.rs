//! Requests that are with the arm: whose they are, what answers them, and from when on an answer is missing.

use armwire::Micros;
use armwire::alpha1::Expect;
use heapless::Vec;

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
    /// In the order in which they were sent.
    flights: Vec<Flight, FLIGHTS>,
    /// How many were sent besides, and the longest that the arm may take for one of them.
    more: u32,
    more_patience: Micros,
    /// When all answers that are still missing are given up.
    due: Micros,
    owed: Vec<Owed, OWED>,
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
    /// The answer to a request of this asker, so long after it, if that is remembered.
    Answer(Asker, Option<Micros>),
    /// The answer to a request that was given up.
    Late,
    /// Nobody has asked for it.
    Unasked,
}

impl Exchange {
    pub(crate) const fn new() -> Self {
        Self {
            asker: Asker::Adapter,
            flights: Vec::new(),
            more: 0,
            more_patience: Micros(0),
            due: Micros(0),
            owed: Vec::new(),
        }
    }

    /// Whose requests are with the arm. `None` when the arm owes nobody an answer.
    pub(crate) fn holder(&self) -> Option<Asker> {
        (self.open() > 0).then_some(self.asker)
    }

    /// Whether somebody else than the host on USB holds the line: what the arm says is held back until it is known whose
    /// it is.
    pub(crate) fn is_not_usbs(&self) -> bool {
        self.holder().is_some_and(|holder| holder != Asker::Usb)
    }

    /// How many answers the arm owes whoever holds the line.
    fn open(&self) -> usize {
        self.flights.len().saturating_add(self.more as usize)
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
        let flight = Flight {
            key: asked.key,
            expect: asked.expect,
            patience,
            sent,
        };
        if self.flights.push(flight).is_err() {
            self.more_patience = match self.more {
                0 => patience,
                _ => self.more_patience.max(patience),
            };
            self.more = self.more.saturating_add(1);
        }
    }

    /// What the arm may say next.
    pub(crate) fn expect(&self) -> Expect {
        self.flights.first().map_or(UNASKED, |flight| flight.expect)
    }

    /// The arm said a frame with this key, which ended at `now`. It is `fresh` if all of it came after the last request
    /// was handed over.
    pub(crate) fn hear(&mut self, key: Option<Key>, fresh: bool, now: Micros) -> Heard {
        let Some(key) = key else { return Heard::Unasked };
        let mut answered = None;
        if fresh {
            self.flights.retain(|flight| {
                let answers = answered.is_none() && flight.key == key && flight.sent <= now;
                if answers {
                    answered = Some(Some(flight.sent));
                }
                !answers
            });
            // What answers none of those that are remembered answers one of the others.
            if answered.is_none() && self.more > 0 {
                self.more = self.more.saturating_sub(1);
                answered = Some(None);
            }
        }
        // An arm answers one after the other: those behind this one have their time from now on.
        let behind = self.flights.iter().filter(|_| answered.is_some());
        let more = (self.more > 0).then_some(self.more_patience);
        for patience in behind.map(|flight| flight.patience).chain(more) {
            self.due = self.due.max(now + patience);
        }
        if let Some(sent) = answered {
            return Heard::Answer(self.asker, sent.map(|sent| now.since(sent)));
        }
        match self.is_owed(key) {
            true => {
                self.owed.retain(|owed| owed.key != key);
                Heard::Late
            }
            false => Heard::Unasked,
        }
    }

    /// Whether a request with this key must wait, because its answer could not be told from one that was given up.
    pub(crate) fn is_owed(&self, key: Key) -> bool {
        self.owed.iter().any(|owed| owed.key == key)
    }

    /// Whether no answer was given up that may still come.
    pub(crate) fn owes_nothing(&self) -> bool {
        self.owed.is_empty()
    }

    /// When to call [`tick`](Self::tick), unless something happens before.
    pub(crate) fn timeout(&self) -> Option<Micros> {
        // What is owed first ends first.
        let owed = self.owed.first().map(|owed| owed.until);
        earliest(&[owed, self.holder().map(|_| self.due)])
    }

    /// It is `now`: how many answers are given up.
    pub(crate) fn tick(&mut self, now: Micros) -> usize {
        // Nearly always there is nothing to look after.
        if self.owed.is_empty() && self.holder().is_none() {
            return 0;
        }
        let missing = match self.holder() {
            Some(_) if now >= self.due => self.give_up(),
            _ => 0,
        };
        self.owed.retain(|owed| now < owed.until);
        missing
    }

    /// Remembers that the answers are missing that were waited for, and returns how many.
    fn give_up(&mut self) -> usize {
        let until = self.due + LATENESS;
        let missing = self.open();
        for flight in &self.flights {
            let oldest = self.owed.first().filter(|_| self.owed.is_full()).map(|owed| owed.key);
            self.owed
                .retain(|owed| owed.key != flight.key && Some(owed.key) != oldest);
            // There is room.
            let _ = self.owed.push(Owed { key: flight.key, until });
        }
        self.flights.clear();
        self.more = 0;
        missing
    }

    /// Nothing that was asked is waited for any more: how many answers are given up.
    pub(crate) fn abandon(&mut self) -> usize {
        let missing = self.open();
        self.flights.clear();
        self.owed.clear();
        self.more = 0;
        missing
    }
}
