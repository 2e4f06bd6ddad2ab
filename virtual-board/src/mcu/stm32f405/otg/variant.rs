//! What differs between controllers, or is not known.

/// Behaviour of the STM32F405's USB controller where the manual and drivers disagree.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct OtgVariant {
    /// True if EPENA of an OUT endpoint is cleared at the end of its transfer, as in the manual (RM0090, 34.17.5). It stays on
    /// chips on which drivers work that only clear the NAK.
    pub disables_out_endpoints: bool,
    /// True if STUPCNT stays as it was written. In the manual it counts down with each SETUP packet (RM0090, 34.17.5); no other
    /// driver reads it.
    pub keeps_setup_count: bool,
}
