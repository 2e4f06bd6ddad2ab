//! Levels of the interrupt lines between the peripherals and the core.

/// The levels, and which of them the core has not been told.
#[derive(Clone, Debug, Default)]
pub(crate) struct Lines {
    high: u128,
    told: u128,
}

impl Lines {
    /// Sets the level of a line, 0 to 127.
    #[inline]
    pub(crate) fn set(&mut self, line: u16, high: bool) {
        let bit = 1 << line;
        if high {
            self.high |= bit;
        } else {
            self.high &= !bit;
        }
    }

    /// Whether a level changed that the core has not been told.
    #[inline]
    pub(crate) fn changed(&self) -> bool {
        self.high != self.told
    }

    /// Takes a change that the core has not been told: the line and its level.
    pub(crate) fn take_change(&mut self) -> Option<(u16, bool)> {
        let changed = self.high ^ self.told;
        if changed == 0 {
            return None;
        }
        let line = changed.trailing_zeros() as u16;
        self.told ^= 1 << line;
        Some((line, self.high >> line & 1 != 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_change_is_told_once() {
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
