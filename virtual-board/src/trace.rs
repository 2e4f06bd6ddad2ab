//! A hash of all events in a run.

/// 64-bit FNV-1a for bytes, and a similar hash for words: not cryptographic, but sensitive to every bit and to the
/// order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Trace(u64);

const PRIME: u64 = 0x0000_0100_0000_01B3;

impl Default for Trace {
    fn default() -> Self {
        Self(0xCBF2_9CE4_8422_2325)
    }
}

impl Trace {
    /// Adds a word. Each access of the core adds four, and a step for each byte would be too slow.
    pub(crate) fn add(&mut self, value: u64) {
        // Multiplication only moves bits up: without the rotation, two words that differ in their highest bits would
        // have the same hash.
        self.0 = (self.0.rotate_left(32) ^ value).wrapping_mul(PRIME);
    }

    pub(crate) fn bytes(&mut self, bytes: &[u8]) {
        for &byte in bytes {
            self.0 = (self.0 ^ u64::from(byte)).wrapping_mul(PRIME);
        }
    }

    pub(crate) fn value(self) -> u64 {
        self.0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn hash_equals_the_published_one() {
        let mut trace = Trace::default();
        trace.bytes(b"foobar");
        assert_eq!(trace.value(), 0x8594_4171_F739_67E8);
    }

    #[test]
    fn trace_depends_on_every_bit_and_order() {
        let of = |words: [u64; 2]| {
            let mut trace = Trace::default();
            for word in words {
                trace.add(word);
            }
            trace.value()
        };
        let plain = of([1, 2]);
        assert_ne!(plain, of([2, 1]));
        assert_ne!(plain, of([1 | 1 << 63, 2 | 1 << 63]));
        for bit in 0..64 {
            assert_ne!(plain, of([1 ^ 1 << bit, 2]));
            assert_ne!(plain, of([1, 2 ^ 1 << bit]));
        }
    }
}
