//! Ling / Alicia-D: six joints and a gripper on a 1 Mbaud UART.

mod dialect;
mod frame;
#[cfg(feature = "ling-legacy")]
pub mod legacy;

pub use dialect::Key;
pub use frame::{Frame, MAX_DATA, MAX_FRAME, OVERHEAD, SELF_CHECK, TAIL, checksum};

/// The Ling protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Ling;
