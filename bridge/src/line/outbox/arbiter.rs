//! The order of turns on the line to the arm.

use crate::control::Initiator;
use armwire::time::{Duration, Instant};

/// The time after another initiator's turn during which the line counts as shared.
const SHARED_TIME: Duration = Duration::from_millis(1_000);

/// An initiator that is ready for a turn.
#[derive(Clone, Copy)]
pub(crate) struct Contender {
    /// The start of its wait.
    pub(crate) since: Instant,
    /// True if it goes before all others, except for those that it has passed over before.
    pub(crate) is_urgent: bool,
}

/// The history of turns.
pub(crate) struct Arbiter {
    last: Initiator,
    /// The last initiator in the rotation. An urgent poll is not part of it.
    rotated: Initiator,
    /// Start of the last urgent turn.
    urgent_at: Instant,
    /// The last turn of an initiator other than the host on USB.
    others_had: Option<Instant>,
}

impl Arbiter {
    pub(crate) const fn new() -> Self {
        Self {
            last: Initiator::Adapter,
            rotated: Initiator::Adapter,
            urgent_at: Instant::ZERO,
            others_had: None,
        }
    }

    /// Returns true if an initiator other than the host on USB had the line recently.
    pub(crate) fn is_shared(&self, now: Instant) -> bool {
        self.others_had.is_some_and(|at| now.since(at) < SHARED_TIME)
    }

    /// The initiator with the next turn, of these contenders in the order of [`Initiator::ALL`].
    pub(crate) fn next(&self, contenders: &[Option<Contender>; Initiator::ALL.len()]) -> Option<Initiator> {
        let of = |initiator: Initiator| contenders.get(initiator as usize).copied().flatten();
        let is_urgent = |initiator: &Initiator| of(*initiator).is_some_and(|contender| contender.is_urgent);
        let was_passed_over = |contender: &Contender| !contender.is_urgent && contender.since <= self.urgent_at;
        let urgent = Initiator::ALL.into_iter().find(is_urgent);
        if urgent.is_some() && !(Some(self.last) == urgent && contenders.iter().flatten().any(was_passed_over)) {
            return urgent;
        }
        let mut initiator = self.rotated;
        for _ in Initiator::ALL {
            initiator = behind(initiator);
            if Some(initiator) != urgent && of(initiator).is_some() {
                return Some(initiator);
            }
        }
        None
    }

    /// Bytes outside of requests, for example zeros, went out for an initiator.
    pub(crate) const fn sent_raw(&mut self, initiator: Initiator) {
        self.last = initiator;
    }

    /// An initiator took its turn at this time. An urgent turn does not advance the rotation.
    pub(crate) fn taken(&mut self, initiator: Initiator, is_urgent: bool, at: Instant) {
        self.last = initiator;
        if is_urgent {
            self.urgent_at = at;
        } else {
            self.rotated = initiator;
        }
        if initiator != Initiator::Usb {
            self.others_had = Some(at);
        }
    }
}

/// The initiator whose turn comes after that of `initiator`.
const fn behind(initiator: Initiator) -> Initiator {
    match initiator {
        Initiator::Usb => Initiator::Can,
        Initiator::Can => Initiator::Poll,
        Initiator::Poll => Initiator::Command,
        Initiator::Command => Initiator::Adapter,
        Initiator::Adapter => Initiator::Usb,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const NOW: Instant = Instant::from_micros(100);

    /// Contenders from initiators, the start of their wait in µs, and their urgency.
    fn contenders(list: &[(Initiator, u64, bool)]) -> [Option<Contender>; Initiator::ALL.len()] {
        Initiator::ALL.map(|initiator| {
            let (_, since, is_urgent) = *list.iter().find(|(of, ..)| *of == initiator)?;
            Some(Contender {
                since: Instant::from_micros(since),
                is_urgent,
            })
        })
    }

    #[test]
    fn all_take_turns() {
        let mut arbiter = Arbiter::new();
        let all = Initiator::ALL.map(|initiator| (initiator, 0, false));
        for _ in 0..2 {
            for initiator in Initiator::ALL {
                assert_eq!(arbiter.next(&contenders(&all)), Some(initiator));
                arbiter.taken(initiator, false, NOW);
            }
        }
        assert_eq!(arbiter.next(&contenders(&[])), None);
    }

    #[test]
    fn urgent_poll_passes_nobody_over_twice() {
        let mut arbiter = Arbiter::new();
        let both = [(Initiator::Usb, 50, false), (Initiator::Poll, 90, true)];
        assert_eq!(arbiter.next(&contenders(&both)), Some(Initiator::Poll));
        arbiter.taken(Initiator::Poll, true, NOW);
        assert_eq!(arbiter.next(&contenders(&both)), Some(Initiator::Usb));
        let later = [(Initiator::Usb, 101, false), (Initiator::Poll, 102, true)];
        assert_eq!(arbiter.next(&contenders(&later)), Some(Initiator::Poll));
    }

    #[test]
    fn another_turn_is_remembered_for_a_second() {
        let mut arbiter = Arbiter::new();
        arbiter.taken(Initiator::Usb, false, NOW);
        assert!(!arbiter.is_shared(NOW));
        arbiter.taken(Initiator::Poll, true, NOW);
        assert!(arbiter.is_shared(NOW + Duration::from_micros(999_999)));
        assert!(!arbiter.is_shared(NOW + SHARED_TIME));
    }
}
