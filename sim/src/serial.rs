//! The interface between a virtual device and the line that carries its bytes.

use armwire::time::Instant;

/// A device at the far end of a serial line: an arm, or a line with faults in front of one.
///
/// The device does no I/O and reads no clock. Each call has the time, in microseconds of the caller's clock, which
/// never runs backwards. Framing, baud rate and pacing belong to the line.
pub trait SerialDevice {
    /// Takes one byte whose stop bit ended at `now`.
    fn receive(&mut self, now: Instant, byte: u8);

    /// Returns the next byte to transmit, if one may start at `now`.
    ///
    /// It is called again as soon as the line is free: the device need not know the baud rate.
    fn transmit(&mut self, now: Instant) -> Option<u8>;

    /// Returns the time of the next call of [`transmit`](Self::transmit). `None` if only a received byte can cause
    /// output.
    fn poll_timeout(&self) -> Option<Instant>;

    /// Takes the baud rate of the host. A device that hears every rate ignores it.
    fn set_baud(&mut self, _baud: u32) {}

    /// Returns true if the device has left the line for good. It takes and sends no more bytes.
    fn is_gone(&self) -> bool {
        false
    }
}

/// Receive and answer counters of a device, since its creation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Bytes received.
    pub bytes: u64,
    /// Requests, executed or not.
    pub requests: u64,
    /// Requests that were answered.
    pub answered: u64,
    /// Requests that were not executed: answered with a failure, or not at all.
    pub refused: u64,
    /// Answers dropped because the queue was full.
    pub overrun: u64,
    /// Valid frames that are no request, or have a value out of range. They are not answered.
    pub unknown: u64,
    /// Bytes that were not part of a frame.
    pub noise_bytes: u64,
    /// Bytes lost because the device was transmitting on the same wire. Always 0 on a full-duplex line.
    pub collided: u64,
}
