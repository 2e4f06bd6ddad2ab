//! A bounded queue of events: a frame's bytes and metadata, not the encoded message.

use crate::can::telemetry::{event_from_data, event_to_data};
use crate::control::{Event, FrameBytes, Initiator, Stamp};
use crate::queue::Queue;
use armwire::time::Instant;

/// Length of an event's header, in bytes: its time, its kind and its length.
const HEADER: usize = 10;

/// The kind of a frame is its initiator's index in [`Initiator::ALL`], or this value for none.
const UNSOLICITED: u8 = 0xFF;

/// The kind of an event other than a frame: its bytes are those of its CAN frame.
const OTHER: u8 = 0xFE;

/// Capacity in bytes: twelve answers with the joints of a Ling arm.
const ROOM: usize = 384;

/// Maximum size of the frames in one packet: sixteen of four bytes, the shortest of all protocols.
const PACKET_OF_FRAMES: usize = 16 * (HEADER + 4);

/// An event from the queue.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Queued {
    /// A frame of the arm, and the initiator that it answers.
    Frame(Option<Initiator>),
    /// Any other event.
    Event(Event),
}

/// A FIFO.
pub(crate) struct EventQueue {
    bytes: Queue<ROOM>,
}

impl EventQueue {
    pub(crate) const fn new() -> Self {
        Self { bytes: Queue::new() }
    }

    pub(crate) const fn is_empty(&self) -> bool {
        self.bytes.is_empty()
    }

    /// Returns true if the frames of any packet fit.
    pub(crate) const fn has_room(&self) -> bool {
        self.bytes.room() >= PACKET_OF_FRAMES
    }

    /// Appends a frame whose last byte arrived at `at`. Returns false if it does not fit.
    pub(crate) fn push_frame(&mut self, at: Instant, initiator: Option<Initiator>, bytes: &[u8]) -> bool {
        let kind = initiator.map_or(UNSOLICITED, |initiator| initiator as u8);
        self.push_bytes(at, kind, bytes)
    }

    /// Appends an event other than a frame. Returns false if it does not fit.
    pub(crate) fn push(&mut self, at: Instant, event: &Event) -> bool {
        event_to_data(event, Stamp(at.as_micros())).is_some_and(|data| self.push_bytes(at, OTHER, &data))
    }

    fn push_bytes(&mut self, at: Instant, kind: u8, bytes: &[u8]) -> bool {
        let fits = bytes.len().saturating_add(HEADER) <= self.bytes.room();
        if fits {
            let mut header = [0; HEADER];
            let [stamp @ .., kind_byte, len] = &mut header;
            *stamp = at.as_micros().to_le_bytes();
            (*kind_byte, *len) = (kind, bytes.len() as u8);
            self.bytes.push(&header);
            self.bytes.push(bytes);
        }
        fits
    }

    /// Removes the first event, and copies its bytes if it is a frame.
    pub(crate) fn pop(&mut self, bytes: &mut FrameBytes) -> Option<(Instant, Queued)> {
        let mut header = [0; HEADER];
        if self.bytes.pop(&mut header) < HEADER {
            return None;
        }
        let [stamp @ .., kind, len] = header;
        // No longer frame was pushed.
        let _ = bytes.resize(len.into(), 0);
        self.bytes.pop(bytes);
        let queued = match kind {
            OTHER => Queued::Event(event_from_data(bytes[..].try_into().ok()?)?.1),
            _ => Queued::Frame(Initiator::ALL.get(usize::from(kind)).copied()),
        };
        Some((Instant::from_micros(u64::from_le_bytes(stamp)), queued))
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::vec::Vec;

    use super::*;
    use crate::control::{MAX_FRAME, Refusal};

    fn events(len: usize) -> impl Iterator<Item = (Instant, Queued, Vec<u8>)> {
        let initiators = Initiator::ALL.map(Some).into_iter().chain([None]).cycle();
        initiators.enumerate().map(move |(n, initiator)| {
            let (queued, bytes) = match (n % 4, initiator) {
                (1, Some(initiator)) => {
                    let reason = Refusal::OtherRate;
                    (Queued::Event(Event::Refused { initiator, reason }), Vec::new())
                }
                (2, Some(initiator)) => {
                    let event = Event::HostSilent {
                        initiator,
                        dropped: u16::MAX,
                        torque_off: true,
                    };
                    (Queued::Event(event), Vec::new())
                }
                _ => (Queued::Frame(initiator), [n as u8; MAX_FRAME][..len].to_vec()),
            };
            (Instant::from_micros(u64::MAX - n as u64), queued, bytes)
        })
    }

    #[test]
    fn events_come_out_as_they_went_in() {
        let mut queue = EventQueue::new();
        let mut popped = FrameBytes::new();
        for len in [1, 7, 21, MAX_FRAME] {
            let events: Vec<_> = events(len)
                .take_while(|(at, queued, bytes)| match queued {
                    Queued::Frame(initiator) => queue.push_frame(*at, *initiator, bytes),
                    Queued::Event(event) => queue.push(*at, event),
                })
                .collect();
            assert!(events.len() >= ROOM / (MAX_FRAME + HEADER));
            for (at, queued, bytes) in events {
                assert_eq!(queue.pop(&mut popped), Some((at, queued.clone())));
                assert!(matches!(queued, Queued::Event(_)) || popped[..] == bytes[..]);
            }
            assert_eq!((queue.is_empty(), queue.pop(&mut popped)), (true, None));
        }
    }
}
