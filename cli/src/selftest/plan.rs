//! The extent of a self-test.

use std::time::Duration;

use super::report::Trouble;

/// The extent of a self-test. A check without any extent is not tried.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Bytes of each echo.
    pub echo_bytes: u32,
    /// Frames with checked stamps.
    pub stamps: u32,
    /// Cancelled requests.
    pub cancels: u32,
    /// Resets of the bus.
    pub resets: u32,
    /// Saves to flash.
    pub saves: u32,
    /// Duration of the comparison between the adapter's clock and the host's.
    pub crystal: Duration,
    /// Names of the checks to make; empty for all. The checks that identify the adapter and detect the jumper always
    /// run.
    pub only: Vec<String>,
}

/// The full self-test, about two minutes.
impl Default for Plan {
    fn default() -> Self {
        Self {
            echo_bytes: 4_000,
            stamps: 10_000,
            cancels: 300,
            resets: 10,
            saves: 6,
            crystal: Duration::from_secs(60),
            only: Vec::new(),
        }
    }
}

/// Ends a check that has no extent in the plan.
pub(super) fn planned(count: u32) -> Result<(), Trouble> {
    match count {
        0 => Err(Trouble::NotTried("the plan has none of it".to_owned())),
        _ => Ok(()),
    }
}
