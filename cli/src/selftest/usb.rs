//! The USB operations of the checks, for a real host and for a virtual board.

use std::time::Duration;

pub use nusb::transfer::Direction;
use thiserror::Error;

/// A control transfer: the fields of its setup packet (USB 2.0, 9.3) and its data.
#[derive(Clone, Copy, Debug)]
pub struct Request<'a> {
    /// bmRequestType. Its top bit agrees with the [payload](Self::payload).
    pub kind: u8,
    /// bRequest.
    pub request: u8,
    /// wValue.
    pub value: u16,
    /// wIndex.
    pub index: u16,
    /// The data stage.
    pub payload: Payload<'a>,
}

/// The data of a control transfer.
#[derive(Clone, Copy, Debug)]
pub enum Payload<'a> {
    /// Reads at most this many bytes.
    Read(u16),
    /// Writes these bytes.
    Write(&'a [u8]),
}

/// The two pipes of an adapter, each with a bulk endpoint in either direction.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Pipe {
    /// The data interface of the serial port.
    Port,
    /// The control interface.
    Control,
}

/// A failed operation.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum UsbError {
    /// The device stalled.
    #[error("the adapter stalled")]
    Stalled,
    /// The transfer timed out.
    #[error("the adapter did not answer in time")]
    TimedOut,
    /// The device is not on the bus.
    #[error("the adapter was disconnected")]
    Gone,
    /// The host does not support the operation.
    #[error("{0}")]
    Unsupported(String),
    /// The host failed.
    #[error("{0}")]
    Host(String),
}

/// One adapter on a USB host, configured, with both pipes open.
///
/// Every call blocks. The implementation bounds its duration by its own clock.
pub trait Usb {
    /// The time since a fixed instant.
    fn now(&self) -> Duration;

    /// Lets this much time pass.
    ///
    /// # Errors
    ///
    /// [`UsbError::Host`] if the clock belongs to a virtual board and the board fails.
    fn sleep(&mut self, span: Duration) -> Result<(), UsbError>;

    /// Makes a control transfer and returns the data of its IN stage.
    ///
    /// # Errors
    ///
    /// The error of the transfer.
    fn control(&mut self, request: &Request<'_>) -> Result<Vec<u8>, UsbError>;

    /// Begins a control transfer and cancels it after this time, in any stage. Returns true if it ended before.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`], and as the host fails.
    fn cancel(&mut self, request: &Request<'_>, after: Duration) -> Result<bool, UsbError>;

    /// Queues bytes for transmission and returns at once.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`], and as the host fails.
    fn send(&mut self, pipe: Pipe, bytes: &[u8]) -> Result<(), UsbError>;

    /// Waits at most this long for the first byte from the adapter. Returns the received bytes; empty on timeout.
    ///
    /// # Errors
    ///
    /// The error of the transfer.
    fn receive(&mut self, pipe: Pipe, wait: Duration) -> Result<Vec<u8>, UsbError>;

    /// Clears the halt of an endpoint of the serial port, and puts the host's data toggle back to DATA0 (USB 2.0, 9.4.5).
    /// Bytes received before stay available to [`receive`](Self::receive).
    ///
    /// # Errors
    ///
    /// The error of the request.
    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError>;

    /// Selects the only setting of the serial port's data interface again and resets the host's data toggles back to
    /// DATA0
    /// (USB 2.0, 9.4.10).
    ///
    /// # Errors
    ///
    /// The error of the request.
    fn set_interface(&mut self) -> Result<(), UsbError>;

    /// Selects the only configuration again, and puts all the host's data toggles back to DATA0 (USB 2.0, 9.1.1.5).
    ///
    /// # Errors
    ///
    /// The error of the request.
    fn set_configuration(&mut self) -> Result<(), UsbError>;

    /// Resets the bus, enumerates the adapter and opens both pipes again. Bytes in flight are lost.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`] if the adapter does not come back.
    fn reset(&mut self) -> Result<(), UsbError>;

    /// Waits for a restarting adapter and opens both pipes.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`] if the adapter does not come back.
    fn reopen(&mut self) -> Result<(), UsbError>;

    /// Suspends the bus for this time and resumes it.
    ///
    /// # Errors
    ///
    /// [`UsbError::Unsupported`] if the host does not allow programs to suspend the bus.
    fn suspend(&mut self, span: Duration) -> Result<(), UsbError>;
}
