//! A burst: the bytes that are handed to the UART at once.

use armwire::time::Instant;

use crate::arm::Info;
use crate::control::Initiator;
use crate::line_coding::UartConfig;

/// The next work of the UART.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Transmit {
    /// It sends bytes.
    Burst {
        /// The number of bytes, at least 1.
        len: usize,
        /// Start of the first byte, at most the [lead time](crate::Bridge::set_poll_lead_time) of polls ahead: wait for it,
        /// and send nothing in between. `None`: start at once.
        start: Option<Instant>,
    },
    /// Reconfigure the UART after the last bit is out, then report [`Configured`](crate::UartEvent::Configured).
    Configure(UartConfig),
}

/// A burst for the UART, to be accounted for when it goes out.
pub(crate) struct Burst {
    pub(crate) initiator: Initiator,
    pub(crate) len: usize,
    pub(crate) start: Option<Instant>,
    /// The request, if it is tracked. Bytes of the host on USB are decoded after they went out.
    pub(crate) info: Option<Info>,
    /// Start of the request's wait.
    pub(crate) since: Option<Instant>,
    pub(crate) kind: BurstKind,
}

#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum BurstKind {
    /// Bytes of the host on USB.
    Host,
    Request,
    TorqueOn,
    /// A stop holds the arm.
    Hold,
    /// A stop reads the joints.
    Reading,
    /// Zeros that end a frame that the arm may have received in part.
    Zeros,
}

impl Burst {
    /// Bytes without a request of their own.
    pub(super) const fn of_bytes(initiator: Initiator, kind: BurstKind, len: usize) -> Self {
        Self {
            initiator,
            len,
            start: None,
            info: None,
            since: None,
            kind,
        }
    }

    /// The start of the first byte, if the UART was ready at `now`.
    pub(crate) fn began(&self, now: Instant) -> Instant {
        self.start.unwrap_or(now)
    }
}
