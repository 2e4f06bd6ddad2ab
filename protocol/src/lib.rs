//! Exact, allocation-free robot-arm protocols.
//!
//! Bytes in → [`Decoder`](decoder::Decoder) → frame → typed message → [`Client`] or [`Device`] → bytes out. No step
//! does I/O, reads a clock, allocates, or panics on its input: the same code runs in an interrupt handler, in a task,
//! on a desktop, and in a test without real time.
//!
//! | Layer | Handles | Independent of |
//! |---|---|---|
//! | [`framing`] | the beginning and end of a frame, given an expectation | its initiator |
//! | [`decoder`] | bytes in chunks of any size → items in order, without a missing byte | the meaning of frames, the kind of arm |
//! | [`correlation`] | matching frames, from their bytes alone | messages |
//! | [`exchange`] | the request of each answer: pending, stale, late, unsolicited | messages |
//! | [`messages`] | typed requests and responses, in both directions | time |
//! | [`Client`], [`Device`] | all of these for one conversation, as the host and as the arm | I/O |
//! | `driver` (feature `async`) | a client over `embedded-io-async` | |
//!
//! The protocols are `ling` (Ling / Alicia-D), `xarm` (UFACTORY xArm) and `alpha1` (UBTECH Alpha1), each a module and a
//! feature.
//!
#![cfg_attr(all(feature = "async", feature = "ling"), doc = include_str!("../doc/first_lines.md"))]
//! # Features
//!
//! * `ling`, `ling-legacy`, `xarm`, `alpha1`: the protocols, all on by default. A disabled protocol is not compiled.
//! * `small-crc`: Ling's checksum without its table of 1 KiB. A program is smaller, and decodes an answer on a Cortex-M4
//!   with 1,000 instead of 300 instructions.
//! * `async`: the driver.
//! * `defmt`: `defmt::Format` for every value, message, event and error.
//!
//! # Errors
//!
//! The text of an error is one line, with its cause. `source` therefore returns none: a program that prints the chain
//! prints the cause once. The cause is a value in the error's variant.
//!
//! # Stability
//!
//! Programs use [`Client`] or the driver, [`Device`], [`messages`], [`time`] and the modules of the protocols. Changes of
//! these are kept small.
//!
//! [`framing`], [`decoder`], [`correlation`], [`exchange`], [`raw`], [`text`] and the `Frame` of each protocol are the
//! layers below.
//! The adapter's firmware, monitors and implementations of other arms need them; programs do not. **They are less
//! stable:** a release that may break compatibility may change them in any way.
//!
//! # Panics
//!
//! None for any input. A link test on Cortex-M0 and Cortex-M4 proves, for every set of protocols, that decoder, client,
//! device and messages contain no path to a panic. The proof excludes formatting as text, where `core` has panics of
//! its own, and two features: `async`, because a future panics when it is polled after completion, and `defmt`, which
//! formats.
#![no_std]
// docs.rs shows the feature that an item needs. This is unstable, and used there only.
#![cfg_attr(docsrs, feature(doc_cfg))]
#![forbid(unsafe_code)]

// Needed by the derived implementations of `Arbitrary`.
#[cfg(fuzzing)]
extern crate std;

#[cfg(feature = "alpha1")]
pub mod alpha1;
mod client;
pub mod correlation;
pub mod decoder;
mod device;
#[cfg(feature = "async")]
pub mod driver;
mod error;
pub mod exchange;
mod fences;
pub mod framing;
#[cfg(fuzzing)]
mod fuzzing;
mod hex;
#[cfg(feature = "ling")]
pub mod ling;
pub mod messages;
mod named;
pub mod raw;
pub mod text;
pub mod time;
#[cfg(all(test, any(feature = "ling", feature = "xarm", feature = "alpha1")))]
#[path = "../tests/vectors/mod.rs"]
#[allow(dead_code, unreachable_pub, reason = "other programs use all of it")]
mod vectors;
#[cfg(feature = "xarm")]
pub mod xarm;

pub use client::{Client, Config, Event, Output, SubmitError};
pub use device::{Device, DeviceEvent};
pub use error::{BufferTooShort, Cause, EncodeError, ErrorFrame, MessageId, OutOfRange, ParseError};
