//! The revisions of chips that differ.

/// The revision of an RP2040.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum Rp2040Revision {
    /// B0 and B1. The USB controller answers each token with NAK once an endpoint was held by EP_ABORT
    /// (RP2040-E2), and connects late after a reset of the bus (RP2040-E5).
    B1,
    /// B2, of 2021 and later.
    #[default]
    B2,
}

impl Rp2040Revision {
    /// Its number in CHIP_ID (2.20.2).
    pub(crate) const fn number(self) -> u8 {
        match self {
            Self::B1 => 1,
            Self::B2 => 2,
        }
    }
}
