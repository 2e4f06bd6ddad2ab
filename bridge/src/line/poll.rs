//! The slots of the adapter's own poll.

use crate::config;
use armwire::time::{Duration, Instant};

/// How long before its slot a poll is handed over, so that nothing else that runs makes it late.
pub const POLL_LEAD_TIME: Duration = Duration::from_micros(25);

/// Says when it is time for a poll.
///
/// The slots of a poll at a set rate are a fixed grid: the n-th is n periods after polling was switched on, each
/// rounded down to a microsecond by itself, so that no error adds up.
pub(crate) struct Poll {
    rate: config::Poll,
    /// The next slot. `None` until the time is known.
    slot: Option<Instant>,
    /// What was rounded off there, in parts of a microsecond of which `rate` make a whole one.
    rest: u32,
    state: State,
    is_paused: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// The next slot has not come.
    Early,
    /// It is time, since then.
    Due(Instant),
    /// The poll is with the arm.
    InFlight,
}

impl Poll {
    pub(crate) const fn new(rate: config::Poll) -> Self {
        Self {
            rate,
            slot: None,
            rest: 0,
            state: State::Early,
            is_paused: false,
        }
    }

    /// Since when the next poll may go out, [`POLL_LEAD_TIME`] before its slot. `None` while it may not.
    pub(crate) fn due_since(&self, now: Instant) -> Option<Instant> {
        match self.state {
            _ if self.is_paused => None,
            State::Due(since) => Some(since),
            _ => self.timeout().filter(|at| *at <= now),
        }
    }

    /// Whether it is more urgent than what others have to ask.
    pub(crate) const fn is_urgent(&self) -> bool {
        matches!(self.rate, config::Poll::Hertz(_))
    }

    /// Whether there are no polls.
    pub(crate) const fn is_off(&self) -> bool {
        matches!(self.rate, config::Poll::Off)
    }

    /// The next slot. `None` without a rate, or when polling has not begun.
    pub(crate) const fn slot(&self) -> Option<Instant> {
        self.slot
    }

    /// The slot a period after this one. `None` without a rate.
    fn after(&mut self, slot: Instant) -> Option<Instant> {
        let config::Poll::Hertz(rate) = self.rate else {
            return None;
        };
        let rate = u32::from(rate);
        let period = SECOND.checked_div(rate)?;
        self.rest = self.rest.saturating_add(SECOND.checked_rem(rate)?);
        let carry = self.rest >= rate;
        if carry {
            self.rest = self.rest.saturating_sub(rate);
        }
        Some(slot + Duration::from_micros(period.saturating_add(carry.into()).into()))
    }

    /// When to call [`tick`](Self::tick).
    pub(crate) fn timeout(&self) -> Option<Instant> {
        match (self.rate, self.state) {
            (config::Poll::Off, _) | (_, State::Due(_) | State::InFlight) => None,
            _ => Some(self.slot.map_or(Instant::ZERO, |slot| slot - POLL_LEAD_TIME)),
        }
    }

    /// It is `now`. Returns how many slots have passed in a [pause](Self::pause).
    pub(crate) fn tick(&mut self, now: Instant) -> usize {
        if self.timeout().is_none() {
            return 0;
        }
        if self.slot.is_none() {
            self.slot = self.after(now);
        }
        if let Some(at) = self.timeout().filter(|at| *at <= now) {
            self.state = State::Due(at);
        }
        match self.is_paused {
            true => self.miss(now),
            false => 0,
        }
    }

    /// From here on no poll goes out, or polls go out again. Returns how many slots have passed by that.
    pub(crate) fn pause(&mut self, pause: bool, now: Instant) -> usize {
        self.is_paused = pause;
        match pause {
            true => self.miss(now),
            false => 0,
        }
    }

    /// Passes over the slot of a poll at a set rate that may not go out, and those up to `now`. Returns how many.
    fn miss(&mut self, now: Instant) -> usize {
        if !self.is_urgent() || !matches!(self.state, State::Due(_)) {
            return 0;
        }
        self.began();
        self.ended(now).saturating_add(1)
    }

    /// The poll went out.
    pub(crate) fn began(&mut self) {
        self.state = State::InFlight;
    }

    /// It was answered or given up. Returns how many slots have passed since its own.
    pub(crate) fn ended(&mut self, now: Instant) -> usize {
        if self.state != State::InFlight {
            return 0;
        }
        self.state = State::Early;
        let mut missed = 0_usize;
        while let Some(slot) = self.slot {
            self.slot = self.after(slot);
            if self.slot >= Some(now) {
                return missed;
            }
            missed = missed.saturating_add(1);
        }
        self.state = State::Due(now);
        0
    }
}

const SECOND: u32 = 1_000_000;

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Instant = Instant::ZERO;
    const SECOND: u64 = super::SECOND as u64;

    /// The slots of a day, each poll answered after `answer` µs, and how many were missed.
    fn day(rate: u16, answer: u64) -> impl Iterator<Item = (Instant, u64)> {
        let mut poll = Poll::new(config::Poll::Hertz(rate));
        poll.tick(Instant::from_micros(777));
        core::iter::from_fn(move || {
            let slot = poll.slot()?;
            poll.tick(slot);
            assert!(poll.due_since(NOW).is_some());
            poll.began();
            Some((slot, poll.ended(slot + Duration::from_micros(answer)) as u64))
        })
        .take_while(|(slot, _)| slot.as_micros() <= 777 + 86_400 * SECOND)
    }

    #[test]
    fn slots_are_exact_for_a_day() {
        // At the higher rates answers take a second, so that the day has fewer polls than slots.
        for (rate, answer, step) in [(1, 400, 1), (7, 400, 1), (300, SECOND, 300), (1_000, SECOND, 1_000)] {
            let mut number = 1;
            for (slot, missed) in day(rate, answer) {
                assert_eq!(
                    (slot.as_micros(), missed),
                    (777 + number * SECOND / u64::from(rate), step - 1)
                );
                number += step;
            }
            assert_eq!(number, 86_400 * u64::from(rate) + 1);
        }
    }

    #[test]
    fn a_slot_that_passes_before_the_answer_is_missed_and_the_grid_stays() {
        // 300 Hz: a slot each 3333.3 µs, and an answer after 10 000 µs, when the third one after has just come.
        for (k, (slot, missed)) in day(300, 10_000).take(1_000).enumerate() {
            assert_eq!((slot.as_micros(), missed), (777 + (1 + 3 * k as u64) * SECOND / 300, 2));
        }
        // One microsecond later it is missed, too.
        assert!(day(300, 10_001).take(1_000).all(|(_, missed)| missed == 3));
    }

    #[test]
    fn the_fastest_poll_is_due_whenever_none_is_with_the_arm() {
        let mut poll = Poll::new(config::Poll::Fastest);
        assert_eq!(poll.timeout(), Some(Instant::ZERO));
        poll.tick(Instant::from_micros(5));
        for at in [10, 11, 12] {
            assert!(poll.due_since(NOW).is_some());
            assert_eq!((poll.slot(), poll.timeout()), (None, None));
            poll.began();
            assert_eq!(poll.due_since(NOW), None);
            assert_eq!(poll.ended(Instant::from_micros(at)), 0);
        }
    }

    #[test]
    fn nothing_is_polled_when_polling_is_off() {
        let mut poll = Poll::new(config::Poll::Off);
        poll.tick(Instant::from_micros(5));
        assert_eq!((poll.due_since(NOW), poll.timeout()), (None, None));
    }
}
