//! The armwire adapter as a state machine: a USB serial port on one side, a robot arm's UART on the other.
//!
//! [`Bridge`] does no I/O and reads no clock. Firmware tells it what the UART and the USB host did and asks it what to
//! do next; a desktop program or a test can do the same. It owns every decision, so that firmware is wiring only:
//!
//! * **Bytes pass untouched, in order, both ways.** A decoder listens in on what the arm says. It knows when a frame has
//!   ended; it never alters, delays or holds back a byte.
//! * **Arm to host**: bytes leave in a USB packet when a frame ends, when the line goes idle or when they fill a packet,
//!   whichever is first. A zero-length packet ends a transfer that a full packet would leave open.
//! * **Host to arm**: a packet is taken only when there is room for it, so that USB holds the host back.
//! * **A host that does not read** costs bytes, never the arm's time: the queue towards it is bounded, what does not fit
//!   is dropped and counted.
//! * **Line coding** takes effect after the bytes that came before it.
//!
//! ```
//! use armwire::Micros;
//! use armwire_bridge::{Bridge, PACKET, Wake};
//!
//! let mut bridge = Bridge::<2048, 512>::default();
//! bridge.usb_configured(true);
//!
//! // The host asks for the joint positions …
//! bridge.usb_received(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF], Micros(0));
//! let mut buf = [0; 256];
//! assert_eq!(bridge.uart_transmit(&mut buf, Micros(0)).unwrap().len, 7);
//!
//! // … and the arm answers. Before the end of the frame is in, nothing is sent; then all of it is, at once.
//! let answer = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
//! bridge.uart_received(&answer[..5], Micros(350));
//! assert_eq!((bridge.need(), bridge.wake()), (2, Wake::At(Micros(360))));
//! let mut packet = [0; PACKET];
//! assert_eq!(bridge.usb_transmit(&mut packet), None);
//!
//! bridge.uart_received(&answer[5..], Micros(370));
//! assert_eq!(bridge.usb_transmit(&mut packet), Some(7));
//! assert_eq!(packet[..7], answer);
//! assert_eq!(bridge.counters().frames, 1);
//! ```
//!
//! # Panics
//!
//! None, whatever it is told. A link test proves it of all but [`store`].
#![no_std]
#![forbid(unsafe_code)]

mod arm;
mod bridge;
pub mod can;
mod can_port;
pub mod config;
pub mod control;
mod control_codec;
mod control_server;
mod counters;
mod earliest;
mod exchange;
pub mod isotp;
mod line;
mod line_share;
mod poll;
mod queue;
pub mod store;
mod stream;
mod turn;
mod usb;

#[cfg(test)]
mod tests;

pub use bridge::{Action, Bridge, Burst, CanErrors, LEAD, PACKET, Wake};
pub use counters::{Counters, UartErrors};
pub use line::{Line, LineCoding, MAX_BAUD, MIN_BAUD, Parity, Refused, StopBits};
