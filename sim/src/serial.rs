//! The seam between a virtual device and whatever line carries its bytes.

use armwire::time::Instant;

/// A device at the far end of a serial line: an arm, or a line with faults in front of one.
///
/// It does no I/O and reads no clock: time comes in with every call, in microseconds of the caller's clock, and never
/// runs backwards. Framing, baud rate and pacing belong to the line.
pub trait SerialDevice {
    /// Takes one byte whose stop bit ended at `now`.
    fn receive(&mut self, now: Instant, byte: u8);

    /// The next byte to put on the line, if one may start at `now`.
    ///
    /// Called again as soon as the line is free: the device need not know the baud rate.
    fn transmit(&mut self, now: Instant) -> Option<u8>;

    /// When the device next wants [`transmit`](Self::transmit) to be called, or `None` while only a received byte can
    /// give it something to say.
    fn poll_timeout(&self) -> Option<Instant>;
}

/// What a device has heard, since it was made.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[non_exhaustive]
pub struct Counters {
    /// Bytes.
    pub bytes: u64,
    /// Requests, obeyed or not.
    pub requests: u64,
    /// Requests that were answered.
    pub answered: u64,
    /// Requests that were not obeyed: answered by a failure, or not at all.
    pub refused: u64,
    /// Answers given up because too many were waiting for the line.
    pub overrun: u64,
    /// Good frames that are no request, or one with a value out of range. They are not answered.
    pub unknown: u64,
    /// Bytes that were not part of a frame.
    pub noise_bytes: u64,
    /// Bytes that came while the device was talking on the same wire, and were lost; none where each way has its own.
    pub collided: u64,
}
