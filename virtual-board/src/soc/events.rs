//! The time of each peripheral's next event.

use crate::time::Nanos;

const NEVER: Nanos = Nanos(u64::MAX);

/// One instant per peripheral. A chip has so few that a linear search is faster than a heap.
#[derive(Clone, Debug)]
pub(crate) struct Events<const SLOTS: usize> {
    due: [Nanos; SLOTS],
    next: Nanos,
}

impl<const SLOTS: usize> Default for Events<SLOTS> {
    fn default() -> Self {
        Self {
            due: [NEVER; SLOTS],
            next: NEVER,
        }
    }
}

impl<const SLOTS: usize> Events<SLOTS> {
    /// Sets the time of the next event of `slot`.
    #[inline]
    pub(crate) fn set(&mut self, slot: usize, due: Option<Nanos>) {
        let due = due.unwrap_or(NEVER);
        let before = std::mem::replace(&mut self.due[slot], due);
        if due < self.next {
            self.next = due;
        } else if before == self.next && due != before {
            self.next = self.due.iter().copied().min().unwrap_or(NEVER);
        }
    }

    /// The time of the next event, the maximum if there is none.
    #[inline]
    pub(crate) fn next(&self) -> Nanos {
        self.next
    }

    /// Takes the slot with the first event due by `now`: of several at the same instant the lowest.
    pub(crate) fn take(&mut self, now: Nanos) -> Option<usize> {
        if self.next > now {
            return None;
        }
        let slot = self.due.iter().position(|&due| due == self.next)?;
        self.set(slot, None);
        Some(slot)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn earliest_comes_first_and_then_the_lowest() {
        let mut events = Events::<4>::default();
        events.set(3, Some(Nanos(10)));
        events.set(1, Some(Nanos(20)));
        events.set(2, Some(Nanos(10)));
        events.set(0, Some(Nanos(30)));
        assert_eq!(events.next(), Nanos(10));
        let taken: Vec<usize> = std::iter::from_fn(|| events.take(Nanos(25))).collect();
        assert_eq!(taken, [2, 3, 1]);
        assert_eq!(events.next(), Nanos(30));
    }

    #[test]
    fn postponed_instant_is_no_longer_next() {
        let mut events = Events::<2>::default();
        events.set(0, Some(Nanos(10)));
        events.set(1, Some(Nanos(15)));
        events.set(0, Some(Nanos(20)));
        assert_eq!(events.next(), Nanos(15));
        events.set(1, None);
        assert_eq!(events.next(), Nanos(20));
        events.set(0, None);
        assert_eq!((events.next(), events.take(Nanos(1 << 40))), (NEVER, None));
    }
}
