//! UBTECH Alpha1: a humanoid of 16 servos on USB, and the servos on their own bus.

mod dialect;
mod frame;
pub mod hid;

pub use crate::alpha1::{Outcome, ServoId};
pub use dialect::Key;
pub use frame::{Expect, Frame, MAX_FRAME, MAX_TEXT, ServoAnswer, TAIL, checksum};

/// The Alpha1 protocol, and that of its servos.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Alpha1;
