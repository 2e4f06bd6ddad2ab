//! A full-speed USB host, and its interface to the device.
//!
//! * [`timing`]: durations on a full-speed wire;
//! * [`host`]: frames, transactions and transfers: the host controller;
//! * [`descriptor`]: parsed descriptors of a device;
//! * [`enumerate`]: from a reset bus to a configured device;
//! * [`cdc`]: the class driver of a USB serial port (CDC-ACM);
//! * [`vendor`]: a vendor-specific interface.
//!
//! The host is independent of controllers and emulators: it drives any [`Function`].

pub mod cdc;
pub mod descriptor;
pub mod enumerate;
pub mod host;
pub mod timing;
pub mod vendor;

use crate::time::Nanos;

/// A device, as seen by the wire.
///
/// Calls are made at their instant on the wire, in order.
pub trait Function {
    /// Returns true if the device pulls D+ up, by which a host detects a full-speed device (USB 2.0, 7.1.7.3).
    fn pulls_up(&self) -> bool;

    /// The cable connects or disconnects the bus voltage.
    fn power(&mut self, vbus: bool);

    /// The host starts to hold the bus in reset (USB 2.0, 7.1.7.5).
    fn reset(&mut self);

    /// The reset has ended: the device runs at full speed and has address 0.
    fn reset_done(&mut self);

    /// A start of frame, with its 11-bit number.
    fn start_of_frame(&mut self, number: u16);

    /// The bus has been idle for 3 ms: the device must suspend (USB 2.0, 7.1.7.6).
    fn suspend(&mut self);

    /// The host woke the bus (USB 2.0, 7.1.7.7).
    fn resume(&mut self);

    /// Returns true if a token to `endpoint` would now get an answer other than NAK.
    ///
    /// NAKs change nothing in the device. The host therefore skips the polls that would get one, and sends the other
    /// tokens at the instants of its polling.
    fn ready(&self, endpoint: u8, direction: Direction) -> bool;

    /// A SETUP transaction on endpoint 0. Returns true if the device acknowledged it.
    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool;

    /// An OUT transaction.
    fn output(&mut self, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake;

    /// The token of an IN transaction.
    fn input(&mut self, address: u8, endpoint: u8) -> Reply;

    /// The host received the data from [`input`](Self::input), and acknowledged it.
    fn acknowledged(&mut self, endpoint: u8);
}

/// The direction of data, as seen by the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// Host to device.
    Out,
    /// Device to host.
    In,
}

/// The answer of a device to data (USB 2.0, 8.4.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// The data is accepted.
    Ack,
    /// Not ready.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
    /// No answer.
    NoResponse,
}

/// The answer of a device to an IN token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// A data packet.
    Data {
        /// True for DATA1, false for DATA0.
        toggle: bool,
        /// Its data.
        bytes: Vec<u8>,
        /// Time at which the firmware had it ready.
        armed: Nanos,
    },
    /// Not ready.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
    /// No answer.
    NoResponse,
}
