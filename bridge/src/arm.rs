//! The arm on the UART: its framing, its exchanges and the adapter's own requests, chosen by the configured kind.

use armwire::alpha1::{self, Alpha1};
use armwire::correlation::{Correlation, Effect, InfoOf, RequestInfo};
use armwire::framing::{Framing, LONGEST_VOID, Length, Scan};
use armwire::ling::{self, Ling};
use armwire::raw::Raw;

use crate::config::ArmKind;
use crate::line_coding::{LineCoding, UartConfig};

/// The longest frame that the adapter accepts, in bytes: Ling's. Alpha1 frames with names over 65 bytes are longer.
pub const MAX_FRAME: usize = 70;
const _: () = assert!(MAX_FRAME == armwire::ling::MAX_FRAME);

/// The expectation on a line of any kind: only Alpha1's frames need one.
pub type Expect = alpha1::Expect;

/// The key of a response of any kind.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Key {
    /// Key of a Ling response.
    Ling(ling::Key),
    /// Key of a response of an Alpha1 or of its servos.
    Alpha1(alpha1::Key),
    /// A raw line has no responses.
    Raw,
}

/// A request's properties for the exchange.
pub type Info = InfoOf<ArmKind>;

/// A request that the adapter makes by itself.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum OwnRequest {
    /// Reads the joints, or the running servos.
    Poll,
    /// Reads the arm's kind and version.
    Identify,
    TorqueOff,
    /// Stops the running action.
    Stop,
}

impl ArmKind {
    /// The UART for this kind, until a host sets another line coding.
    pub(crate) const fn uart(self) -> UartConfig {
        let baud = match self {
            Self::Ling | Self::Raw => LineCoding::LING.baud,
            Self::Alpha1 | Self::Alpha1Servo => 115_200,
        };
        UartConfig {
            coding: LineCoding {
                baud,
                ..LineCoding::LING
            },
            half_duplex: matches!(self, Self::Alpha1Servo),
        }
    }

    /// Returns true if the arm has a fixed rate. A raw line has the rate that the host on USB sets.
    pub(crate) const fn has_own_rate(self) -> bool {
        !matches!(self, Self::Raw)
    }

    /// The frame of a request. `None` if this kind of arm does not take it.
    pub(crate) const fn own(self, request: OwnRequest) -> Option<&'static [u8]> {
        match (self, request) {
            (Self::Ling, OwnRequest::Poll) => Some(&ling::READ_JOINTS),
            (Self::Ling, OwnRequest::Identify) => Some(&ling::READ_INFO),
            (Self::Ling, OwnRequest::TorqueOff) => Some(&ling::TORQUE_OFF),
            (Self::Alpha1, OwnRequest::Poll) => Some(&alpha1::READ_SERVO_STATES),
            (Self::Alpha1, OwnRequest::Identify) => Some(&alpha1::READ_FIRMWARE_VERSION),
            (Self::Alpha1, OwnRequest::Stop) => Some(&alpha1::STOP),
            _ => None,
        }
    }

    /// Returns true if `frame` switches the torque on and leaves the arm where it is.
    pub(crate) fn is_torque_on(self, frame: &[u8]) -> bool {
        self == Self::Ling && frame == ling::TORQUE_ON
    }

    /// Returns true if `bytes` are exactly one frame from a host.
    pub(crate) fn is_request(self, bytes: &[u8]) -> bool {
        match self {
            Self::Raw => (1..=MAX_FRAME).contains(&bytes.len()),
            _ => self.scan(bytes, self.requests()) == Scan::Frame(bytes.len()),
        }
    }

    /// Returns true if a PDU of `len` bytes that begins with `start` moves the arm, as far as `start` shows: it has the
    /// header and the length of a frame, and its checksum if the frame is whole.
    pub(crate) fn is_motion(self, start: &[u8], len: usize) -> bool {
        let frame_len = match self.scan(start, self.requests()) {
            Scan::Frame(len) => len,
            Scan::Need(missing) => start.len().saturating_add(missing),
            Scan::Noise(..) | Scan::Padding(_) | Scan::Broken(_) => return false,
        };
        frame_len == len && len <= MAX_FRAME && self.request(start).is_some_and(|info| info.effect == Effect::Motion)
    }
}

impl Framing for ArmKind {
    const VOID: Option<usize> = Some(LONGEST_VOID);
    type Expect = Expect;

    fn scan(&self, window: &[u8], expect: Expect) -> Scan {
        match self {
            Self::Ling => Ling.scan(window, ()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.scan(window, expect),
            Self::Raw => Raw.scan(window, ()),
        }
    }

    fn scan_idle(&self, window: &[u8], expect: Expect) -> Scan {
        match self {
            Self::Ling => Ling.scan_idle(window, ()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.scan_idle(window, expect),
            Self::Raw => Raw.scan_idle(window, ()),
        }
    }

    fn terminator(&self, expect: Expect) -> Option<u8> {
        match self {
            Self::Ling => Ling.terminator(()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.terminator(expect),
            Self::Raw => Raw.terminator(()),
        }
    }

    fn length(&self, expect: Expect) -> Option<Length> {
        match self {
            Self::Ling => Ling.length(()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.length(expect),
            Self::Raw => Raw.length(()),
        }
    }

    fn shortest(&self, expect: Expect) -> usize {
        match self {
            Self::Ling => Ling.shortest(()),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1.shortest(expect),
            // A raw line has no frames to wait for.
            Self::Raw => MAX_FRAME,
        }
    }

    fn requests(&self) -> Expect {
        Alpha1.requests()
    }

    fn unsolicited(&self) -> Expect {
        Alpha1.unsolicited()
    }
}

impl Correlation for ArmKind {
    type Key = Key;

    fn keeps_order(&self) -> bool {
        match self {
            Self::Ling => Ling.keeps_order(),
            Self::Alpha1 | Self::Alpha1Servo | Self::Raw => false,
        }
    }

    fn request(&self, frame: &[u8]) -> Option<Info> {
        match self {
            Self::Ling => Ling
                .request(frame)
                .map(|info| with(info, Key::Ling(info.key), self.unsolicited())),
            Self::Alpha1 | Self::Alpha1Servo => Alpha1
                .request(frame)
                .map(|info| with(info, Key::Alpha1(info.key), info.expect)),
            Self::Raw => Raw.request(frame).map(|info| with(info, Key::Raw, self.unsolicited())),
        }
    }

    fn is_response_to(&self, key: Key, frame: &[u8]) -> bool {
        match key {
            Key::Ling(key) => Ling.is_response_to(key, frame),
            Key::Alpha1(key) => Alpha1.is_response_to(key, frame),
            Key::Raw => Raw.is_response_to((), frame),
        }
    }
}

/// Converts a request's key and expectation to the adapter's types.
fn with<K, E>(info: RequestInfo<K, E>, key: Key, expect: Expect) -> Info {
    RequestInfo {
        key,
        expect,
        response: info.response,
        effect: info.effect,
    }
}
