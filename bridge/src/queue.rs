//! A bounded queue of bytes that moves slices, not bytes one at a time.

/// A FIFO of up to `N` bytes.
pub(crate) struct Queue<const N: usize> {
    ring: [u8; N],
    used: Used,
}

impl<const N: usize> Queue<N> {
    pub(crate) const fn new() -> Self {
        Self {
            ring: [0; N],
            used: Used { head: 0, len: 0 },
        }
    }

    pub(crate) const fn len(&self) -> usize {
        self.used.len
    }

    pub(crate) const fn is_empty(&self) -> bool {
        self.used.len == 0
    }

    /// Free space in bytes.
    pub(crate) const fn room(&self) -> usize {
        N.saturating_sub(self.used.len)
    }

    pub(crate) const fn clear(&mut self) {
        self.used.len = 0;
    }

    /// Appends as many bytes as fit, and returns the number of dropped ones.
    pub(crate) fn push(&mut self, bytes: &[u8]) -> usize {
        self.used.push(&mut self.ring, bytes)
    }

    /// Copies bytes from the front into `out` and returns their number.
    pub(crate) fn peek(&self, out: &mut [u8]) -> usize {
        self.used.peek(&self.ring, out)
    }

    /// Moves bytes from the front into `out` and returns their number.
    pub(crate) fn pop(&mut self, out: &mut [u8]) -> usize {
        let n = self.peek(out);
        self.skip(n);
        n
    }

    /// Drops `len` bytes from the front.
    pub(crate) fn skip(&mut self, len: usize) {
        self.used.skip(len, N);
    }
}

/// The used part of a ring. Queues of all sizes share this code.
struct Used {
    /// Index of the first byte.
    head: usize,
    len: usize,
}

impl Used {
    fn push(&mut self, ring: &mut [u8], bytes: &[u8]) -> usize {
        let room = ring.len().saturating_sub(self.len);
        let fits = bytes.get(..room).unwrap_or(bytes);
        let tail = wrap(self.head + self.len, ring.len());
        let n = copy(ring.get_mut(tail..).unwrap_or_default(), fits);
        let n = n + copy(ring, fits.get(n..).unwrap_or_default());
        self.len += n;
        bytes.len().saturating_sub(n)
    }

    fn peek(&self, ring: &[u8], out: &mut [u8]) -> usize {
        let len = out.len().min(self.len);
        let out = out.get_mut(..len).unwrap_or_default();
        let n = copy(out, ring.get(self.head..).unwrap_or_default());
        n + copy(out.get_mut(n..).unwrap_or_default(), ring)
    }

    fn skip(&mut self, len: usize, size: usize) {
        let n = len.min(self.len);
        self.len -= n;
        // An empty queue restarts at index 0: its data then needs one copy, by words.
        self.head = if self.len == 0 { 0 } else { wrap(self.head + n, size) };
    }
}

/// Wraps an index around the end of a ring.
const fn wrap(place: usize, len: usize) -> usize {
    if place >= len { place.saturating_sub(len) } else { place }
}

/// Copies as many bytes as both slices have.
fn copy(to: &mut [u8], from: &[u8]) -> usize {
    let n = to.len().min(from.len());
    if n == 0 {
        return 0; // the usual end of a ring that did not wrap, not worth a call
    }
    to[..n].copy_from_slice(&from[..n]);
    n
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::collections::VecDeque;
    use std::vec;
    use std::vec::Vec;

    use proptest::prelude::*;

    use super::*;

    proptest! {
        #[test]
        fn bytes_come_out_as_they_went_in(steps in prop::collection::vec((any::<bool>(), 0..40_usize), 0..200)) {
            let (mut queue, mut model) = (Queue::<32>::new(), VecDeque::new());
            let mut next = 0_u8;
            for (push, n) in steps {
                if push {
                    let bytes: Vec<u8> = (0..n).map(|i| next.wrapping_add(i as u8)).collect();
                    next = next.wrapping_add(n as u8);
                    let fits = n.min(32 - model.len());
                    prop_assert_eq!(queue.push(&bytes), n - fits);
                    model.extend(&bytes[..fits]);
                } else {
                    let mut out = vec![0; n];
                    let popped = queue.pop(&mut out);
                    let expected: Vec<u8> = model.drain(..n.min(model.len())).collect();
                    prop_assert_eq!(&out[..popped], expected);
                }
                prop_assert_eq!((queue.len(), queue.room()), (model.len(), 32 - model.len()));
            }
        }
    }
}
