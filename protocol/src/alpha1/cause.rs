//! Causes of errors that only this protocol has.

use core::fmt;

/// The reason why a frame is no message of the robot or of a servo, where it is one of this protocol only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Cause {
    /// A servo's answer without a pending request, or bytes with its format.
    Unexpected,
    /// A frame of the robot's Bluetooth protocol.
    Bluetooth,
    /// A command that starts the boot loader of a servo, which this crate does not offer.
    BootLoader,
}

impl fmt::Display for Cause {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Unexpected => "an answer of a servo, but none is expected",
            Self::Bluetooth => "a frame of the robot's Bluetooth protocol",
            Self::BootLoader => "it would start a servo's boot loader, which is not offered",
        })
    }
}

impl core::error::Error for Cause {}
