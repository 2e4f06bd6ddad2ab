//! The crystal at the chip's OSC_IN and OSC_OUT, and the chip's own oscillators.

use crate::time::Nanos;

/// A crystal, as seen by the chip. It keeps its frequency while it runs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Crystal {
    /// Its frequency, in hertz.
    pub hertz: u32,
    /// The time from switching on to the ready flag (RM0090, 7.3.1, HSERDY). `None`: it does not oscillate, or there is
    /// none.
    pub startup: Option<Nanos>,
}

impl Crystal {
    /// A crystal that starts in 2 ms, which is typical (DS8626, 5.3.8).
    pub const fn new(hertz: u32) -> Self {
        Self {
            hertz,
            startup: Some(Nanos::from_millis(2)),
        }
    }

    /// No crystal, or one that does not oscillate.
    pub const fn dead() -> Self {
        Self {
            hertz: 0,
            startup: None,
        }
    }
}

/// The internal oscillator's nominal frequency, in hertz (RM0090, 7.2.2; RM0440, 7.2.2).
pub(crate) const INTERNAL_HZ: u32 = 16_000_000;

/// The nominal frequency of LSI, in hertz (DS8626, 5.3.9; DS12589, 5.3.9).
pub(crate) const LSI_HZ: u32 = 32_000;

/// The state of the crystal, shared by the clock controller, the timer that measures it and the board's owner.
#[derive(Debug)]
pub(crate) struct Oscillator {
    pub(crate) crystal: Crystal,
    /// The frequency of the internal oscillator, in hertz.
    pub(crate) internal_hz: u32,
    /// The frequency of LSI, in hertz.
    pub(crate) lsi_hz: u32,
    /// The crystal's divided clock for the timer that measures it (RM0090, 7.3.3, RTCPRE; RM0440, 31.8, OR1). `None` while it does not run, or
    /// without a divider.
    pub(crate) divided: Option<Divided>,
    /// True if the core runs from the internal oscillator.
    pub(crate) core_is_internal: bool,
}

impl Oscillator {
    pub(crate) fn new(crystal: Crystal, internal_hz: u32, lsi_hz: u32) -> Self {
        Self {
            crystal,
            internal_hz,
            lsi_hz,
            divided: None,
            core_is_internal: true,
        }
    }
}

/// The crystal's divided clock.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Divided {
    /// The start of the clock.
    pub(crate) since: Nanos,
    pub(crate) hertz: u32,
    pub(crate) divider: u32,
}
