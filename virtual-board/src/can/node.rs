//! The other nodes on the bus, and their reception of frames.

use std::collections::VecDeque;

use armwire_sim::can::{BitTimes, Frame, OnTheWire};

use super::confinement::Confinement;
use super::wait::Wait;
use super::{Capability, ErrorState};
use crate::time::Nanos;

/// Maximum difference of compatible rates, in parts per thousand. Oscillators may each be off by 1.58 % at best (ISO
/// 11898-1).
const TOLERANCE: u64 = 10;

/// The configuration of a node: its rates, and the frames that it supports (ISO 11898-1).
///
/// Rates are in bits per second. A rate of 0 counts as 1.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NodeConfig {
    pub(super) bit: u64,
    pub(super) capability: Capability,
    pub(super) is_silent: bool,
}

impl NodeConfig {
    /// A classic node. While it is error active it destroys FD frames with error frames.
    pub fn classic(rate: u32) -> Self {
        Self {
            bit: BitTimes::new(rate, rate).nominal,
            capability: Capability::Classic,
            is_silent: false,
        }
    }

    /// A classic node that neither receives, acknowledges nor disturbs FD frames.
    pub fn fd_tolerant(rate: u32) -> Self {
        Self {
            capability: Capability::FdTolerant,
            ..Self::classic(rate)
        }
    }

    /// A node for classic and FD frames, with `data_rate` in the data phase of FD frames that switch the bit rate.
    pub fn fd(rate: u32, data_rate: u32) -> Self {
        let data_bit = BitTimes::new(rate, data_rate).data;
        Self {
            capability: Capability::Fd { data_bit },
            ..Self::classic(rate)
        }
    }

    /// The same node as listen-only: it sends no frame, no acknowledge and no error flag.
    #[must_use]
    pub fn silent(self) -> Self {
        Self {
            is_silent: true,
            ..self
        }
    }

    pub(crate) fn sends(&self, frame: &Frame) -> bool {
        !self.is_silent && (frame.fd.is_none() || matches!(self.capability, Capability::Fd { .. }))
    }

    pub(super) fn times(&self) -> BitTimes {
        times(self.bit, self.capability)
    }

    pub(super) fn reception(&self, frame: &Frame, sender: BitTimes) -> Reception {
        reception(frame, sender, self.bit, self.capability)
    }
}

/// A node without a data phase of its own uses nominal bits.
pub(super) fn times(bit: u64, capability: Capability) -> BitTimes {
    let data = match capability {
        Capability::Fd { data_bit } => data_bit,
        Capability::Classic | Capability::FdTolerant => bit,
    };
    BitTimes { nominal: bit, data }
}

/// A node's reception of another's frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Reception {
    /// It receives the frame and acknowledges it.
    Follows,
    /// It waits for the end of the frame.
    Ignores,
    /// It detects an error after this many bits.
    Fails(u32),
}

/// The reception by a node of a frame from a sender with these bit times.
///
/// A node with another nominal rate detects its error at the acknowledge slot. One that cannot decode the data phase or
/// the format of an FD frame detects it at the CRC delimiter. On a real bus both may detect it earlier: these are the
/// latest instants.
pub(super) fn reception(frame: &Frame, sender: BitTimes, bit: u64, capability: Capability) -> Reception {
    if !fit(sender.nominal, bit) {
        return Reception::Fails(frame.bits_through_acknowledge());
    }
    match (frame.fd, capability) {
        (None, _) => Reception::Follows,
        (Some(_), Capability::FdTolerant) => Reception::Ignores,
        (Some(flags), Capability::Fd { data_bit }) if !flags.bit_rate_switch || fit(sender.data, data_bit) => {
            Reception::Follows
        }
        (Some(_), Capability::Classic | Capability::Fd { .. }) => Reception::Fails(frame.bits_before_crc_delimiter()),
    }
}

/// Returns true if bit times of `a` and `b` picoseconds are compatible.
fn fit(a: u64, b: u64) -> bool {
    a.abs_diff(b) * 1_000 <= TOLERANCE * a.max(b)
}

/// A node with its own configuration, error counters and received frames.
#[derive(Debug)]
pub(super) struct Node {
    pub(super) config: NodeConfig,
    pub(super) confinement: Confinement,
    /// The wait before it takes part in the bus.
    pub(super) wait: Option<Wait>,
    /// The earliest start of its transmissions.
    pub(super) free: Nanos,
    pub(super) received: VecDeque<Frame>,
}

impl Node {
    /// A node that joins a bus which is recessive `since` then.
    pub(super) fn new(config: NodeConfig, since: Option<Nanos>) -> Self {
        Self {
            config,
            confinement: Confinement::default(),
            wait: Some(Wait::new(1, since)),
            free: Nanos(0),
            received: VecDeque::new(),
        }
    }

    pub(super) fn takes_part(&self) -> bool {
        self.wait.is_none()
    }

    /// Returns true if it destroys invalid frames.
    pub(super) fn destroys(&self) -> bool {
        !self.config.is_silent && self.confinement.state() == ErrorState::Active
    }

    /// The end of its wait.
    pub(super) fn due(&self) -> Option<Nanos> {
        self.wait?.due(self.config.bit)
    }

    /// Its wait has ended.
    pub(super) fn waited(&mut self) {
        self.wait = None;
        if self.confinement.state() == ErrorState::BusOff {
            self.confinement.recover();
        }
    }
}
