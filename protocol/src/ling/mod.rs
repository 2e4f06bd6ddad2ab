//! Ling / Alicia-D: six joints and a gripper on a 1 Mbaud UART.

mod frame;

pub use frame::{Frame, MAX_DATA, MAX_FRAME, OVERHEAD, SELF_CHECK, checksum};

/// The Ling protocol: a name for [`Decoder`](crate::Decoder), [`Client`](crate::Client) and
/// [`Device`](crate::Device).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ling {}
