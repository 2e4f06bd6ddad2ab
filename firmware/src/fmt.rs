//! The log, over RTT with feature `defmt`; without it, nothing. `docs/logs.md` explains each line. Nothing on the path of
//! a byte is logged.
#![macro_use]

/// Logs what is as it should be.
macro_rules! info {
    ($text:literal $(, $value:expr)*) => {{
        #[cfg(feature = "defmt")]
        defmt::info!($text $(, $value)*);
        #[cfg(not(feature = "defmt"))]
        let _ = ($(&$value),*);
    }};
}

/// Logs what needs attention.
macro_rules! warning {
    ($text:literal $(, $value:expr)*) => {{
        #[cfg(feature = "defmt")]
        defmt::warn!($text $(, $value)*);
        #[cfg(not(feature = "defmt"))]
        let _ = ($(&$value),*);
    }};
}

/// Waits until a probe, if there is one, has read the log: a reset clears it. If the probe is lost, the watchdog ends the
/// wait.
pub(crate) fn flush() {
    #[cfg(feature = "defmt")]
    defmt::flush();
}
