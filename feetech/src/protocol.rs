//! The protocol, and the settings of servos that its timing depends on.

use armwire::time::Duration;

/// The protocol of the bus.
///
/// ```
/// use armwire::time::Duration;
/// use armwire_feetech::Feetech;
///
/// // A bus whose servos have `return-delay` 0, as LeRobot sets it.
/// let quick = Feetech { return_delay: Duration::ZERO, ..Feetech::default() };
/// ```
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Feetech {
    /// The longest `return-delay` on the bus.
    pub return_delay: Duration,
    /// True if every servo has `status-level` 1 and acknowledges writes. Servos with 0 answer PING, READ and SYNC_READ only.
    pub acknowledges: bool,
    /// True if the line returns every byte to its sender, as an adapter with one wire does that does not hide them.
    pub echoes: bool,
}

impl Default for Feetech {
    /// The longest return delay, 508 µs, and acknowledged writes: the factory settings. No echoes.
    fn default() -> Self {
        Self {
            return_delay: Duration::from_micros(508),
            acknowledges: true,
            echoes: false,
        }
    }
}
