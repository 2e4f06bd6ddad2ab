//! Random numbers from a seed, or from a fuzzer's input.

/// A source of random choices.
#[derive(Clone, Debug)]
pub enum Random {
    /// Steele and Vigna's SplitMix64, and its state.
    Seeded(u64),
    /// The fuzzer's bytes, in reverse. Once they are used up, each choice is the first one.
    Chosen(Vec<u8>),
}

impl Random {
    /// The choices of the run `number` with this `seed`.
    pub fn new(seed: u64, number: u32) -> Self {
        let mut random = Self::Seeded(seed);
        let start = random.any() ^ u64::from(number);
        Self::Seeded(start)
    }

    /// The choices encoded in these bytes.
    pub fn chosen(bytes: &[u8]) -> Self {
        Self::Chosen(bytes.iter().rev().copied().collect())
    }

    /// Any number.
    pub fn any(&mut self) -> u64 {
        self.up_to(u64::MAX)
    }

    /// A number from `low` to `high`, inclusive.
    pub fn between(&mut self, low: u64, high: u64) -> u64 {
        low + self.up_to(high - low) % (high - low + 1)
    }

    /// One of these values.
    ///
    /// # Panics
    ///
    /// If `all` is empty.
    pub fn one_of<T: Copy>(&mut self, all: &[T]) -> T {
        all[self.between(0, all.len() as u64 - 1) as usize]
    }

    /// True with this probability in percent.
    pub fn percent(&mut self, percent: u64) -> bool {
        self.between(0, 99) < percent
    }

    /// A number from 0 to at least `high`. A fuzzer's source uses only the bytes that `high` needs.
    fn up_to(&mut self, high: u64) -> u64 {
        match self {
            Self::Seeded(state) => {
                *state = state.wrapping_add(0x9E37_79B9_7F4A_7C15);
                let mut z = *state;
                z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
                z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
                z ^ (z >> 31)
            }
            Self::Chosen(bytes) => {
                let len = high.checked_ilog2().map_or(0, |bits| bits / 8 + 1);
                (0..len).fold(0, |number, _| number << 8 | u64::from(bytes.pop().unwrap_or(0)))
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn choice_consumes_only_the_bytes_it_needs() {
        let mut random = Random::chosen(&[7, 1, 2, 3]);
        assert_eq!(random.between(5, 5), 5);
        assert_eq!(random.between(0, 9), 7);
        assert_eq!(random.between(0, 999), 258);
        assert_eq!(random.between(0, 99), 3);
        assert_eq!(random.one_of(&["first", "second"]), "first");
    }

    #[test]
    fn each_number_of_a_seed_has_own_choices() {
        let choices = |number| {
            let mut random = Random::new(1, number);
            [0; 4].map(|_| random.between(0, 999))
        };
        assert_eq!(choices(3), choices(3));
        assert_ne!(choices(3), choices(4));
    }
}
