//! Actions that only firmware can take.

use crate::config::{self, Config};

/// An action that only firmware can take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Write this configuration to flash, then call [`Bridge::saved`](crate::Bridge::saved).
    Save(Config),
    /// Erase the configuration in flash, then call [`Bridge::saved`](crate::Bridge::saved).
    Reset,
    /// Start again, once the reply is with the host: wait 100 ms.
    Restart,
    /// Start the chip's own boot loader, in the same way.
    RestartIntoBootLoader,
    /// Set up the CAN controller anew.
    RestartCan(config::Can),
}
