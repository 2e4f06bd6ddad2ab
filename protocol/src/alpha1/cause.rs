//! Causes of errors that only this protocol has.

use thiserror::Error;

/// The reason why a frame is no message of the robot or of a servo, where it is one of this protocol only.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Error)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Cause {
    /// A servo's answer without a pending request, or bytes with its format.
    #[error("an answer of a servo, but none is expected")]
    Unexpected,
    /// A frame of the robot's Bluetooth protocol.
    #[error("a frame of the robot's Bluetooth protocol")]
    Bluetooth,
    /// A command that starts the boot loader of a servo, which this crate does not offer.
    #[error("it would start a servo's boot loader, which is not offered")]
    BootLoader,
}
