//! Events that wait for the CAN controller as plain frames.

use heapless::Deque;

use crate::can::MAX_CLASSIC;
use crate::control::Refusal;
use crate::line::STREAMERS;

/// Number of events that differ in their kind or initiator: refusals, two kinds of silence, bus-off and its end.
const KINDS: usize = refusals() + 2 * STREAMERS.len() + 2;

const fn refusals() -> usize {
    let mut kinds: usize = 0;
    let mut reasons = Refusal::ALL.as_slice();
    while let [reason, rest @ ..] = reasons {
        kinds += reason.initiators().len();
        reasons = rest;
    }
    kinds
}

/// The data of a frame. Its first two bytes are the event's kind and initiator.
type Data = [u8; MAX_CLASSIC];

/// A FIFO that keeps the last event of each kind and initiator.
pub(super) struct EventFrames {
    frames: Deque<Data, KINDS>,
}

impl EventFrames {
    pub(super) const fn new() -> Self {
        Self { frames: Deque::new() }
    }

    pub(super) fn is_empty(&self) -> bool {
        self.frames.is_empty()
    }

    pub(super) fn len(&self) -> usize {
        self.frames.len()
    }

    /// Appends a frame. Without room, the oldest frame is dropped that a newer one repeats, with the same kind and
    /// initiator. Returns false if a frame was dropped.
    pub(super) fn push(&mut self, data: Data) -> bool {
        let is_full = self.frames.is_full();
        if is_full {
            self.drop_repeated(&data);
        }
        // More frames than kinds: one was repeated.
        self.frames.push_back(data).is_ok() && !is_full
    }

    #[cold]
    fn drop_repeated(&mut self, newest: &Data) {
        let mut is_dropped = false;
        // Each frame returns to the back, in the same order.
        for _ in 0..self.frames.len() {
            let Some(frame) = self.frames.pop_front() else { return };
            let is_repeated = self.frames.iter().chain([newest]).any(|newer| is_same(newer, &frame));
            if is_repeated && !is_dropped {
                is_dropped = true;
            } else {
                let _ = self.frames.push_back(frame);
            }
        }
    }

    /// Removes the oldest frame.
    pub(super) fn pop(&mut self) -> Option<Data> {
        self.frames.pop_front()
    }
}

/// Returns true if both events have the same kind and initiator.
const fn is_same(&[kind, initiator, ..]: &Data, &[other_kind, other_initiator, ..]: &Data) -> bool {
    kind == other_kind && initiator == other_initiator
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;
    use crate::can::telemetry::event_to_data;
    use crate::control::{Event, Stamp};

    /// An event of each kind and initiator.
    fn kinds() -> Vec<Event> {
        let refusals = Refusal::ALL.into_iter().flat_map(|reason| {
            let of = move |&initiator| Event::Refused { initiator, reason };
            reason.initiators().iter().map(of)
        });
        let silences = STREAMERS.into_iter().flat_map(|initiator| {
            [false, true].map(|torque_off| Event::HostSilent {
                initiator,
                dropped: 0,
                torque_off,
            })
        });
        let bus = [false, true].map(|off| Event::BusOff { off });
        refusals.chain(silences).chain(bus).collect()
    }

    proptest! {
        #[test]
        fn newest_event_of_each_kind_goes_out(
            picks in prop::collection::vec((any::<prop::sample::Index>(), 0..6_usize), 0..200),
        ) {
            let kinds = kinds();
            prop_assert_eq!(kinds.len(), KINDS);
            let mut frames = EventFrames::new();
            let mut waiting = Vec::new();
            let mut dropped = 0;
            for (at, (kind, pops)) in picks.into_iter().enumerate() {
                let data = event_to_data(kind.get(&kinds), Stamp(at as u64)).unwrap();
                dropped += usize::from(!frames.push(data));
                waiting.push(data);
                // Usually none goes out.
                if pops == 0 {
                    let first = frames.pop().unwrap();
                    let place = waiting.iter().position(|data| *data == first).unwrap();
                    // All before it were dropped, and a newer one says the same.
                    for old in waiting.drain(..=place).take(place).collect::<Vec<_>>() {
                        prop_assert!(waiting.iter().chain([&first]).any(|newer| is_same(newer, &old)));
                        dropped -= 1;
                    }
                }
            }
            prop_assert_eq!(frames.len() + dropped, waiting.len());
            let left: Vec<Data> = core::iter::from_fn(|| frames.pop()).collect();
            prop_assert!(left.is_sorted_by_key(|data| u32::from_le_bytes([data[4], data[5], data[6], data[7]])));
            for (at, data) in waiting.iter().enumerate() {
                let is_repeated = waiting[at + 1..].iter().any(|newer| is_same(newer, data));
                prop_assert!(is_repeated || left.contains(data), "{:?} was dropped", data);
            }
        }
    }
}
