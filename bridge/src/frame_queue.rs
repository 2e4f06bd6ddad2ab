//! Frames of the arm that subscribers are still to be told of: only what is needed to tell, not the message.

use crate::Instant;

use crate::control::{Event, FrameBytes, FromAdapter, Initiator, Stamp};
use crate::queue::Queue;

/// Bytes of room: 6 answers with the joints of a Ling arm.
const ROOM: usize = 192;

/// What is kept of a frame besides its bytes: when it ended, who had asked for it, and how long it is.
const HEADER: usize = 10;

/// Stands for nobody.
const NOBODY: u8 = u8::MAX;

/// First in, first out.
pub(crate) struct FrameQueue {
    bytes: Queue<ROOM>,
}

impl FrameQueue {
    pub(crate) const fn new() -> Self {
        Self { bytes: Queue::new() }
    }

    pub(crate) const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Appends a frame that ended at `at`, and returns whether there was room.
    pub(crate) fn push(&mut self, at: Instant, initiator: Option<Initiator>, bytes: &[u8]) -> bool {
        let fits = bytes.len().saturating_add(HEADER) <= self.bytes.room();
        if fits {
            let mut header = [0; HEADER];
            let [stamp @ .., by, len] = &mut header;
            *stamp = at.as_micros().to_le_bytes();
            *by = initiator.map_or(NOBODY, |initiator| initiator as u8);
            *len = bytes.len() as u8;
            self.bytes.push(&header);
            self.bytes.push(bytes);
        }
        fits
    }

    /// Makes of `message` what to tell of the frame that came first, and returns whether there was one.
    ///
    /// It is filled where it lies: to move one takes as long as all else that is done with it.
    pub(crate) fn pop(&mut self, message: &mut FromAdapter) -> bool {
        if self.is_empty() {
            return false;
        }
        let mut header = [0; HEADER];
        self.bytes.pop(&mut header);
        let [stamp @ .., by, len] = header;
        let initiator = Initiator::ALL.get(usize::from(by)).copied();
        let bytes = FrameBytes::new();
        *message = FromAdapter::Event {
            at: Stamp(u64::from_le_bytes(stamp)),
            event: Event::Frame { initiator, bytes },
        };
        if let FromAdapter::Event {
            event: Event::Frame { bytes, .. },
            ..
        } = message
        {
            // No longer frame was pushed.
            let _ = bytes.resize(len.into(), 0);
            self.bytes.pop(bytes);
        }
        true
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::control::MAX_FRAME;

    fn frames(len: usize) -> impl Iterator<Item = (u64, Option<Initiator>, FrameBytes)> {
        let initiators = Initiator::ALL.map(Some).into_iter().chain([None]).cycle();
        initiators.enumerate().map(move |(n, initiator)| {
            let bytes = FrameBytes::from_slice(&[n as u8; MAX_FRAME][..len]).unwrap();
            (u64::MAX - n as u64, initiator, bytes)
        })
    }

    #[test]
    fn frames_come_out_as_they_went_in() {
        let mut queue = FrameQueue::new();
        let mut message = FromAdapter::Event {
            at: Stamp(0),
            event: Event::BusOff { off: false },
        };
        for len in [1, 7, 21, MAX_FRAME] {
            let frames: Vec<_> = frames(len)
                .take_while(|(at, initiator, bytes)| queue.push(Instant::from_micros(*at), *initiator, bytes))
                .map(|(at, initiator, bytes)| FromAdapter::Event {
                    at: Stamp(at),
                    event: Event::Frame { initiator, bytes },
                })
                .collect();
            assert_eq!(frames.len(), ROOM / (len + HEADER));
            for frame in frames {
                assert!(queue.pop(&mut message));
                assert_eq!(message, frame);
            }
            assert!(queue.is_empty() && !queue.pop(&mut message));
        }
    }
}
