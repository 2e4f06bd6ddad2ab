//! Whose turn it is to speak to the arm.

use crate::{Duration, Instant};

use crate::arm::Asked;
use crate::config::ArmKind;
use crate::control::{FrameBytes, Initiator};

/// A request that waits for its turn.
#[derive(Clone)]
pub(crate) struct Waiting {
    pub(crate) bytes: FrameBytes,
    pub(crate) asked: Asked,
    pub(crate) since: Instant,
}

impl Waiting {
    /// One with these bytes. `None` if they are too many.
    pub(crate) fn new(kind: ArmKind, bytes: &[u8], since: Instant) -> Option<Self> {
        Some(Self {
            bytes: FrameBytes::from_slice(bytes).ok()?,
            asked: kind.asked(bytes),
            since,
        })
    }
}

/// How long after another's turn the host on USB counts as one of several.
const SHARED: Duration = Duration::from_millis(1_000);

/// Who had the line last, and for how long the host on USB has had or wanted it.
pub(crate) struct Turn {
    pub(crate) last: Initiator,
    /// Who had it last of those that take turns, as a poll that must be on time does not.
    pub(crate) rotated: Initiator,
    /// When the last poll went out.
    pub(crate) polled: Instant,
    /// When another than the host on USB last had the line.
    pub(crate) others_had: Option<Instant>,
    /// Bytes of the host on USB went out that are in no request.
    pub(crate) raw: bool,
    /// What the host on USB said last was cut short, so that the arm may wait for the rest of a frame.
    pub(crate) is_cut: bool,
    /// When the host on USB began to speak.
    pub(crate) usb_began: Instant,
    /// When bytes of the host on USB last went out, or began to wait.
    pub(crate) usb_moved: Instant,
    /// When the oldest and the newest of the bytes that wait came, as far as that is known.
    oldest: Instant,
    newest: Instant,
    /// How long the first byte of the request that is going out has waited.
    waited: Duration,
    /// When anything for the arm last moved.
    line_moved: Instant,
}

impl Turn {
    pub(crate) const fn new() -> Self {
        Self {
            last: Initiator::Adapter,
            rotated: Initiator::Adapter,
            polled: Instant::ZERO,
            others_had: None,
            raw: false,
            is_cut: false,
            usb_began: Instant::ZERO,
            usb_moved: Instant::ZERO,
            oldest: Instant::ZERO,
            newest: Instant::ZERO,
            waited: Duration::ZERO,
            line_moved: Instant::ZERO,
        }
    }

    /// The host on USB said something, behind which nothing waited if it is the `first`.
    pub(crate) fn usb_queued(&mut self, first: bool, now: Instant) {
        self.newest = now;
        if first {
            (self.oldest, self.usb_moved) = (now, now);
        }
    }

    /// Bytes of the host on USB went out, of which the first began a request if it is the `first`.
    pub(crate) fn usb_went(&mut self, first: bool, now: Instant) {
        if first {
            self.waited = now.since(self.oldest);
        }
        self.oldest = self.newest;
        (self.usb_moved, self.line_moved) = (now, now);
    }

    /// How long the request of the host on USB has waited that went out last.
    pub(crate) const fn usb_waited(&self) -> Duration {
        self.waited
    }

    /// Whether another than the host on USB had the line not long ago.
    pub(crate) fn is_shared(&self, now: Instant) -> bool {
        self.others_had.is_some_and(|at| now.since(at) < SHARED)
    }

    /// `initiator` has the line, and goes to the end of the row if it is `in_turn`.
    pub(crate) fn taken(&mut self, initiator: Initiator, in_turn: bool) {
        self.last = initiator;
        if in_turn {
            self.rotated = initiator;
        }
    }

    /// Something for the arm moved, or may move again.
    pub(crate) fn went(&mut self, now: Instant) {
        self.line_moved = now;
    }

    /// Since when nothing has moved that could have.
    pub(crate) fn moved(&self) -> Instant {
        self.usb_moved.max(self.line_moved)
    }
}

/// Whose turn comes after that of `initiator`.
pub(crate) const fn behind(initiator: Initiator) -> Initiator {
    match initiator {
        Initiator::Usb => Initiator::Can,
        Initiator::Can => Initiator::Poll,
        Initiator::Poll => Initiator::Command,
        Initiator::Command => Initiator::Adapter,
        Initiator::Adapter => Initiator::Usb,
    }
}
