//! The armwire adapter as a state machine: hosts on USB and CAN on one side, a robot arm's UART on the other.
//!
//! [`Bridge`] does no I/O and reads no clock. Firmware tells it what the UART, the USB host and the CAN bus did and asks it what
//! to do next; a desktop program or a test can do the same. It owns every decision, so that firmware is wiring only.
//!
//! It has two sides. The line owns the arm: the UART, whose turn it is, the serial port on USB, the dead-man and the clock of the
//! poll. The hosts' side owns the CAN bus, the control port, the configuration and the events for subscribers. It hands the line
//! requests, and takes the frames and events that the line delivers.
//!
//! # The serial port on USB
//!
//! * **Bytes pass untouched, in order, both ways.** While nobody else uses the arm they pass at once, whatever they
//!   are: decoders listen in and never alter, delay or hold back a byte.
//! * **Arm to host**: bytes leave in a USB packet when a frame ends, when the line goes idle or when they fill a
//!   packet, whichever is first. A zero-length packet ends a transfer that a full packet would leave open.
//! * **Host to arm**: a packet is taken only when there is room for it, so that USB holds the host back.
//! * **A host that does not read** costs bytes, never the arm's time: the queue towards it is bounded, what does not
//!   fit is dropped and counted.
//! * **The line's rate** is the arm's. A host's other [line coding](Bridge::set_line_coding) takes effect with its next byte,
//!   or after 100 ms if DTR is up, behind the bytes that came before. It ends when DTR falls, at USB reset, deconfiguration or
//!   suspend, and without DTR after 10 s without a byte either way. It waits while a host on CAN streams motion, and torque-off
//!   takes the line back.
//!
//! # Several initiators on one arm
//!
//! The host on USB, hosts on CAN by ISO-TP, cyclic commands, the adapter's own poll and the adapter itself take turns,
//! a request at a time, each with the answer to it or until that is overdue. A poll with a rate goes first when it is
//! due, but nobody is passed over twice by it.
//!
//! * **An answer goes to its initiator**, and to nobody else but subscribers. It is told by its bytes, and by when it began. All
//!   other frames of the arm go to the serial port, and on CAN if that is [wanted](config::Can::unsolicited).
//! * **A missing answer** ends the turn. For 50 ms after it was due no other request of its kind goes out, for
//!   the answer to that could not be told from the late one. A host on USB that has the line alone may ask, as it hears both.
//!   An answer is due by the rate at which its request was sent: at 2400 baud the longest takes 0.3 s, also for those who
//!   wait once the line is the arm's again.
//! * **Eight requests** with the arm are tracked. A host on USB that has the line alone may send more, which are
//!   [counted](Counters::untracked_requests); another then waits until the last of them can no longer be answered. A host that
//!   shares the line is held back.
//! * **Half a request on USB** keeps the line for 10 ms after its last byte. Before another's request zeros end it, and
//!   the bytes that the arm heard at another rate.
//! * **Bytes that are no request**, such as a firmware update by the vendor's tool, keep the line until it has been
//!   quiet both ways for 5 ms. With others waiting that ends after 100 ms, in the middle of whatever it is: two who
//!   both send what is no frame are cut in pieces, of which each of those from CAN is a whole PDU.
//!   [`HoldLine`](control::Request::HoldLine) keeps the others away for such a time.
//! * **A host on USB that holds another rate, or the line**, has it alone: polls, commands and requests of others are
//!   [refused](control::Refusal::LineHeld). [`GetLine`](control::Request::GetLine) tells the holder.
//! * **A host that streamed motion and has fallen silent** is [reported](control::Event::HostSilent); bytes of it that are not out
//!   by then are dropped. The torque goes off if that is [wanted](config::HostTimeout::torque_off), and waits for nobody's answer.
//! * **A cyclic command** that has waited for its turn for longer than [its time-out](config::Can::command_timeout_ms)
//!   moves nothing.
//!
//! ```
//! use armwire_bridge::time::Instant;
//! use armwire_bridge::{Bridge, PACKET, Transmit, UsbEvent};
//!
//! let mut bridge = Bridge::default();
//! bridge.usb_event(UsbEvent::Configured(true), Instant::ZERO);
//!
//! // The host asks for the joint positions …
//! bridge.usb_received(&[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF], Instant::ZERO);
//! let mut buf = [0; 256];
//! let burst = bridge.uart_transmit(&mut buf, Instant::ZERO);
//! assert_eq!(burst, Some(Transmit::Burst { len: 7, start: None }));
//! bridge.uart_transmitted(Instant::ZERO);
//!
//! // … and the arm answers. Before the end of the frame is in, nothing is sent; then all of it is, at once.
//! let answer = [0xAA, 0x05, 0x00, 0x01, 0x01, 0xF9, 0xFF];
//! bridge.uart_received(&answer[..5], Instant::from_micros(350));
//! assert_eq!(bridge.rx_threshold().max, 2);
//! let mut packet = [0; PACKET];
//! assert_eq!(bridge.usb_transmit(&mut packet), None);
//!
//! bridge.uart_received(&answer[5..], Instant::from_micros(370));
//! assert_eq!(bridge.usb_transmit(&mut packet), Some(7));
//! assert_eq!(packet[..7], answer);
//! assert_eq!(bridge.counters().frames, 1);
//! ```
//!
//! # Features
//!
//! `ling` and `alpha1`, both on by default, each compile in a protocol. A line of an arm whose protocol is not compiled in is a
//! raw one.
//!
//! # Panics
//!
//! None, whatever it is told. A link test proves it of all but [`store`].
#![no_std]
#![forbid(unsafe_code)]

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
mod hosts;
pub mod isotp;
mod line;
mod line_coding;
mod queue;
pub mod store;

#[cfg(test)]
mod tests;

pub use action::Action;
pub use armwire::time;
pub use armwire::time::{Duration, Instant};
pub use bridge::{Bridge, CanEvent, Start, Status, UartEvent, UsbEvent};
pub use counters::{CanErrors, Counters, UartErrors};
pub use line::{PACKET, POLL_LEAD_TIME, RxThreshold, TO_ARM_BUFFER, TO_HOST_BUFFER, Transmit};
pub use line_coding::{LineCoding, MAX_BAUD, MIN_BAUD, Parity, Refused, StopBits, UartConfig};
