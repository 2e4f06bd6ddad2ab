//! Actions that only firmware can take.

use crate::config::{self, Config};

/// Whether a write to flash may erase, during which the adapter may stall.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Erase {
    /// It erases if it has to.
    Allowed,
    /// It fails if there is no room without an erase. An erase that was interrupted is completed nevertheless, if the start has
    /// not done so.
    Refused,
}

/// An action that only firmware can take.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Action {
    /// Write this configuration to flash, then call [`Bridge::saved`](crate::Bridge::saved).
    Save(Config, Erase),
    /// Erase the configuration in flash, then call [`Bridge::saved`](crate::Bridge::saved).
    Reset(Erase),
    /// [`Erase`](Self::Erase), then write this configuration to flash, then call
    /// [`Bridge::saved`](crate::Bridge::saved).
    Replace(Config),
    /// Erase all flash of the configuration without reading it, then call [`Bridge::saved`](crate::Bridge::saved).
    Erase,
    /// Read the configuration in flash, then call [`Bridge::loaded`](crate::Bridge::loaded).
    Load,
    /// Restart the firmware. Wait 100 ms first: the reply must reach the host.
    Restart,
    /// Restart into the chip's boot loader, after the same 100 ms.
    RestartIntoBootLoader,
    /// Reinitialise the CAN controller with this configuration.
    RestartCan(config::Can),
}
