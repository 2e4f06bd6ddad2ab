//! ISO-TP: messages of up to 4095 bytes in CAN frames (ISO 15765-2:2016), classic and FD, with normal addressing.
//!
//! An [`Endpoint`] does no I/O and reads no clock. The caller passes received frames and the time, and takes the next
//! frame:
//!
//! ```
//! use armwire_bridge::Instant;
//! use armwire_bridge::can::{Function, Node};
//! use armwire_bridge::isotp::{Config, Endpoint, Event, Link};
//!
//! let node = Node::new(0).unwrap();
//! let mut host = Endpoint::<300, 300>::new(Config::new(Link::Classic, Function::ArmRequest.id(node)));
//! let mut adapter = Endpoint::<300, 300>::new(Config::new(Link::Classic, Function::ArmAnswer.id(node)));
//! let now = Instant::ZERO;
//!
//! // The first frame …
//! host.send(b"longer than seven").unwrap();
//! let first = host.transmit(now).unwrap();
//! assert_eq!(first.data(), b"\x10\x11longer");
//! assert_eq!(adapter.receive(first.data(), now).next(), None);
//! // … is answered by flow control, for which the host waits …
//! assert_eq!(host.transmit(now), None);
//! let flow_control = adapter.transmit(now).unwrap();
//! assert_eq!(flow_control.data(), [0x30, 0, 0, 0xCC, 0xCC, 0xCC, 0xCC, 0xCC]);
//! assert_eq!(host.receive(flow_control.data(), now).next(), None);
//! // … and the rest follows.
//! assert_eq!(adapter.receive(host.transmit(now).unwrap().data(), now).next(), None);
//! assert_eq!(adapter.receive(host.transmit(now).unwrap().data(), now).next(), Some(Event::Received));
//! assert_eq!(adapter.received(), Some(&b"longer than seven"[..]));
//! assert!(!host.is_sending());
//! adapter.release();
//! ```
//!
//! No published crate has this interface: can-iso-tp 0.2.0 owns its bus and its clock, and iso-tp is an alpha release.
//!
//! Reception follows the standard. Frames that it requires to be ignored change nothing (sections 9.6 and 9.8.3), with
//! one exception: a single frame may have more padding than needed. Real senders do that, and the length is
//! unambiguous.
//!
//! # Panics
//!
//! None for any input.

mod config;
mod endpoint;
mod event;
mod pci;
mod receiver;
mod sender;

#[cfg(test)]
mod tests;

use armwire::time::Instant;

pub use config::{Config, Link, SeparationTime};
pub use endpoint::{Endpoint, MAX_PDU};
pub use event::{Error, Event, Events, Ignored, RefusedPdu, SendError};
pub(crate) use pci::beginning;

/// The instant of no timeout.
const NEVER: Instant = Instant::from_micros(u64::MAX);

/// The number of consecutive frames in a block. A block without limit is longer than any PDU.
const fn block(size: u8) -> u16 {
    match size {
        0 => u16::MAX,
        n => n as u16,
    }
}
