//! Levels of the interrupt lines between the peripherals and the core.

/// The levels, and the changes that were not passed on to the core.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    high: [u64; 2],
    reported: [u64; 2],
}

impl Lines {
    /// Sets the level of a line, 0 to 127.
    #[inline]
    pub(crate) fn set(&mut self, line: u16, high: bool) {
        let (word, bit) = place(line);
        self.high[word] = self.high[word] & !bit | if high { bit } else { 0 };
    }

    /// Returns true if a change was not passed on to the core.
    #[inline]
    pub(crate) fn changed(&self) -> bool {
        self.high != self.reported
    }

    /// Takes the next change: the line and its level.
    pub(crate) fn take_change(&mut self) -> Option<(u16, bool)> {
        let word = (0..self.high.len()).find(|&word| self.high[word] != self.reported[word])?;
        let line = 64 * word as u16 + (self.high[word] ^ self.reported[word]).trailing_zeros() as u16;
        let (word, bit) = place(line);
        self.reported[word] ^= bit;
        Some((line, self.high[word] & bit != 0))
    }
}

/// The word and bit of a line. Shifts of 128 bits would be slower.
fn place(line: u16) -> (usize, u64) {
    (usize::from(line / 64 % 2), 1 << (line % 64))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_reported_once() {
        let mut lines = Lines::default();
        lines.set(5, true);
        lines.set(100, true);
        lines.set(5, true);
        assert!(lines.changed());
        assert_eq!(
            [lines.take_change(), lines.take_change()],
            [Some((5, true)), Some((100, true))]
        );
        assert!(!lines.changed());
        lines.set(5, false);
        assert_eq!([lines.take_change(), lines.take_change()], [Some((5, false)), None]);
    }
}
