//! The cause of a reset.

/// The cause of a reset, by the chip's flags.
#[derive(Clone, Copy)]
pub(crate) enum ChipReset {
    /// The supply was switched on, or was too low.
    PowerOn,
    /// The watchdog.
    Watchdog,
    /// The firmware, the reset pin or a debugger.
    Other,
}
