//! Counters of traffic, losses and refusals.

use serde::ser::SerializeTuple;
use serde::{Deserialize, Serialize, Serializer};

use crate::control_codec::{Malformed, NoRoom, read, read_older, write};

/// Declares the counters and their list, so that each name is written once.
macro_rules! counters {
    ($(#[$meta:meta])* pub struct Counters { $($(#[$doc:meta])* pub $name:ident: u32,)* }) => {
        $(#[$meta])*
        pub struct Counters {
            $($(#[$doc])* pub $name: u32,)*
        }

        impl Counters {
            /// Number of counters.
            pub const COUNT: usize = [$(stringify!($name)),*].len();

            /// The counters with their names, in wire order.
            pub fn iter(&self) -> impl Iterator<Item = (&'static str, u32)> {
                [$((stringify!($name), self.$name)),*].into_iter()
            }

            /// All counters, in wire order.
            const fn counts(&mut self) -> [&mut u32; Self::COUNT] {
                [$(&mut self.$name),*]
            }
        }
    };
}

counters! {
    /// Counters since the adapter's start, and of its resets since power-on. Each wraps at 2³².
    ///
    /// ```
    /// use armwire_bridge::Counters;
    ///
    /// let mut counters = Counters::default();
    /// counters.panics = 2;
    /// let mut buf = [0; Counters::MAX_LEN];
    /// let bytes = counters.to_bytes(&mut buf).unwrap();
    /// assert_eq!(Counters::from_bytes(bytes), Ok(counters));
    /// ```
    #[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
    #[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
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
        /// Bytes from the arm outside of frames. They were passed on like all others.
        pub noise_bytes: u32,
        /// Bytes from the arm dropped because the host did not read and the queue was full.
        pub dropped_bytes: u32,
        /// Bytes from the arm dropped because they arrived while the port was closed, or before it was opened. The
        /// packet in the USB peripheral at a disconnection is not counted: its delivery is unknown.
        pub undelivered_bytes: u32,
        /// Bytes from the host dropped because its packet did not fit. The count stays 0 if firmware checks
        /// [`Status::usb_room`](crate::Status::usb_room).
        pub refused_bytes: u32,
        /// Framing errors the UART reported.
        pub framing_errors: u32,
        /// Parity errors the UART reported.
        pub parity_errors: u32,
        /// Noise the UART reported.
        pub noise_errors: u32,
        /// Overruns the UART reported: a byte arrived before the last one was read.
        pub overrun_errors: u32,
        /// Times the receive ring was overwritten, or nearly, before it was read. Its content is dropped. The number of
        /// lost bytes is unknown.
        pub ring_overruns: u32,
        /// USB bus resets.
        pub usb_resets: u32,
        /// Times the USB bus was suspended.
        pub usb_suspends: u32,
        /// Line codings that took effect.
        pub line_codings: u32,
        /// Line codings that the UART does not support.
        pub refused_line_codings: u32,
        /// Panics of the firmware since power-on.
        pub panics: u32,
        /// Resets by the watchdog since power-on.
        pub watchdog_resets: u32,
        /// Requests of the host on USB that went to the arm. Bytes outside of requests are not counted here.
        pub requests_usb: u32,
        /// Requests of hosts on CAN that went to the arm.
        pub requests_can: u32,
        /// The adapter's own polls that went to the arm.
        pub requests_poll: u32,
        /// Cyclic commands on CAN that went to the arm.
        pub requests_command: u32,
        /// Requests of the adapter itself that went to the arm, see [`Initiator::Adapter`](crate::control::Initiator),
        /// and bursts of zeros before a request to end a frame: four of at most 70 bytes, 261 bytes together.
        pub requests_adapter: u32,
        /// Requests of all these initiators whose answer did not arrive in time.
        pub unanswered_requests: u32,
        /// Answers that arrived later than that. No initiator receives them as its answer.
        pub late_answers: u32,
        /// Unsolicited frames of the arm.
        pub unsolicited_frames: u32,
        /// Polls that went out after their slot, because another exchange had to end first or because the previous
        /// answer was missing.
        pub late_polls: u32,
        /// Slots without a poll, because the previous poll had not ended.
        pub missed_polls: u32,
        /// Requests and control messages from CAN refused because the queue was full, because they were too long, or
        /// because the bus was reconfigured; and commands from CAN that a newer one replaced.
        pub refused_can_requests: u32,
        /// PDUs from CAN refused because they are no frame of this arm, command frames of a length other than 8 bytes,
        /// and requests that waited when the kind of arm changed.
        pub refused_can_frames: u32,
        /// Frames of the arm for a host on CAN dropped because the queue was full, or because they waited when the bus
        /// was reconfigured.
        pub dropped_can_answers: u32,
        /// ISO-TP transfers that failed, in either direction: see [`isotp::Error`](crate::isotp::Error). Transfers in
        /// progress at bus-off or at a reconfiguration are included.
        pub isotp_failures: u32,
        /// CAN frames received from the bus.
        pub can_frames_received: u32,
        /// CAN frames handed to the CAN controller. All but [`dropped_can_frames`](Self::dropped_can_frames) of them go
        /// out.
        pub can_frames_sent: u32,
        /// Receive overruns of the CAN controller: frames were lost because they were not read in time.
        pub can_receive_overruns: u32,
        /// Errors that the CAN controller saw on the bus.
        pub can_bus_errors: u32,
        /// Times the CAN controller went bus-off because of too many errors. It recovers by itself, and counts as
        /// recovered after 20 ms without an error.
        pub can_bus_offs: u32,
        /// Commands whose other half did not arrive in time, or before a reconfiguration.
        pub commands_incomplete: u32,
        /// Commands whose sequence number was not newer.
        pub commands_stale: u32,
        /// Commands with a value out of the arm's range.
        pub commands_out_of_range: u32,
        /// Times a host that streamed motion went silent, or lost its arm because another kind was configured.
        pub host_silences: u32,
        /// Unsent bytes dropped because their host went silent.
        pub silenced_bytes: u32,
        /// Messages from hosts on the control port.
        pub control_requests: u32,
        /// Messages on the control port that this adapter does not know.
        pub control_unsupported: u32,
        /// Events dropped before they reached a subscriber or went out as plain CAN frames, because the queue was full
        /// or the bus was reconfigured. On a bus without other nodes, such frames never go out.
        pub dropped_events: u32,
        /// Times a configuration was saved in flash, or the saved one was erased.
        pub config_saves: u32,
        /// Failed saves, plus one if the saved configuration could not be read at the start, or is invalid on this
        /// board: the adapter then has the factory defaults.
        pub config_failures: u32,
        /// CAN frames that had not left the CAN controller 10 ms after a reconfiguration of the bus was due.
        pub dropped_can_frames: u32,
        /// Requests and commands from CAN and requests of the adapter refused because the line was reserved for
        /// the host on USB, and times a reservation began while polling was on.
        pub refused_line_reserved: u32,
        /// Times the host on USB began to send bytes for a rate that was not in effect.
        pub refused_other_rate: u32,
        /// Bytes refused for that reason, and bytes that waited for another rate when torque-off or a stop took the
        /// line.
        pub refused_rate_bytes: u32,
        /// Hard faults of the firmware since power-on.
        pub hard_faults: u32,
        /// Frames whose last byte was missed by the interrupt handler. Their stamp is later: the time of the idle line,
        /// or of the read of the ring.
        pub late_stamps: u32,
        /// Requests of the host on USB that exceeded the number of tracked requests. Their answers count as
        /// unsolicited.
        pub untracked_requests: u32,
        /// Motions refused because the arm was stopped, waiting ones included, and requests of the host on USB that a
        /// stop cut.
        pub refused_stopped: u32,
        /// Starts in [recovery](crate::start) since power-on.
        pub recovery_starts: u32,
        /// Voids of the host on USB: 261 zeros, by which its client ended an incomplete request.
        pub voids_usb: u32,
    }
}

impl Counters {
    /// Maximum count of counters that an older version of the control port lacks at the end.
    pub(crate) const MAX_MISSING: usize = 9;

    /// Maximum size on the control port, in bytes.
    pub const MAX_LEN: usize = 5 * Self::COUNT;

    /// The USB control request that reads the counters without an open port: type 0xC0 (vendor, from the device) and
    /// its number. Value and index are 0, the answer is [`to_bytes`](Self::to_bytes).
    pub const READ_REQUEST: (u8, u8) = (0xC0, 0x01);

    /// Encodes the counters in postcard format, at the front of `buf`.
    ///
    /// # Errors
    ///
    /// [`NoRoom`] if `buf` is too short; never with [`MAX_LEN`](Self::MAX_LEN) bytes.
    pub fn to_bytes<'a>(&self, buf: &'a mut [u8]) -> Result<&'a [u8], NoRoom> {
        let len = write(&Row(self), buf)?;
        Ok(buf.get(..len).unwrap_or_default())
    }

    /// Decodes an adapter's counters. Counters of a later version are skipped; those that an older version lacks are 0.
    ///
    /// # Errors
    ///
    /// [`Malformed`] for version 1, or if `bytes` are no counters.
    ///
    /// ```
    /// use armwire_bridge::Counters;
    /// use armwire_bridge::control::Reason;
    ///
    /// let error = Counters::from_bytes(&[7, 1]).unwrap_err();
    /// assert_eq!(error.reason, Reason::EndsEarly);
    /// ```
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, Malformed> {
        read(bytes)
            .map(|(counters, _)| counters)
            .or_else(|reason| read_older(bytes, Self::MAX_MISSING, Self::may_lack).ok_or(reason))
            .map_err(|reason| Malformed { sequence: None, reason })
    }

    /// Returns true for the counts of counters at the end that versions 4, 3 and 2 of the control port lack.
    pub(crate) const fn may_lack(&self, counters: usize) -> bool {
        matches!(counters, 3 | 4 | Self::MAX_MISSING)
    }

    /// The increments since an earlier state of the counters, which wrap.
    #[must_use]
    pub fn since(mut self, mut earlier: Self) -> Self {
        for (count, earlier) in self.counts().into_iter().zip(earlier.counts()) {
            *count = count.wrapping_sub(*earlier);
        }
        self
    }

    /// The sums of these counters and those of the adapter's other side.
    pub(crate) fn plus(&self, other: &Self) -> Self {
        let (mut sum, mut other) = (*self, *other);
        for (sum, other) in sum.counts().into_iter().zip(other.counts()) {
            *sum = sum.wrapping_add(*other);
        }
        sum
    }
}

/// [`Counters`] for serde: the bytes of the derived format, by a loop instead of a call for each counter, which takes
/// 0.9 kB.
struct Row<'a>(&'a Counters);

impl Serialize for Row<'_> {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        let mut counters = *self.0;
        let mut row = serializer.serialize_tuple(Counters::COUNT)?;
        for count in counters.counts() {
            row.serialize_element(count)?;
        }
        row.end()
    }
}

/// Serializes counters as part of a message.
pub(crate) fn serialize<S: Serializer>(counters: &Counters, serializer: S) -> Result<S::Ok, S::Error> {
    Row(counters).serialize(serializer)
}

/// Receive errors since the last report.
///
/// ```
/// use armwire_bridge::time::Instant;
/// use armwire_bridge::{Bridge, UartErrors, UartEvent};
///
/// let mut bridge = Bridge::default();
/// let errors = UartErrors { framing: 1, noise: 1, ..UartErrors::default() };
/// bridge.uart_event(UartEvent::Errors(errors), Instant::ZERO);
/// assert_eq!(bridge.counters().framing_errors, 1);
/// ```
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct UartErrors {
    /// Bytes without a stop bit.
    pub framing: u32,
    /// Bytes with wrong parity.
    pub parity: u32,
    /// Bytes with noise.
    pub noise: u32,
    /// Times a byte arrived before the last one was read.
    pub overrun: u32,
    /// Times the receive ring was overwritten before it was read.
    pub ring_overrun: u32,
    /// Frames whose last byte was missed by the interrupt handler: their stamps are late.
    pub late_stamps: u32,
}

/// Errors that a CAN controller reports together.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct CanErrors {
    /// Errors on the bus.
    pub bus: u32,
    /// Receive overruns: frames were lost because they were not read in time.
    pub overruns: u32,
    /// Frames in the controller that were not sent when it was reinitialised.
    pub unsent: u32,
}

/// Adds `n`, wrapping.
pub(crate) fn count(counter: &mut u32, n: usize) {
    *counter = counter.wrapping_add(n as u32);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn increments_survive_a_wrap() {
        let counters = |frames, panics| Counters {
            frames,
            panics,
            ..Counters::default()
        };
        assert_eq!(counters(2, 7).since(counters(u32::MAX, 7)), counters(3, 0));
    }

    #[test]
    fn counters_have_their_names_in_wire_order() {
        let mut counters = Counters::default();
        for (n, count) in (1..).zip(counters.counts()) {
            *count = n;
        }
        assert!(counters.iter().map(|(_, count)| count).eq(1..=Counters::COUNT as u32));
        let mut names = counters.iter().map(|(name, _)| name);
        assert_eq!(names.next(), Some("arm_to_host_bytes"));
        assert_eq!(
            counters.iter().find(|(name, _)| *name == "frames"),
            Some(("frames", counters.frames))
        );
    }

    #[test]
    fn longest_counts_fit() {
        // Every count at its maximum takes five bytes; `from_bytes` decodes that many repetitions.
        let most = [[0xFF, 0xFF, 0xFF, 0xFF, 0x0F]; Counters::COUNT];
        let counters = Counters::from_bytes(most.as_flattened()).unwrap();
        assert_eq!(counters.voids_usb, u32::MAX);
        let mut buf = [0; Counters::MAX_LEN];
        assert_eq!(counters.to_bytes(&mut buf).unwrap(), most.as_flattened());
        assert!(counters.to_bytes(&mut [0; Counters::MAX_LEN - 1]).is_err());
    }
}
