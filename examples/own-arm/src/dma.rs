//! The decoder alone, behind a DMA that fills a ring: no client, no clock, no `std`.

use armwire::OutOfRange;
use armwire::decoder::{Decoder, Item};

use crate::sensor::Sensor;

/// The reader of a ring of `N` bytes that a DMA fills in a circle.
pub struct Receiver<const N: usize> {
    decoder: Decoder<Sensor, 32>,
    /// The index of the next byte to take from the ring.
    at: usize,
}

impl<const N: usize> Receiver<N> {
    /// A receiver at the start of a ring.
    pub const fn new() -> Self {
        let decoder = Decoder::new();
        Self { decoder, at: 0 }
    }

    /// Takes the bytes that arrived since the last call, and passes each item to `seen`. `next` is the index of the
    /// next byte to arrive: the length of the ring less the counter of the DMA.
    ///
    /// Call it from the interrupts of the half and of the whole ring, and of the idle line: a ring that was filled once
    /// between two calls looks empty, and its bytes are lost.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `next` is outside of the ring. Nothing is taken then.
    pub fn take(&mut self, ring: &[u8; N], next: usize, mut seen: impl FnMut(Item)) -> Result<(), OutOfRange<usize>> {
        let Some(front) = ring.get(..next) else {
            return Err(OutOfRange::new("next index", "", next, 0, N));
        };
        let pieces = match front.get(self.at..) {
            Some(new) => [new, &[]],
            None => [&ring[self.at..], front],
        };
        for mut rest in pieces {
            while !rest.is_empty() {
                rest = self.decoder.push(rest);
                self.items(&mut seen);
            }
        }
        self.at = next;
        Ok(())
    }

    /// The UART reported an idle line: the rest of a frame will not arrive.
    pub fn idle(&mut self, mut seen: impl FnMut(Item)) {
        self.decoder.idle();
        self.items(&mut seen);
    }

    fn items(&mut self, seen: &mut impl FnMut(Item)) {
        while let Some(item) = self.decoder.next(&Sensor, ()) {
            seen(item);
        }
    }
}

impl<const N: usize> Default for Receiver<N> {
    fn default() -> Self {
        Self::new()
    }
}
