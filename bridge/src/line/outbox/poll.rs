//! The slots of the adapter's own poll.

use crate::config;
use armwire::time::{Duration, Instant};

/// Lead time of a poll over its slot, unless a board [sets](crate::Bridge::set_poll_lead_time) its own: no other task
/// can then make it late.
pub const POLL_LEAD_TIME: Duration = Duration::from_micros(25);

/// The poll clock.
///
/// The slots of a poll at a set rate are a fixed grid: the n-th is n periods after the start of polling. Each is
/// rounded down to a microsecond on its own. Rounding errors do not accumulate.
pub(crate) struct Poll {
    rate: config::Poll,
    /// Lead time over a slot.
    lead: Duration,
    /// The next slot. `None` until the time is known.
    slot: Option<Instant>,
    /// The rounding remainder of that slot, in units of 1/`rate` µs.
    rest: u32,
    state: State,
    is_paused: bool,
}

#[derive(Clone, Copy, PartialEq, Eq)]
enum State {
    /// The next slot is in the future.
    Early,
    /// The slot has come, at this time.
    Due(Instant),
    /// The poll is in flight.
    InFlight,
}

impl Poll {
    pub(crate) const fn new(rate: config::Poll, lead: Duration) -> Self {
        Self {
            rate,
            lead,
            slot: None,
            rest: 0,
            state: State::Early,
            is_paused: false,
        }
    }

    pub(crate) const fn lead(&self) -> Duration {
        self.lead
    }

    pub(crate) const fn set_lead(&mut self, lead: Duration) {
        self.lead = lead;
    }

    /// The time since which the next poll may go out, the lead time before its slot. `None` if it may not.
    pub(crate) fn due_since(&self, now: Instant) -> Option<Instant> {
        match self.state {
            _ if self.is_paused => None,
            State::Due(since) => Some(since),
            _ => self.timeout().filter(|at| *at <= now),
        }
    }

    /// Returns true for a poll at a set rate: it goes before the requests of others.
    pub(crate) const fn is_urgent(&self) -> bool {
        matches!(self.rate, config::Poll::Hertz(_))
    }

    /// Returns true if each poll follows the answer to the last one.
    pub(crate) const fn follows_answers(&self) -> bool {
        matches!(self.rate, config::Poll::Fastest) && !self.is_paused
    }

    pub(crate) const fn is_off(&self) -> bool {
        matches!(self.rate, config::Poll::Off)
    }

    /// The next slot. `None` without a rate, or before polling begins.
    pub(crate) const fn slot(&self) -> Option<Instant> {
        self.slot
    }

    /// The slot one period later. `None` without a rate.
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

    /// The time of the next [`tick`](Self::tick).
    pub(crate) fn timeout(&self) -> Option<Instant> {
        match (self.rate, self.state) {
            (config::Poll::Off, _) | (_, State::Due(_) | State::InFlight) => None,
            _ => Some(self.slot.map_or(Instant::ZERO, |slot| slot - self.lead)),
        }
    }

    /// Advances the time to `now`. Returns the number of slots that have passed in a [pause](Self::pause).
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

    /// Pauses or resumes polling. Returns the number of slots that this skips.
    pub(crate) fn pause(&mut self, pause: bool, now: Instant) -> usize {
        self.is_paused = pause;
        match pause {
            true => self.miss(now),
            false => 0,
        }
    }

    /// Skips the due slot of a poll at a set rate, and all slots up to `now`. Returns their number.
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

    /// The poll was answered or timed out. Returns the number of slots that have passed since its own.
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

    /// The slots of a day, each poll answered after `answer` µs, and the number of missed slots.
    fn day(rate: u16, answer: u64) -> impl Iterator<Item = (Instant, u64)> {
        let mut poll = Poll::new(config::Poll::Hertz(rate), POLL_LEAD_TIME);
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
        // At the higher rates answers take a second: the day has fewer polls than slots.
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
    fn slot_before_answer_is_missed_and_grid_stays() {
        // 300 Hz: a slot every 3333.3 µs, and an answer after 10 000 µs, exactly at the third slot after its own.
        for (k, (slot, missed)) in day(300, 10_000).take(1_000).enumerate() {
            assert_eq!((slot.as_micros(), missed), (777 + (1 + 3 * k as u64) * SECOND / 300, 2));
        }
        // One microsecond later that slot is missed, too.
        assert!(day(300, 10_001).take(1_000).all(|(_, missed)| missed == 3));
    }

    #[test]
    fn fastest_poll_is_due_without_poll_in_flight() {
        let mut poll = Poll::new(config::Poll::Fastest, POLL_LEAD_TIME);
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
        let mut poll = Poll::new(config::Poll::Off, POLL_LEAD_TIME);
        poll.tick(Instant::from_micros(5));
        assert_eq!((poll.due_since(NOW), poll.timeout()), (None, None));
    }
}
