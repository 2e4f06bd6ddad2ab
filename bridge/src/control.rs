//! The control port's messages: identity, configuration, counters and events of an adapter.
//!
//! Both ends use the types in this file. A message is a struct in [postcard] format: a [`FromHost`] from the host, a
//! [`FromAdapter`] from the adapter. On USB each is COBS-encoded and ends with a zero byte; on CAN each is one ISO-TP
//! PDU.
//!
//! New variants are appended after the existing ones, and new fields at the end of a message, with a new [`VERSION`]. A
//! request that the adapter does not know or cannot decode gets [`Reply::Unsupported`]: a newer host learns the
//! adapter's version at once, and so does an older one whose request has gained fields since. An older host skips
//! trailing fields that it does not know. It can therefore read the version in an extended [`Identity`]. A request that
//! the adapter can only partly decode is never executed.
//!
//! [postcard]: https://postcard.jamesmunns.com

use core::fmt;

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::config::{ArmKind, Config, ConfigError, Saved};
use crate::counters::Counters;
#[cfg(fuzzing)]
use crate::fuzzing::{optional, text};
use crate::line_coding::LineCoding;
use armwire::time::Duration;

pub use crate::arm::MAX_FRAME;
use crate::control_codec::COBS;
pub use crate::control_codec::{MAX_MESSAGE, Malformed, Message, NoRoom, Reader, Reason, decode, encode, encode_cobs};

/// The version of this schema.
pub const VERSION: u16 = 7;

/// The longest event in postcard format, in bytes: a frame of [`MAX_FRAME`] bytes, its stamp and its initiator.
pub const MAX_EVENT: usize = 96;

/// The longest message on USB, in bytes: COBS adds one byte, one more for every 254, and the zero terminator.
pub const MAX_COBS: usize = MAX_MESSAGE + COBS;

/// A frame of an arm, in bytes as on the wire.
pub type FrameBytes = Vec<u8, MAX_FRAME>;

/// The bytes of any frame, for the fuzz targets.
#[cfg(fuzzing)]
fn frame(u: &mut arbitrary::Unstructured<'_>) -> arbitrary::Result<FrameBytes> {
    let len = u.int_in_range(0..=MAX_FRAME)?.min(u.len());
    Ok(FrameBytes::from_slice(u.bytes(len)?).unwrap_or_default())
}

/// A message from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct FromHost {
    /// Chosen by the host and repeated in the reply.
    pub sequence: u8,
    /// The request.
    pub request: Request,
}

/// A host's requests.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub enum Request {
    /// Identifies the adapter. Answered by [`Reply::Identity`].
    Identify,
    /// Identifies the arm, by a request to it. Answered by [`Reply::Arm`].
    IdentifyArm,
    /// Reads the configuration in force. Answered by [`Reply::Config`].
    GetConfig,
    /// Sets the configuration until the next start. Answered by [`Reply::Done`] or [`Reply::BadConfig`]; by
    /// [`Failure::StreamArmed`] if it changes the kind of arm while a stream is [armed](crate::Status::is_armed). An
    /// adapter [without CAN](Identity::no_can) accepts the factory defaults of the bus only.
    SetConfig(Config),
    /// Saves the configuration to flash. Answered by [`Reply::Done`] once it is written, or [`Reply::Failed`].
    SaveConfig,
    /// Erases the saved configuration, and then restores the factory defaults. Answered as [`Request::SaveConfig`].
    ResetConfig,
    /// Reads the counters. Answered by [`Reply::Counters`].
    GetCounters,
    /// Reads the latencies. Answered by [`Reply::Latencies`].
    GetLatencies,
    /// Subscribes this port to events. Answered by [`Reply::Done`].
    Subscribe(Subscription),
    /// Restarts the firmware. Answered by [`Reply::Done`] before it happens. If a stream of motion is
    /// [armed](crate::Status::is_armed), torque-off goes out first.
    Restart,
    /// Restarts into the chip's boot loader, for an update. Answered by [`Reply::Done`] before it happens.
    RestartIntoBootLoader,
    /// Ends the stream of motion of this port's host without torque-off: of the host on USB's serial port, or of all
    /// hosts on CAN. Answered by [`Reply::Done`]. Since version 2.
    EndStream,
    /// Reads the state of the line. Answered by [`Reply::Line`]. Since version 3.
    GetLine,
    /// Reserves the line for the host on USB for [`RESERVATION_MS`]: no polls, no CAN, no torque-off. Answered by
    /// [`Reply::Done`]; by [`Failure::StreamArmed`] while a host streams motion; and by [`Failure::Busy`] while a host on
    /// the other control port has reserved the line, or while the adapter stops the arm. Each repetition renews the
    /// reservation. Since version 3.
    ///
    /// A USB device cannot detect that a program closes the control port. The reservation therefore ends with
    /// [`ReleaseLine`](Self::ReleaseLine), after its time, or when the port's host is gone.
    ReserveLine,
    /// Ends the reservation of the same port. Answered by [`Reply::Done`]. Since version 3.
    ReleaseLine,
    /// Stops the arm, whoever moves it: motion that waits is dropped, all streams of motion end with the torque on, the
    /// arm is held as by [`armwire::ling::Stop`], and further motion is [refused](Refusal::Stopped) for [`STOP_MS`]. Each
    /// repetition renews that time. Since version 5.
    ///
    /// Answered by [`Reply::Done`] once the hold goes to the arm, or if the arm has no torque: nothing is sent to it then,
    /// nor while torque-off waits. Answered by [`Failure::LineReserved`] during a requested reservation and by
    /// [`Failure::NotStoppable`], without any effect; by [`Failure::ArmSilent`] and [`Failure::PoseOutOfRange`], with
    /// motion refused; and by [`Failure::Busy`] if an earlier stop of this port is not answered yet, which it renews.
    Stop,
    /// Reads whether the adapter is in [recovery](crate::start). Answered by [`Reply::Recovery`]. Since version 5.
    GetRecovery,
    /// Reads the configuration in flash, which a [`SaveConfig`](Self::SaveConfig) overwrites. Answered by
    /// [`Reply::Saved`], or as [`Request::SaveConfig`] if it fails. Since version 5.
    GetSaved,
    /// Reads the [stop](Self::Stop) in force. Answered by [`Reply::Stop`]. Since version 7.
    GetStop,
}

/// The time without motion after a [`Request::Stop`], in milliseconds.
pub const STOP_MS: u16 = 2_000;

/// Duration of a reservation by [`Request::ReserveLine`], in milliseconds. Renew it at least every third of that.
pub const RESERVATION_MS: u16 = 10_000;

/// The events that a host subscribes to.
///
/// A subscription lasts until the next one. On USB it also ends with the cable, a bus reset or another configuration of
/// the device; on CAN with a change of the bus or the node id. The adapter cannot distinguish a killed program from a
/// suspended host, which must get events again after it resumes. Events that do not fit are dropped and counted. A
/// program should therefore begin with a subscription, possibly to nothing, and skip the events before its reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Subscription {
    /// Every frame of the arm: [`Event::Frame`].
    pub frames: bool,
    /// The adapter's own activity: every other [`Event`].
    pub events: bool,
}

/// A message from the adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[allow(clippy::large_enum_variant, reason = "one at a time, and no heap to put it on")]
pub enum FromAdapter {
    /// The answer to a request.
    Reply {
        /// The sequence number of the request.
        sequence: u8,
        /// The answer.
        reply: Reply,
    },
    /// An event that the host has subscribed to.
    Event {
        /// Time of the event by the adapter's clock; for a frame, the arrival of its last byte. The clock counts from
        /// the start and is monotonic.
        at: Stamp,
        /// The event.
        event: Event,
    },
}

impl Message for FromHost {
    const MAY_GROW: bool = false;

    const MAX_MISSING: usize = 0;

    fn may_lack(&self, _: usize) -> bool {
        false
    }

    fn sequence(bytes: &[u8]) -> Option<u8> {
        bytes.first().copied()
    }
}

impl Message for FromAdapter {
    const MAY_GROW: bool = true;

    const MAX_MISSING: usize = Counters::MAX_MISSING;

    fn may_lack(&self, numbers: usize) -> bool {
        match self {
            Self::Reply {
                reply: Reply::Counters(counters),
                ..
            } => counters.may_lack(numbers),
            Self::Reply {
                reply: Reply::Identity(identity),
                ..
            } => match identity.version {
                ..6 => numbers == 2,
                6 => numbers == 1,
                _ => false,
            },
            _ => false,
        }
    }

    fn sequence(bytes: &[u8]) -> Option<u8> {
        match bytes {
            [0, sequence, ..] => Some(*sequence),
            _ => None,
        }
    }
}

/// An instant on the adapter's clock, in microseconds since it started.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Stamp(pub u64);

/// The adapter's answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[allow(clippy::large_enum_variant, reason = "one at a time, and no heap to put it on")]
#[non_exhaustive]
pub enum Reply {
    /// The request was executed.
    Done,
    /// The adapter does not know the request.
    Unsupported {
        /// The adapter's [`VERSION`].
        version: u16,
    },
    /// The adapter's identity.
    Identity(Identity),
    /// The arm's identity.
    Arm(ArmIdentity),
    /// The configuration in force.
    Config(Config),
    /// The configuration was rejected and not applied.
    BadConfig(ConfigError),
    /// All counts since the start.
    Counters(#[serde(serialize_with = "crate::counters::serialize")] Counters),
    /// Latency histograms.
    Latencies(Latencies),
    /// The request failed.
    Failed(Failure),
    /// The line to the arm. Since version 3.
    Line(LineState),
    /// The state of [recovery](crate::start). After crashed starts the adapter runs with factory settings, its CAN
    /// controller is off, and the configuration in flash is untouched. A successful save ends it. Since version 5.
    Recovery {
        /// True in recovery.
        active: bool,
    },
    /// The configuration in flash. Since version 5.
    Saved(Saved),
    /// The stop in force. `None` if motion is not refused for one. Since version 7.
    Stop(Option<StopInForce>),
}

/// A [`Request::Stop`] whose refusal of motion has not ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct StopInForce {
    /// The host that requested it last: on USB or on CAN.
    pub by: Initiator,
    /// Time until motion passes, in milliseconds, rounded up.
    pub left_ms: u16,
}

/// The line to the arm, and its reservation.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct LineState {
    /// The UART's line coding.
    pub coding: LineCoding,
    /// The arm's own line coding, of the configured [`ArmKind`].
    pub arm: LineCoding,
    /// The reservation of the line.
    pub reservation: LineReservation,
    /// A line coding that has not taken effect yet: the bytes before it are still going out, or the host on USB has set
    /// it and it must wait.
    pub waiting: Option<LineCoding>,
}

/// Reservation of the line to the arm for the host on USB. Meanwhile polls and CAN are
/// [refused](Refusal::LineReserved).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum LineReservation {
    /// All initiators take turns.
    #[default]
    None,
    /// The host on USB has set a rate other than the arm's.
    OtherRate,
    /// A control port has requested it by [`Request::ReserveLine`].
    Requested,
}

/// The reason for a failed request.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Failure {
    /// The configuration could not be written to flash.
    Flash,
    /// Another request of this kind is still pending.
    Busy,
    /// A host streams motion. A save, a reset or a change of the kind of arm fails only if the stream is
    /// [armed](crate::Status::is_armed). Since version 2.
    StreamArmed,
    /// Saves are too frequent for the endurance of the flash (see [`store`](crate::store)). Since version 2.
    TooManySaves {
        /// Time until the next save is possible, in seconds.
        wait_s: u16,
    },
    /// The line is [reserved](LineReservation) for the host on USB. Since version 3.
    LineReserved,
    /// The supply voltage is too low to erase or program the flash. The saved configuration stays. Since version 3.
    SupplyLow,
    /// The arm did not answer in the time of a [`Request::Stop`]: it may still move. Since version 5.
    ArmSilent,
    /// The arm reports a pose that no move can express, or is not an Alicia-D: it is not held, and may still move. Since
    /// version 5.
    PoseOutOfRange,
    /// The adapter cannot stop this kind of arm. Since version 5.
    NotStoppable(ArmKind),
    /// The flash has no room without an erase, which would stall the adapter, and a host has the serial port open: DTR is
    /// high. A start of the adapter makes room, and so does a save while the port is closed. Since version 7.
    NoRoom,
}

/// An adapter's identity.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Identity {
    /// The [`VERSION`] of this schema.
    pub version: u16,
    /// The firmware's version, for example `0.1.0`.
    #[cfg_attr(fuzzing, arbitrary(with = text))]
    pub firmware: String<16, u8>,
    /// The commit it was built from, for example `1a2b3c4d5e6f`, followed by `+` for a modified tree; empty if unknown.
    #[cfg_attr(fuzzing, arbitrary(with = text))]
    pub commit: String<16, u8>,
    /// The board, for example `stm32f405`.
    #[cfg_attr(fuzzing, arbitrary(with = text))]
    pub board: String<16, u8>,
    /// The chip's unique id: the serial number, in hexadecimal.
    #[cfg_attr(fuzzing, arbitrary(with = text))]
    pub serial: String<24, u8>,
    /// True if the board supports CAN FD.
    pub can_fd: bool,
    /// True if the board has no CAN. False from an adapter of an older version, which does not tell. Since version 6.
    pub no_can: bool,
    /// The chip's kind and revision as its register has them: DBGMCU_IDCODE of an STM32, CHIP_ID of an RP2040. 0 from an
    /// adapter of an older version, which does not tell. Since version 7.
    pub chip: u32,
}

/// The arm's identity.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct ArmIdentity {
    /// The configured kind of arm.
    pub kind: ArmKind,
    /// The arm's answer to its identification request, as on the wire. `None` without an answer, or if the arm has no
    /// such request.
    #[cfg_attr(fuzzing, arbitrary(with = |u: &mut _| optional(u, frame)))]
    pub answer: Option<FrameBytes>,
}

/// An event for subscribers.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[non_exhaustive]
pub enum Event {
    /// The arm sent a frame.
    Frame {
        /// The initiator that it answers; `None` if unsolicited.
        initiator: Option<Initiator>,
        /// The frame.
        #[cfg_attr(fuzzing, arbitrary(with = frame))]
        bytes: FrameBytes,
    },
    /// A host that streamed motion has gone silent, or another kind of arm was configured. The host's unsent bytes were
    /// dropped.
    HostSilent {
        /// The initiator.
        initiator: Initiator,
        /// Bytes dropped.
        dropped: u16,
        /// True if the torque was switched off.
        torque_off: bool,
    },
    /// A request was refused. The counter of that name has the number of refusals.
    Refused {
        /// The initiator.
        initiator: Initiator,
        /// The reason.
        reason: Refusal,
    },
    /// The CAN controller went bus-off, or recovered.
    BusOff {
        /// True for bus-off.
        off: bool,
    },
    /// The adapter is in [recovery](crate::start), reported after each subscription to events, or has left it by a save.
    /// Since version 5.
    Recovery {
        /// True in recovery.
        active: bool,
    },
}

/// An initiator of requests to the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Initiator {
    /// The host on USB.
    Usb,
    /// A host on CAN, by ISO-TP.
    Can,
    /// The adapter's own poll.
    Poll,
    /// Cyclic command frames on CAN.
    Command,
    /// The adapter itself, for a request on the control port, a stop or the torque-off of a silent host.
    Adapter,
}

impl Initiator {
    /// All initiators, in the order of turns.
    pub(crate) const ALL: [Self; 5] = [Self::Usb, Self::Can, Self::Poll, Self::Command, Self::Adapter];
}

/// The reason for a refusal.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
#[non_exhaustive]
pub enum Refusal {
    /// The queue is full.
    QueueFull,
    /// The bytes are no frame of this arm.
    NotAFrame,
    /// The other half of a command did not arrive in time, or never.
    Incomplete,
    /// The sequence number of a command is not newer.
    Stale,
    /// A value of a command is out of range.
    OutOfRange,
    /// The line is [reserved](LineReservation) for the host on USB. Only the first refused poll is reported. Since
    /// version 3.
    LineReserved,
    /// Bytes of the host on USB for a rate that is not in effect: while a host on CAN streams motion, and after
    /// torque-off or a stop until the host sets the rate again. Only the first are reported. Since version 3.
    OtherRate,
    /// Motion in the time of a [`Request::Stop`]. Of the host on USB only the first is reported. Since version 5.
    Stopped,
}

impl Refusal {
    /// All refusals.
    pub(crate) const ALL: [Self; 8] = [
        Self::QueueFull,
        Self::NotAFrame,
        Self::Incomplete,
        Self::Stale,
        Self::OutOfRange,
        Self::LineReserved,
        Self::OtherRate,
        Self::Stopped,
    ];

    /// The initiators that are refused for this reason.
    pub(crate) const fn initiators(self) -> &'static [Initiator] {
        use Initiator::{Adapter, Can, Command, Poll, Usb};
        match self {
            Self::QueueFull | Self::NotAFrame => &[Can, Command],
            Self::Incomplete | Self::Stale | Self::OutOfRange => &[Command],
            Self::LineReserved => &[Can, Poll, Command, Adapter],
            Self::OtherRate => &[Usb],
            Self::Stopped => &[Usb, Can, Command],
        }
    }
}

/// Latency histograms.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Latencies {
    /// From the last byte of a request to the last byte of its answer.
    pub answer: Histogram,
    /// From a request's arrival at the adapter to its first byte on the line.
    pub turn: Histogram,
    /// From a poll's slot to its first byte on the line.
    pub poll: Histogram,
}

/// A histogram of durations by powers of two.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(fuzzing, derive(arbitrary::Arbitrary))]
pub struct Histogram {
    /// Number of durations under 2, 4, 8, … 32 768 µs that are in no bucket before. The last bucket has all longer
    /// ones.
    pub counts: [u32; Histogram::BUCKETS],
}

impl Histogram {
    /// Number of buckets.
    pub const BUCKETS: usize = 16;

    /// Adds one duration.
    ///
    /// ```
    /// use armwire_bridge::Duration;
    /// use armwire_bridge::control::Histogram;
    ///
    /// let mut histogram = Histogram::default();
    /// histogram.add(Duration::from_micros(5));
    /// assert_eq!(histogram.counts[2], 1);
    /// assert_eq!(Histogram::limit(2), Some(Duration::from_micros(8)));
    /// ```
    pub fn add(&mut self, duration: Duration) {
        let magnitude = duration.as_micros().checked_ilog2().unwrap_or(0) as usize;
        if let Some(count) = self.counts.get_mut(magnitude.min(Self::BUCKETS - 1)) {
            *count = count.wrapping_add(1);
        }
    }

    /// The upper limit of this bucket, exclusive; `None` for the last.
    pub const fn limit(bucket: usize) -> Option<Duration> {
        if bucket < Self::BUCKETS - 1 {
            Some(Duration::from_micros(2 << bucket))
        } else {
            None
        }
    }
}

impl fmt::Display for Initiator {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(match self {
            Self::Usb => "usb",
            Self::Can => "can",
            Self::Poll => "poll",
            Self::Command => "command",
            Self::Adapter => "adapter",
        })
    }
}

impl fmt::Display for Refusal {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::QueueFull => "queue full",
            Self::NotAFrame => "no frame of this arm",
            Self::Incomplete => "incomplete command",
            Self::Stale => "stale command",
            Self::OutOfRange => "value out of range",
            Self::LineReserved => "the line is reserved for USB",
            Self::OtherRate => "rate not in effect",
            Self::Stopped => "the arm was stopped",
        })
    }
}

impl fmt::Display for StopInForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let by = match self.by {
            Initiator::Usb => "a host on USB",
            Initiator::Can => "a host on CAN",
            _ => "the adapter",
        };
        let tenths = self.left_ms.div_ceil(100);
        let (seconds, rest) = (tenths / 10, tenths % 10);
        write!(f, "motion is refused for {seconds}.{rest} s more: stopped by {by}")
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn initiator_and_refusal_reason_have_readable_texts() {
        let names = ["usb", "can", "poll", "command", "adapter"];
        assert_eq!(Initiator::ALL.map(|initiator| initiator.to_string()), names);
        assert_eq!(Refusal::Stale.to_string(), "stale command");
        let stop = StopInForce {
            by: Initiator::Can,
            left_ms: 1_101,
        };
        let text = "motion is refused for 1.2 s more: stopped by a host on CAN";
        assert_eq!(stop.to_string(), text);
    }

    #[test]
    fn duration_counts_in_first_bucket_above_it() {
        let limits = core::array::from_fn::<_, { Histogram::BUCKETS }, _>(Histogram::limit);
        for micros in [0, 1, 2, 3, 4, 7, 8, 16_383, 16_384, 32_767, 32_768, 65_536, u64::MAX] {
            let mut histogram = Histogram::default();
            histogram.add(Duration::from_micros(micros));
            let below = |limit: &Option<Duration>| limit.is_none_or(|limit| micros < limit.as_micros());
            let bucket = limits.iter().position(below).unwrap();
            assert_eq!(histogram.counts[bucket], 1, "{micros} µs");
        }
        assert_eq!(limits.iter().position(Option::is_none), Some(Histogram::BUCKETS - 1));
    }
}
