//! The USB operations of the checks, for a real host and for that of a virtual board.

use std::time::Duration;

use thiserror::Error;

/// A control transfer: the fields of its setup packet (USB 2.0, 9.3), and its data.
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
    /// So many bytes at most are read.
    Read(u16),
    /// These bytes are written.
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

/// A direction, as the host sees it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Direction {
    /// From the adapter to the host.
    In,
    /// From the host to the adapter.
    Out,
}

/// Why an operation failed.
#[derive(Clone, Debug, PartialEq, Eq, Error)]
pub enum UsbError {
    /// The device stalled.
    #[error("the adapter stalled")]
    Stalled,
    /// The device did not answer in time.
    #[error("the adapter did not answer in time")]
    TimedOut,
    /// The device is not on the bus.
    #[error("the adapter is gone")]
    Gone,
    /// This host cannot do that, for this reason.
    #[error("{0}")]
    Unsupported(String),
    /// The host failed, for this reason.
    #[error("{0}")]
    Host(String),
}

/// One adapter on a USB host, configured, with both pipes open.
///
/// Every call blocks, and ends in a time that the implementation bounds by its own clock.
pub trait Usb {
    /// The time since an instant that stays the same.
    fn now(&self) -> Duration;

    /// Lets this much time pass.
    ///
    /// # Errors
    ///
    /// [`UsbError::Host`] where the clock is a virtual board's, and that fails.
    fn sleep(&mut self, span: Duration) -> Result<(), UsbError>;

    /// Makes a control transfer, and returns what was read.
    ///
    /// # Errors
    ///
    /// As the transfer ends.
    fn control(&mut self, request: &Request<'_>) -> Result<Vec<u8>, UsbError>;

    /// Begins a control transfer and cancels it after this time, in whatever stage it is then. Returns whether it was over
    /// before.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`], and as the host fails.
    fn cancel(&mut self, request: &Request<'_>, after: Duration) -> Result<bool, UsbError>;

    /// Hands bytes to the host to send, and does not wait for them to go.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`], and as the host fails.
    fn send(&mut self, pipe: Pipe, bytes: &[u8]) -> Result<(), UsbError>;

    /// What came from the adapter, after a wait of this time at most for the first byte. Nothing when none came.
    ///
    /// # Errors
    ///
    /// As the transfer ends.
    fn receive(&mut self, pipe: Pipe, wait: Duration) -> Result<Vec<u8>, UsbError>;

    /// Clears the halt of an endpoint of the serial port, and puts the host's data toggle back to DATA0 (USB 2.0, 9.4.5).
    /// What the adapter has sent before is kept for [`receive`](Self::receive).
    ///
    /// # Errors
    ///
    /// As the request ends.
    fn clear_halt(&mut self, direction: Direction) -> Result<(), UsbError>;

    /// Selects the only setting of the serial port's data interface again, and puts the host's data toggles back to DATA0
    /// (USB 2.0, 9.4.10).
    ///
    /// # Errors
    ///
    /// As the request ends.
    fn set_interface(&mut self) -> Result<(), UsbError>;

    /// Selects the only configuration again, and puts all the host's data toggles back to DATA0 (USB 2.0, 9.1.1.5).
    ///
    /// # Errors
    ///
    /// As the request ends.
    fn set_configuration(&mut self) -> Result<(), UsbError>;

    /// Resets the bus, enumerates the adapter, and opens both pipes again. Bytes under way are lost.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`] if the adapter does not come back.
    fn reset(&mut self) -> Result<(), UsbError>;

    /// Waits for an adapter that starts again, and opens both pipes.
    ///
    /// # Errors
    ///
    /// [`UsbError::Gone`] if the adapter does not come back.
    fn reopen(&mut self) -> Result<(), UsbError>;

    /// Suspends the bus for this time, and resumes it.
    ///
    /// # Errors
    ///
    /// [`UsbError::Unsupported`] on a host that does not let programs suspend the bus.
    fn suspend(&mut self, span: Duration) -> Result<(), UsbError>;
}
