//! The control port's messages: what an adapter is, how it is configured, what it has counted and seen.
//!
//! Both ends are made of the types in this file. A message is a struct in [postcard] format: from the host a
//! [`FromHost`], from the adapter a [`FromAdapter`]. On USB each is COBS-encoded and ends with a zero byte; on CAN each is
//! one ISO-TP PDU.
//!
//! Variants are only ever added behind the others, and fields where a message ends, with a new [`VERSION`]. A request that
//! an adapter does not know, or that it cannot read, gets [`Reply::Unsupported`], so a host that is newer than the adapter
//! finds out at once; so does an older one whose request has more fields by now. A host that is older than the adapter passes
//! over what comes behind the fields that it knows, so it can read the version in an [`Identity`] that has grown. The
//! adapter does nothing that it understands in part only.
//!
//! [postcard]: https://postcard.jamesmunns.com

use core::fmt;

use heapless::{String, Vec};
use serde::{Deserialize, Serialize};

use crate::config::{ArmKind, Config, ConfigError};
use crate::counters::Counters;
use crate::line_coding::LineCoding;
use armwire::time::Duration;

pub use crate::arm::MAX_FRAME;
use crate::control_codec::COBS;
pub use crate::control_codec::{MAX_MESSAGE, Malformed, Message, NoRoom, Reader, Reason, decode, encode, encode_cobs};

/// The version of this schema.
pub const VERSION: u16 = 4;

/// The longest event in postcard format, in bytes: a frame of [`MAX_FRAME`] bytes, and when and for whom it came.
pub const MAX_EVENT: usize = 96;

/// The longest message on USB, in bytes: COBS adds a byte in 254 and one, and the zero that ends it.
pub const MAX_COBS: usize = MAX_MESSAGE + COBS;

/// A frame of an arm, in bytes as on the wire.
pub type FrameBytes = Vec<u8, MAX_FRAME>;

/// A message from the host.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct FromHost {
    /// Chosen by the host, and in the reply to this request.
    pub sequence: u8,
    /// What it wants.
    pub request: Request,
}

/// What a host may ask.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Request {
    /// What are you? Answered by [`Reply::Identity`].
    Identify,
    /// What arm is there? The adapter asks the arm. Answered by [`Reply::Arm`].
    IdentifyArm,
    /// Answered by [`Reply::Config`], the one in force.
    GetConfig,
    /// Be so from now on, until the next start. Answered by [`Reply::Done`] or [`Reply::BadConfig`].
    SetConfig(Config),
    /// Be so from the next start on, too. Answered by [`Reply::Done`] once it is in flash, or [`Reply::Failed`].
    SaveConfig,
    /// Forget what was saved, and be as from the factory. Answered as [`Request::SaveConfig`].
    ResetConfig,
    /// Answered by [`Reply::Counters`].
    GetCounters,
    /// Answered by [`Reply::Latencies`].
    GetLatencies,
    /// Tell me of these things as they happen, on the port that this came by. Answered by [`Reply::Done`].
    Subscribe(Subscription),
    /// Start again. Answered by [`Reply::Done`] before it happens. If a stream of motion is
    /// [armed](crate::Status::is_armed), torque-off goes out first.
    Restart,
    /// Start the chip's own boot loader, for an update. Answered by [`Reply::Done`] before it happens.
    RestartIntoBootLoader,
    /// End the stream of motion of this port's host without switching the torque off: of USB's serial port, or of all hosts
    /// on CAN. Answered by [`Reply::Done`]. Since version 2.
    EndStream,
    /// Answered by [`Reply::Line`]. Since version 3.
    GetLine,
    /// Hold the line for the host on USB alone for [`HOLD_LEASE_MS`]: no polls, no CAN, no torque-off. Answered by
    /// [`Reply::Done`]; by [`Failure::StreamArmed`] while a host streams motion, and by [`Failure::Busy`] while a host on the
    /// other control port holds the line. Each further request renews the lease. Since version 3.
    ///
    /// A USB device does not see that a program closes the control port. So the hold ends with
    /// [`ReleaseLine`](Self::ReleaseLine), with the lease, and when the host on that port is gone.
    HoldLine,
    /// End what [`HoldLine`](Self::HoldLine) on the same port began. Answered by [`Reply::Done`]. Since version 3.
    ReleaseLine,
}

/// How long [`Request::HoldLine`] holds the line, in milliseconds. Renew it at least every third of that.
pub const HOLD_LEASE_MS: u16 = 10_000;

/// What a host wants to be told of.
///
/// It is told until it subscribes to something else. On USB that ends with the cable, a reset of the bus or another
/// configuration of the device; on CAN when the bus or the node id is another one. The adapter cannot know that a program
/// was killed: to it that looks like a host that is asleep, which is to be told on when it wakes. Until somebody reads, what
/// does not fit is dropped and counted. So a program subscribes to what it wants, nothing perhaps, before all else, and
/// passes over events that come before the reply.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Subscription {
    /// Every frame the arm sends: [`Event::Frame`].
    pub frames: bool,
    /// What the adapter does by itself: every other [`Event`].
    pub events: bool,
}

/// A message from the adapter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "one at a time, and no heap to put it on")]
pub enum FromAdapter {
    /// The answer to a request.
    Reply {
        /// The request's.
        sequence: u8,
        /// The answer.
        reply: Reply,
    },
    /// What a host has subscribed to.
    Event {
        /// When it was, by the adapter's clock: for a frame, when its last byte was in. The clock counts from the start and
        /// never goes back.
        at: Stamp,
        /// What happened.
        event: Event,
    },
}

impl Message for FromHost {
    const MAY_GROW: bool = false;

    const SINCE_OLDER: &'static [usize] = &[];

    fn has_grown(&self) -> bool {
        false
    }

    fn sequence(bytes: &[u8]) -> Option<u8> {
        bytes.first().copied()
    }
}

impl Message for FromAdapter {
    const MAY_GROW: bool = true;

    const SINCE_OLDER: &'static [usize] = Counters::SINCE_OLDER;

    fn has_grown(&self) -> bool {
        matches!(
            self,
            Self::Reply {
                reply: Reply::Counters(_),
                ..
            }
        )
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
pub struct Stamp(pub u64);

/// The adapter's answers.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[allow(clippy::large_enum_variant, reason = "one at a time, and no heap to put it on")]
pub enum Reply {
    /// It is done.
    Done,
    /// The request is not one that this adapter knows.
    Unsupported {
        /// The [`VERSION`] that it knows.
        version: u16,
    },
    /// What the adapter is.
    Identity(Identity),
    /// What arm there is.
    Arm(ArmIdentity),
    /// The configuration in force.
    Config(Config),
    /// The adapter cannot be like that, and stays as it is.
    BadConfig(ConfigError),
    /// All counts since the start.
    Counters(#[serde(serialize_with = "crate::counters::serialize")] Counters),
    /// How long things took.
    Latencies(Latencies),
    /// It could not be done.
    Failed(Failure),
    /// The line to the arm. Since version 3.
    Line(LineState),
}

/// The line to the arm, and who holds it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct LineState {
    /// How the UART works.
    pub coding: LineCoding,
    /// The arm's own line coding, of the configured [`ArmKind`].
    pub arm: LineCoding,
    /// The holder of the line.
    pub holder: LineHolder,
    /// The line coding that has not taken effect yet: the UART changes to it once the bytes before are out, or the host on
    /// USB has set it and it may not take effect now.
    pub waiting: Option<LineCoding>,
}

/// The user that has the line to the arm alone. Polls and CAN are [refused](Refusal::LineHeld) meanwhile.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum LineHolder {
    /// Nobody. All take turns.
    #[default]
    Nobody,
    /// The host on USB, because it has set another rate than the arm's.
    OtherRate,
    /// The host on USB, by [`Request::HoldLine`].
    HoldLine,
}

/// Why something could not be done.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Failure {
    /// The flash does not take the configuration.
    Flash,
    /// Another request of this kind is still being answered.
    Busy,
    /// A host streams motion. For a save or reset, only where its stream is [armed](crate::Status::is_armed): the core stands
    /// still while it writes flash. Since version 2.
    StreamArmed,
    /// The adapter was told to save so often that its flash would wear out (see [`store`](crate::store)). Since version 2.
    TooManySaves {
        /// In how many seconds the next save may come.
        wait_s: u16,
    },
    /// The host on USB [holds the line](LineHolder). Since version 3.
    LineHeld,
    /// The supply is too low to erase or program the flash. The configuration saved before stays. Since version 3.
    SupplyLow,
}

/// What an adapter is.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Identity {
    /// The [`VERSION`] of this schema.
    pub version: u16,
    /// The firmware's version, such as `0.1.0`.
    pub firmware: String<16, u8>,
    /// The commit it was built from, such as `1a2b3c4d5e6f`, with `+` behind it if files were changed; empty if not known.
    pub commit: String<16, u8>,
    /// The board, such as `stm32f405`.
    pub board: String<16, u8>,
    /// The chip's unique id: the serial number, in hexadecimal.
    pub serial: String<24, u8>,
    /// Whether the board's CAN is CAN FD.
    pub can_fd: bool,
}

/// What arm there is.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct ArmIdentity {
    /// What the adapter is configured for.
    pub kind: ArmKind,
    /// The arm's answer to the request that identifies it, as on the wire: `None` when it did not answer, or when there is
    /// no such request.
    pub answer: Option<FrameBytes>,
}

/// What an adapter tells of by itself.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub enum Event {
    /// The arm sent a frame.
    Frame {
        /// Who had asked for it, `None` if nobody.
        initiator: Option<Initiator>,
        /// The frame.
        bytes: FrameBytes,
    },
    /// A host that streamed motion has fallen silent, and what it had sent and was not on the line yet is dropped. Or what it
    /// moved is there no more: the arm is configured to be of another kind.
    HostSilent {
        /// Which.
        initiator: Initiator,
        /// Bytes dropped.
        dropped: u16,
        /// Whether the torque was switched off.
        torque_off: bool,
    },
    /// Something was refused; the counter of that name says how often.
    Refused {
        /// Whose it was.
        initiator: Initiator,
        /// Why.
        reason: Refusal,
    },
    /// The CAN controller left the bus, or is back on it.
    BusOff {
        /// Whether it is off.
        off: bool,
    },
}

/// Who uses the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
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
    /// The adapter itself, for a request on the control port or the torque-off of a silent host.
    Adapter,
}

impl Initiator {
    /// Everybody, in the order of turns.
    pub(crate) const ALL: [Self; 5] = [Self::Usb, Self::Can, Self::Poll, Self::Command, Self::Adapter];
}

/// Why something was refused.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Refusal {
    /// Too much waits already.
    QueueFull,
    /// It is no frame of this arm.
    NotAFrame,
    /// A command whose other half did not come in time, or never.
    Incomplete,
    /// A command whose sequence number is not a new one.
    Stale,
    /// A command with a value out of range.
    OutOfRange,
    /// The host on USB [holds the line](LineHolder). Of polls only the first is told. Since version 3.
    LineHeld,
    /// Bytes of the host on USB for another rate than the arm's, which does not take effect while a host on CAN streams
    /// motion, nor after a torque-off before the host sets it again. Of these only the first are told. Since version 3.
    OtherRate,
}

/// How long things took, each as counts of how often it took how long.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Latencies {
    /// From a request's last byte to its answer's last byte.
    pub answer: Histogram,
    /// From a request's arrival at the adapter to its first byte on the line.
    pub turn: Histogram,
    /// From a poll's slot to its first byte on the line.
    pub poll: Histogram,
}

/// Durations by their magnitude.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Histogram {
    /// How many were shorter than 2, 4, 8, … 32 768 µs and not shorter than half that; the last is of all longer ones.
    pub counts: [u32; Histogram::BUCKETS],
}

impl Histogram {
    /// How many magnitudes there are.
    pub const BUCKETS: usize = 16;

    /// Counts one duration.
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

    /// The duration that those in this bucket are shorter than; `None` for the last.
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
            Self::QueueFull => "too much waits already",
            Self::NotAFrame => "no frame of this arm",
            Self::Incomplete => "half a command",
            Self::Stale => "not a new command",
            Self::OutOfRange => "a value out of range",
            Self::LineHeld => "the host on USB holds the line",
            Self::OtherRate => "another rate than the line has",
        })
    }
}

#[cfg(test)]
mod tests {
    extern crate std;

    use std::string::ToString;

    use super::*;

    #[test]
    fn who_asked_and_why_it_was_refused_can_be_read() {
        let names = ["usb", "can", "poll", "command", "adapter"];
        assert_eq!(Initiator::ALL.map(|initiator| initiator.to_string()), names);
        assert_eq!(Refusal::Stale.to_string(), "not a new command");
    }

    #[test]
    fn a_duration_counts_in_the_first_bucket_whose_limit_it_is_below() {
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
