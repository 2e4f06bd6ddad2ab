//! The older generation of Ling arms, with firmware from before the function byte (late 2025): read, never written.

mod frame;

pub use frame::{Frame, MAX_DATA, MAX_FRAME, OVERHEAD, parity};

/// The older generation's protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Legacy;
