//! The threshold of the UART's receiver.

/// The number of bytes that the UART must receive before any work can be due, apart from an idle line and errors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RxThreshold {
    /// This many bytes of any value, at least 1.
    pub max: usize,
    /// At least this many if the last of them is the terminator.
    pub min: usize,
    /// The last byte of the next frame. `None` if it is unknown, or if the number of missing bytes is known.
    pub terminator: Option<u8>,
}

impl RxThreshold {
    /// Returns true if these `bytes`, the last of which is `last`, reach the threshold.
    pub fn is_met(&self, bytes: usize, last: u8) -> bool {
        bytes >= self.max || bytes >= self.min && self.terminator == Some(last)
    }

    /// The least number of bytes that may reach the threshold.
    pub(crate) const fn least(&self) -> usize {
        match self.terminator {
            Some(_) if self.min < self.max => self.min,
            _ => self.max,
        }
    }
}
