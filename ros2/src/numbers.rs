//! Lost messages of a topic, by the numbers that each writer gives its messages.

use std::collections::HashMap;
use std::hash::Hash;

/// The last number of each writer `W`.
#[derive(Debug)]
pub(crate) struct Numbers<W> {
    last: HashMap<W, i64>,
}

impl<W: Eq + Hash> Numbers<W> {
    /// No messages.
    pub(crate) fn new() -> Self {
        Self { last: HashMap::new() }
    }

    /// Takes the number of a message. Returns how many of its writer's messages are missing before it. Messages that
    /// a writer sent before its first received one were not for this reader.
    pub(crate) fn missing_before(&mut self, writer: W, number: i64) -> u64 {
        let last = self.last.insert(writer, number);
        last.map_or(0, |last| u64::try_from(number - last - 1).unwrap_or(0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn gaps_of_each_writer_are_counted() {
        let mut numbers = Numbers::new();
        let mut missing = |writer, number| numbers.missing_before(writer, number);
        assert_eq!([missing("a", 7), missing("a", 8), missing("a", 11)], [0, 0, 2]);
        assert_eq!([missing("b", 3), missing("b", 4), missing("a", 12)], [0, 0, 0]);
    }
}
