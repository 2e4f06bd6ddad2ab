//! The protocol, a type without state.

/// The protocol of the Alpha1 and of its servos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Alpha1;
