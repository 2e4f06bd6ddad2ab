//! A full-speed USB host, and what it needs of the device at the other end of the cable.
//!
//! * [`timing`]: how long things take on a full-speed wire;
//! * [`host`]: frames, transactions and transfers: the host controller;
//! * [`descriptor`]: what a device says about itself, parsed;
//! * [`enumerate`]: from a reset bus to a configured device;
//! * [`cdc`]: the class driver of a USB serial port (CDC-ACM);
//! * [`vendor`]: an interface of the vendor's own.
//!
//! Nothing here knows a controller or an emulator: a host drives any [`Function`].

pub mod cdc;
pub mod descriptor;
pub mod enumerate;
pub mod host;
pub mod timing;
pub mod vendor;

use crate::time::Nanos;

/// A device as the wire sees it.
///
/// Every call happens at its instant on the wire, in order.
pub trait Function {
    /// Whether the device pulls D+ up, which is how a host sees that a full-speed device is there (USB 2.0, 7.1.7.3).
    fn pulls_up(&self) -> bool;

    /// The cable brings or takes the bus voltage.
    fn power(&mut self, vbus: bool);

    /// The host starts to hold the bus in reset (USB 2.0, 7.1.7.5).
    fn reset(&mut self);

    /// The reset is over: the device runs at full speed and has address 0.
    fn reset_done(&mut self);

    /// A start of frame, with its 11-bit number.
    fn start_of_frame(&mut self, number: u16);

    /// The bus has been idle for 3 ms: the device must suspend (USB 2.0, 7.1.7.6).
    fn suspend(&mut self);

    /// The host woke the bus (USB 2.0, 7.1.7.7).
    fn resume(&mut self);

    /// Whether a token to `endpoint` would now get anything but a NAK.
    ///
    /// A host that polls asks again and again. NAKs change nothing in the device, so the host sends only the tokens
    /// that matter, at the instants at which its polling would have sent them.
    fn ready(&self, endpoint: u8, direction: Direction) -> bool;

    /// A SETUP transaction on endpoint 0. Returns whether the device acknowledged it.
    fn setup(&mut self, address: u8, request: [u8; 8]) -> bool;

    /// An OUT transaction.
    fn output(&mut self, address: u8, endpoint: u8, toggle: bool, data: &[u8]) -> Handshake;

    /// The token of an IN transaction.
    fn input(&mut self, address: u8, endpoint: u8) -> Reply;

    /// The host received the data that [`input`](Self::input) gave, and acknowledged it.
    fn acknowledged(&mut self, endpoint: u8);
}

/// Which way data goes, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Direction {
    /// Host to device.
    Out,
    /// Device to host.
    In,
}

/// What a device answers to data (USB 2.0, 8.4.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Handshake {
    /// It has the data.
    Ack,
    /// Not now.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
    /// Nothing answers.
    Silence,
}

/// What a device answers to an IN token.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Reply {
    /// A data packet.
    Data {
        /// DATA1 rather than DATA0.
        toggle: bool,
        /// What it carries.
        bytes: Vec<u8>,
        /// When the firmware had made it ready to be sent.
        armed: Nanos,
    },
    /// Not now.
    Nak,
    /// The endpoint is halted, or the request is not supported.
    Stall,
    /// Nothing answers.
    Silence,
}
