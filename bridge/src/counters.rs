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
    /// Times the receive ring was overwritten before it was read, or nearly: what was in it is dropped. How many bytes were
    /// lost is not known.
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

impl Counters {
    /// How many there are.
    pub const COUNT: usize = 21;

    /// How many bytes they take, each four, little-endian.
    pub const LEN: usize = 4 * Self::COUNT;

    /// The USB control request that reads them: type 0xC0 (vendor, from the device) and its number. Value and index are 0,
    /// the answer is [`to_bytes`](Self::to_bytes).
    pub const READ_REQUEST: (u8, u8) = (0xC0, 0x01);

    /// What each is called, in the order in which they are declared, which is that of the bytes too.
    pub const NAMES: [&str; Self::COUNT] = [
        "arm_to_host_bytes",
        "host_to_arm_bytes",
        "packets_to_host",
        "empty_packets_to_host",
        "packets_from_host",
        "frames",
        "noise_bytes",
        "dropped_bytes",
        "unheard_bytes",
        "refused_bytes",
        "framing_errors",
        "parity_errors",
        "noise_errors",
        "overrun_errors",
        "ring_overruns",
        "usb_resets",
        "usb_suspends",
        "line_codings",
        "refused_line_codings",
        "panics",
        "watchdog_resets",
    ];

    /// The counts, in the order of [`NAMES`](Self::NAMES).
    ///
    /// ```
    /// use armwire_bridge::Counters;
    ///
    /// let mut counters = Counters::default();
    /// counters.frames = 7;
    /// let named = Counters::NAMES.into_iter().zip(counters.to_array());
    /// assert!(named.filter(|&(_, count)| count > 0).eq([("frames", 7)]));
    /// ```
    pub const fn to_array(&self) -> [u32; Self::COUNT] {
        [
            self.arm_to_host_bytes,
            self.host_to_arm_bytes,
            self.packets_to_host,
            self.empty_packets_to_host,
            self.packets_from_host,
            self.frames,
            self.noise_bytes,
            self.dropped_bytes,
            self.unheard_bytes,
            self.refused_bytes,
            self.framing_errors,
            self.parity_errors,
            self.noise_errors,
            self.overrun_errors,
            self.ring_overruns,
            self.usb_resets,
            self.usb_suspends,
            self.line_codings,
            self.refused_line_codings,
            self.panics,
            self.watchdog_resets,
        ]
    }

    /// The counts as the adapter sends them.
    ///
    /// ```
    /// use armwire_bridge::Counters;
    ///
    /// let mut counters = Counters::default();
    /// counters.panics = 2;
    /// assert_eq!(Counters::from_bytes(&counters.to_bytes()), counters);
    /// ```
    pub fn to_bytes(&self) -> [u8; Self::LEN] {
        let mut bytes = [0; Self::LEN];
        for (bytes, count) in bytes.as_chunks_mut().0.iter_mut().zip(self.to_array()) {
            *bytes = count.to_le_bytes();
        }
        bytes
    }

    /// The counts that the adapter sent.
    pub fn from_bytes(bytes: &[u8; Self::LEN]) -> Self {
        let mut counts = [0; Self::COUNT];
        for (count, bytes) in counts.iter_mut().zip(bytes.as_chunks().0) {
            *count = u32::from_le_bytes(*bytes);
        }
        let [
            arm_to_host_bytes,
            host_to_arm_bytes,
            packets_to_host,
            empty_packets_to_host,
            packets_from_host,
            frames,
            noise_bytes,
            dropped_bytes,
            unheard_bytes,
            refused_bytes,
            framing_errors,
            parity_errors,
            noise_errors,
            overrun_errors,
            ring_overruns,
            usb_resets,
            usb_suspends,
            line_codings,
            refused_line_codings,
            panics,
            watchdog_resets,
        ] = counts;
        Self {
            arm_to_host_bytes,
            host_to_arm_bytes,
            packets_to_host,
            empty_packets_to_host,
            packets_from_host,
            frames,
            noise_bytes,
            dropped_bytes,
            unheard_bytes,
            refused_bytes,
            framing_errors,
            parity_errors,
            noise_errors,
            overrun_errors,
            ring_overruns,
            usb_resets,
            usb_suspends,
            line_codings,
            refused_line_codings,
            panics,
            watchdog_resets,
        }
    }
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_count_has_its_own_place_in_the_bytes() {
        for place in 0..Counters::COUNT {
            let mut bytes = [0; Counters::LEN];
            bytes[4 * place] = 9;
            let counters = Counters::from_bytes(&bytes);
            assert_eq!(counters.to_bytes(), bytes);
            let mut expected = [0; Counters::COUNT];
            expected[place] = 9;
            assert_eq!(counters.to_array(), expected);
        }
    }
}
