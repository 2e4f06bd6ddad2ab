//! Exact, allocation-free robot-arm protocols.
//!
//! Bytes in → [`Decoder`](decoder::Decoder) → frame → typed message → [`Client`] or [`Device`] → bytes out. No step does
//! I/O, reads a clock, allocates, or panics on its input: the same code runs in an interrupt handler, in a task, on a desktop,
//! and in a test in no time at all.
//!
//! | Layer | Knows | Does not know |
//! |---|---|---|
//! | [`framing`] | where a frame begins and ends, given what is expected | whose it is |
//! | [`decoder`] | bytes in any chunks → items in order, none of the bytes missing | what frames mean, which arm |
//! | [`dialect`] | which frames belong together, from their bytes alone | messages |
//! | [`exchange`] | which answer belongs to which request: pending, stale, late, unsolicited | messages |
//! | [`messages`] | typed requests and responses, both ways | time |
//! | [`Client`], [`Device`] | these for one conversation, as the host and as the arm | I/O |
//! | `driver` (feature `async`) | a client over `embedded-io-async` | |
//!
//! The protocols are `ling` (Ling / Alicia-D), `xarm` (UFACTORY xArm) and `alpha1` (UBTECH Alpha1), each a module and a
//! feature.
//!
//! # Features
//!
//! * `ling`, `ling-legacy`, `xarm`, `alpha1`: the protocols, all on by default. One that is off costs nothing.
//! * `async`: the driver.
//! * `defmt`: `defmt::Format` for every value, message, event and error.
//!
//! # Panics
//!
//! None, whatever arrives: a link test on Cortex-M0 and Cortex-M4 proves, for every set of protocols, that no path to a
//! panic is left in decoder, client, device and messages. Outside the proof are formatting as text, where `core` has
//! panics of its own, and two features: `async`, as a future panics when it is polled after it is done, and `defmt`, which
//! formats.
#![no_std]
#![forbid(unsafe_code)]

// The derived implementations of `Arbitrary` need it.
#[cfg(fuzzing)]
extern crate std;

#[cfg(feature = "alpha1")]
pub mod alpha1;
mod client;
pub mod decoder;
mod device;
pub mod dialect;
#[cfg(feature = "async")]
pub mod driver;
mod error;
pub mod exchange;
pub mod framing;
#[cfg(fuzzing)]
mod fuzzing;
#[cfg(feature = "ling")]
pub mod ling;
pub mod messages;
pub mod raw;
pub mod time;
#[cfg(feature = "xarm")]
pub mod xarm;

pub use client::{Client, Config, Event, Output, SubmitError};
pub use device::{Device, DeviceEvent};
pub use error::{BufferTooShort, Cause, EncodeError, MessageId, OutOfRange, ParseError};
