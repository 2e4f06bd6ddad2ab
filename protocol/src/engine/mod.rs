//! The engine that client, device and adapter share: framing, decoder, dialect and exchange, each of use by itself.
//!
//! | Layer | Knows |
//! |---|---|
//! | [`framing`] | where a frame begins and ends, given what is expected |
//! | [`decoder`] | bytes in any chunks → items in order, none of the bytes missing |
//! | [`dialect`] | which frames are requests and responses, and which belong together, from their bytes alone |
//! | [`exchange`] | which answer belongs to which request: pending, stale, late, unsolicited |

#[cfg(feature = "alpha1")]
pub mod alpha1;
pub mod decoder;
pub mod dialect;
pub mod exchange;
pub mod framing;
#[cfg(feature = "ling")]
pub mod ling;
pub mod raw;
#[cfg(feature = "xarm")]
pub mod xarm;
