//! What the adapter has seen, lost and refused.

/// Counts since the adapter started, and how often it did. Each wraps at 2³².
///
/// ```
/// let counters = armwire_bridge::Bridge::<256, 128>::new().counters();
/// assert_eq!(counters, armwire_bridge::Counters::default());
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub struct Counters {
    /// Bytes the UART received from the arm.
    pub arm_to_host_bytes: u32,
    /// Bytes handed to the UART for the arm.
    pub host_to_arm_bytes: u32,
    /// USB packets handed over for the host, zero-length ones included.
    pub packets_to_host: u32,
    /// Zero-length packets among them.
    pub empty_packets_to_host: u32,
    /// USB packets taken from the host.
    pub packets_from_host: u32,
    /// Frames the arm sent.
    pub frames: u32,
    /// Bytes from the arm that were in no frame. They were passed on like all others.
    pub noise_bytes: u32,
    /// Bytes from the arm dropped because the host did not read and the queue was full.
    pub dropped_bytes: u32,
    /// Bytes from the arm dropped because no host had the port open when they came, or when it was opened.
    pub unheard_bytes: u32,
    /// Bytes from the host dropped because it sent a packet there was no room for. Firmware that asks
    /// [`Bridge::usb_room`](crate::Bridge::usb_room) never sees this count.
    pub refused_bytes: u32,
    /// Framing errors the UART reported.
    pub framing_errors: u32,
    /// Parity errors the UART reported.
    pub parity_errors: u32,
    /// Noise the UART reported.
    pub noise_errors: u32,
    /// Overruns the UART reported: a byte arrived before the last one was taken.
    pub overrun_errors: u32,
    /// Times the receive ring was overwritten before it was read. How many bytes were lost is not known.
    pub ring_overruns: u32,
    /// USB bus resets.
    pub usb_resets: u32,
    /// Times the USB bus was suspended.
    pub usb_suspends: u32,
    /// Line codings that took effect.
    pub line_codings: u32,
    /// Line codings the UART cannot do.
    pub refused_line_codings: u32,
    /// Panics of the firmware since power-on.
    pub panics: u32,
    /// Resets by the watchdog since power-on.
    pub watchdog_resets: u32,
}

/// Errors a UART reports together, as its status register does.
///
/// ```
/// use armwire_bridge::{Bridge, UartErrors};
///
/// let mut bridge = Bridge::<256, 128>::new();
/// bridge.uart_errors(UartErrors { framing: 1, noise: 1, ..UartErrors::default() });
/// assert_eq!(bridge.counters().framing_errors, 1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UartErrors {
    /// Bytes without a stop bit.
    pub framing: u32,
    /// Bytes with wrong parity.
    pub parity: u32,
    /// Bytes whose samples disagreed.
    pub noise: u32,
    /// Times a byte arrived before the last one was taken.
    pub overrun: u32,
}
