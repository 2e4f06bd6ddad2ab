//! The older generation of Ling arms, whose frames have no function byte: receive only.
//!
//! Such an arm continuously sends the positions of its joints and its gripper, at 1 000 000 or 921 600 baud. There is
//! no vendor document. The sources are the vendor's older Python packages (5.4 to 6.0), its ROS drivers, and frames
//! published by users of such arms; `docs/protocols/ling.md`, section "Older generation", lists the contradictions
//! between them and the choices made.
//!
//! [`Legacy`] has no requests: [`Request`] is an empty enum, and nothing can be sent. A [`Detector`] reads the same
//! bytes as the decoder of current frames and detects this generation.
//!
//! ```
//! use core::num::NonZeroU32;
//!
//! use armwire::ling::Position;
//! use armwire::ling::legacy::{Legacy, MAX_FRAME, Response};
//! use armwire::time::Instant;
//! use armwire::{Client, Config, Event, Output};
//!
//! let baud = NonZeroU32::new(921_600);
//! let mut client = Client::<Legacy, MAX_FRAME>::new(Legacy, Config { baud, ..Config::default() });
//! let line = [
//!     0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
//!     0x04, 0x81, 0x08, 0x00, 0xFF,
//! ];
//! assert!(client.receive(Instant::ZERO, &line).is_empty());
//! let Output::Event(Event::Unsolicited(Response::Joints(state))) = client.poll(Instant::ZERO) else {
//!     panic!("no joint frame");
//! };
//! assert_eq!(state.positions()?.map(Position::ticks), [1961, 3302, 1645, 1839, 1261, 2177]);
//! # Ok::<(), armwire::OutOfRange>(())
//! ```

mod detector;
mod frame;
mod message;
#[cfg(test)]
mod tests;
mod text;

pub use detector::{Detector, OlderGeneration};
pub use frame::{Frame, MAX_DATA, MAX_FRAME, OVERHEAD, parity};
pub use message::{Firmware, GripperState, JointState, Request, Response, SERVOS};

/// The baud rates of the older generation, the more common first.
///
/// The vendor's packages of 2025 state 921 600 baud for firmware up to 5.4.18, and 1 000 000 for later firmware. Its
/// package 6.1 states 921 600 for all firmware before 6.
pub const BAUD_RATES: [u32; 2] = [1_000_000, 921_600];

/// The older generation's protocol.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Legacy;
