//! Exact, allocation-free robot-arm protocols.
//!
//! Bytes in → [`Decoder`] → frame → typed message → [`Client`] or [`Device`] → bytes out. No step does I/O, reads a
//! clock, allocates, or panics on what it is given: the same code runs in an interrupt handler, in a task, on a
//! desktop, and in a test in no time at all.
//!
//! | Layer | What it knows |
//! |---|---|
//! | [`Framing`] | where frames begin and end |
//! | [`Decoder`] | bytes received, in any chunks, with noise between frames |
//! | [`Protocol`] | what frames mean, and which answers which |
//! | [`Client`], [`Device`] | the host's and the arm's side of a conversation |
//! | `driver` (feature `async`) | a client over `embedded-io-async` |
//!
//! The protocols are `ling` (Ling / Alicia-D), `xarm` (UFACTORY xArm) and `alpha1` (UBTECH Alpha1), each a module and a
//! feature.
//!
//! # Features
//!
//! * `ling`, `xarm`, `alpha1`: the protocols, all on by default. One that is off costs nothing.
//! * `async`: the driver.
//! * `defmt`: `defmt::Format` for every value, message, event and error.
//! * `crc-table`, `crc-table16`: Ling's checksum by 1 or 16 KiB of tables in place of 64 bytes.
//!
//! # Panics
//!
//! None, whatever arrives: a link test on Cortex-M0 and Cortex-M4 proves, for every set of protocols, that no path to a
//! panic is left in decoder, client, device and messages. Outside the proof are formatting as text, where `core` has
//! panics of its own, and three features: `async`, as a future panics when it is polled after it is done; `defmt`, which
//! formats; and `crc-table16`, where the `crc` crate keeps bounds checks.
#![no_std]
#![forbid(unsafe_code)]

#[cfg(feature = "alpha1")]
pub mod alpha1;
mod client;
mod copy;
mod decoder;
mod device;
#[cfg(feature = "async")]
pub mod driver;
pub mod engine;
mod error;
mod framing;
#[cfg(feature = "ling")]
pub mod ling;
mod protocol;
pub mod time;
#[cfg(feature = "xarm")]
pub mod xarm;

pub use client::{Busy, Client, Config, Event, Input};
pub use decoder::Decoder;
pub use device::{Device, Heard};
pub use error::{BufferTooShort, EncodeError, OutOfRange};
pub use framing::{Framing, Noise, Reason, Scan};
pub use protocol::{Protocol, Reply};
pub use time::Micros;
