//! The armwire adapter as a state machine: hosts on USB and CAN on one side, a robot arm's UART on the other.
//!
//! [`Bridge`] does no I/O and reads no clock. Firmware passes it the events of the UART, the USB device and the CAN
//! controller, and executes the work that is due; a desktop program or a test can do the same. It makes every decision:
//! firmware is wiring only.
//!
//! It has two sides. The line owns the arm: the UART, the arbitration, the serial port on USB, the dead-man timer and
//! the poll clock. The hosts' side owns the CAN bus, the control port, the configuration and the events for
//! subscribers. It submits requests to the line, and takes the frames and events that the line delivers.
//!
//! # The serial port on USB
//!
//! * **Bytes pass unchanged and in order in both directions.** Decoders only observe them.
//! * **Arm to host**: bytes leave in a USB packet when a frame ends, when the line goes idle or when they fill a
//!   packet, whichever is first. A zero-length packet ends a transfer that a full packet would leave open.
//! * **Host to arm**: while the host on USB is the only initiator, its bytes go to the arm at once. A packet is accepted
//!   only if it fits; USB flow control then pauses the host.
//! * **A host that does not read** loses bytes and never delays the arm: the queue towards it is bounded, and bytes
//!   that do not fit are dropped and counted.
//! * **The line's rate** is the arm's. Another [line coding](Bridge::set_line_coding) of the host takes effect with its
//!   next byte, or after 100 ms if DTR is high, after the bytes already queued. It ends when DTR falls; at USB reset,
//!   deconfiguration or suspend; and without DTR after 10 s without a byte in either direction. It waits while a host
//!   on CAN streams motion. Torque-off takes the line back.
//!
//! # Several initiators on one arm
//!
//! The host on USB, hosts on CAN by ISO-TP, cyclic commands, the adapter's own poll and the adapter itself take turns.
//! A turn is one request with its answer, or with the timeout of its answer. A poll with a rate goes first when it is
//! due, but passes over no initiator twice.
//!
//! * **An answer goes to its initiator** and to subscribers only. It is matched by its bytes and by the time at which
//!   it began. All other frames of the arm go to the serial port, and to CAN if [configured](config::Can::unsolicited).
//! * **A missing answer** ends the turn. No other request with the same key goes out until 50 ms after the timeout: its
//!   answer could not be distinguished from the late one. A host on USB that is alone on the line is exempt, as it
//!   receives both. The timeout depends on the rate at which the request was sent: the longest at 2400 baud is 0.3 s,
//!   also for initiators that wait after the line has returned to the arm's rate.
//! * **Eight requests** in flight are tracked. A host on USB that is alone on the line may send more, which are
//!   [counted](Counters::untracked_requests); other initiators then wait until the last of them can no longer be
//!   answered. A host that shares the line waits.
//! * **An incomplete request on USB** keeps the line for 10 ms after its last byte. A *void* then ends it before another
//!   initiator's request: 261 zeros, as many bytes as the longest frame for whose rest an arm may wait. A void also ends
//!   bytes that the arm received at another rate. A void that the host itself sends ends its turn at once.
//! * **Bytes outside of requests**, for example a firmware update by the vendor's tool, keep the line until it has been
//!   quiet in both directions for 5 ms. If other initiators wait, that ends after 100 ms, at any byte. If two
//!   initiators send such bytes, their bytes interleave in pieces; a piece from CAN is a whole PDU.
//!   [`ReserveLine`](control::Request::ReserveLine) excludes the others.
//! * **The line is reserved** for the host on USB by that request, and while the host has another rate: polls, commands
//!   and requests of others are [refused](control::Refusal::LineReserved). [`GetLine`](control::Request::GetLine)
//!   returns the reservation.
//! * **A host that streamed motion and went silent** is [reported](control::Event::HostSilent), and its unsent bytes
//!   are dropped. The torque goes off if [configured](config::HostTimeout::torque_off). Torque-off waits for no answer.
//! * **A [`Stop`](control::Request::Stop)** on the control port drops the motion that waits, holds the arm in one pose, and
//!   [refuses](control::Refusal::Stopped) motion for 2 s. Its first reading of the joints goes out after the request in
//!   flight, and its hold waits for no answer.
//! * **A cyclic command** that has waited for its turn longer than [its timeout](config::Can::command_timeout_ms) moves
//!   nothing.
//!
//! ```
//! use armwire_bridge::control::MAX_FRAME;
//! use armwire_bridge::time::Instant;
//! use armwire_bridge::{Bridge, PACKET, Transmit, UsbEvent};
//!
//! let mut bridge = Bridge::default();
//! bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
//!
//! // The host requests the joint positions …
//! bridge.usb_received(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF], Instant::ZERO);
//! let burst = bridge.uart_transmit(&mut [0; MAX_FRAME], Instant::ZERO, |bytes, _| assert_eq!(bytes[1], 0x06));
//! assert_eq!(burst, Some(Transmit::Burst { len: 7, start: None }));
//!
//! // … and the arm answers. Before the end of the frame is in, nothing is sent; then all of it is, at once.
//! let answer = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
//! bridge.uart_received(&answer[..5], Instant::from_micros(350));
//! assert_eq!(bridge.rx_wait().threshold.max, 2);
//! let mut packet = [0; PACKET];
//! assert_eq!(bridge.usb_transmit(&mut packet), None);
//!
//! bridge.uart_received(&answer[5..], Instant::from_micros(370));
//! assert_eq!(bridge.usb_transmit(&mut packet), Some(7));
//! assert_eq!(packet[..7], answer);
//! assert_eq!(bridge.counters().frames, 1);
//! ```
//!
//! # Panics
//!
//! None for any input. A link test proves it for everything but [`store`].
#![no_std]
// docs.rs shows the feature that an item needs. This is unstable, and used there only.
#![cfg_attr(docsrs, feature(doc_cfg))]
#![forbid(unsafe_code)]

// Needed by the derived implementations of `Arbitrary`.
#[cfg(fuzzing)]
extern crate std;

mod action;
pub mod arm;
mod bridge;
pub mod can;
pub mod config;
pub mod control;
mod control_codec;
mod counters;
mod earliest;
mod events;
#[cfg(fuzzing)]
mod fuzzing;
mod hosts;
pub mod isotp;
mod line;
mod line_coding;
#[cfg(feature = "defmt")]
mod log;
mod queue;
mod rx_ring;
pub mod slcan;
pub mod start;
pub mod store;

#[cfg(test)]
mod tests;

pub use action::{Action, Erase};
pub use armwire::time;
pub use armwire::time::{Duration, Instant};
pub use bridge::{Bridge, CanEvent, Status, UartEvent, UsbEvent};
pub use counters::{CanErrors, Counters, UartErrors};
pub use line::{PACKET, POLL_LEAD_TIME, RxThreshold, TO_ARM_BUFFER, TO_HOST_BUFFER, Transmit};
pub use line_coding::{LineCoding, MAX_BAUD, MIN_BAUD, Parity, StopBits, UartConfig, UnsupportedCoding};
pub use rx_ring::{RxMark, RxRing, RxWait};
pub use start::Start;
