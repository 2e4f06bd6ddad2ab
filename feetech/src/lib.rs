//! The bus of Feetech STS and SMS servos: the STS3215 of an SO-100 or SO-101 arm, and its siblings.
//!
//! All servos share one wire, usually at 1 Mbaud. A host sends a packet to one servo or to all, and each addressed servo
//! answers with a status packet. The crate gives the engine of [`armwire`] what it needs for these packets, through its
//! public traits alone:
//!
//! | File | Trait | Contents |
//! |---|---|---|
//! | `frame.rs` | [`Framing`](armwire::framing::Framing) | the beginning and end of a packet |
//! | `correlation.rs` | [`Correlation`](armwire::correlation::Correlation) | the answers of a request, from its bytes |
//! | `message.rs` | [`Messages`](armwire::messages::Messages) | requests and answers |
//! | `text.rs` | | their texts |
//! | [`register`] | | the registers of an STS3215, with ranges and sources |
//! | `host.rs` | | a host for requests with several answers |
//!
//! A [`Client`](armwire::Client) serves every request but SYNC_READ, which has an answer from each servo: see [`Host`].
//!
//! ```
//! use armwire::messages::Messages;
//! use armwire_feetech::{Feetech, MAX_FRAME, Request, register};
//!
//! let request = Request::Read { id: 1, address: register::POSITION.address, len: 2 };
//! let mut out = [0; MAX_FRAME];
//! let n = Feetech::default().encode_request(&request, &mut out)?;
//! assert_eq!(out[..n], [0xFF, 0xFF, 0x01, 0x04, 0x02, 0x38, 0x02, 0xBE]);
//! # Ok::<(), armwire::EncodeError>(())
//! ```
//!
//! # Sources
//!
//! No servo was available. The facts are taken from:
//!
//! * the maker's *Serial Bus Smart Control Servo Communication Protocol Manual*, V1.01: packets, checksum, the
//!   instructions up to SYNC WRITE;
//! * the maker's SDK (FTServo and SCServo, `INST.h`, `SMS_STS.h`): the other instructions, and the registers that it names;
//! * the maker's memory table of the STS3215, as published in the crate st3215 0.0.2 (`build.rs`): ranges and units;
//! * the tables of LeRobot, rustypot and feetech-cli ([`register`] states them row by row).
//!
//! They disagree on these points:
//!
//! * Baud rates 5 to 7 are 76 800, 57 600 and 38 400 in the maker's table and SDK, and in feetech-cli. LeRobot and rustypot
//!   have 57 600, 38 400 and 19 200. [`register::BAUD_RATES`] is the maker's.
//! * RESET is instruction 06 in the manual, which restores the factory settings, and 0A in the SDK, which zeroes the count of
//!   turns. The SDK names 06 RECOVER. Here they are [`Request::FactoryReset`] and [`Request::ResetTurns`].
//! * The highest id is 253 in the manual and the table, 252 in the SDK for Python. [`MAX_ID`] is the manual's.
//! * Bit 1 of the error byte is the angle in the manual for SCS servos, and the magnetic sensor in the pages for STS servos.
//! * The sign of the speed in mode 2 is bit 11 in the maker's table and bit 10 in its SDK. A magnitude is at most 1000: bit 10
//!   suffices.
//! * Register 7, the return delay, is *reserved* in newer pages of the maker. Register 83 is valid from firmware 2.54 on.
//!
//! # Panics
//!
//! None, for any input.
#![no_std]
#![forbid(unsafe_code)]

mod correlation;
mod frame;
mod host;
mod message;
mod protocol;
pub mod register;
mod text;

pub use correlation::Key;
pub use frame::{BROADCAST, Expect, MAX_FRAME, MAX_ID, checksum};
pub use host::{Event, Host};
pub use message::{ERRORS, Request, Status};
pub use protocol::Feetech;
