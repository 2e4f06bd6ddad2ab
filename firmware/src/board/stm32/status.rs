//! The flags of the arm's UART, the same on every STM32.

/// The UART's flags since the last read.
#[derive(Clone, Copy, Default)]
pub(crate) struct Status {
    /// A byte without a stop bit.
    pub(crate) framing: bool,
    /// A byte with wrong parity.
    pub(crate) parity: bool,
    /// A byte with noise.
    pub(crate) noise: bool,
    /// A lost byte: the previous one had not been fetched.
    pub(crate) overrun: bool,
    /// An idle line after a byte.
    pub(crate) idle: bool,
}

impl Status {
    /// Returns true for any error.
    pub(crate) fn is_error(&self) -> bool {
        self.framing || self.parity || self.noise || self.overrun
    }
}
