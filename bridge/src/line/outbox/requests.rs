//! The pending requests of all initiators other than the host on USB.

use armwire::correlation::{Correlation, Effect};
use heapless::Deque;

use crate::arm::Info;
use crate::config::ArmKind;
use crate::control::{Failure, FrameBytes, Initiator};
use armwire::time::Instant;

/// Capacity for pending requests from CAN.
const CAN_REQUESTS: usize = 2;

/// A pending request.
#[derive(Clone)]
pub(crate) struct Request {
    pub(crate) bytes: FrameBytes,
    /// Its properties for the exchange; `None` if it has none.
    pub(crate) info: Option<Info>,
    pub(crate) since: Instant,
}

impl Request {
    /// A request with these bytes. `None` if they are too many.
    pub(crate) fn new(kind: ArmKind, bytes: &[u8], since: Instant) -> Option<Self> {
        Some(Self {
            bytes: FrameBytes::from_slice(bytes).ok()?,
            info: kind.request(bytes),
            since,
        })
    }

    pub(crate) fn is_motion(&self) -> bool {
        self.info.is_some_and(|info| info.effect == Effect::Motion)
    }
}

pub(crate) enum StopRequest {
    /// Reads the joints. It has waited since then.
    Reading(Instant),
    /// Holds the arm.
    Hold(Request),
}

impl StopRequest {
    const fn since(&self) -> Instant {
        match self {
            Self::Reading(since) => *since,
            Self::Hold(request) => request.since,
        }
    }

    /// Returns true if it waits for no answer.
    fn is_urgent(&self) -> bool {
        match self {
            Self::Reading(_) => false,
            Self::Hold(request) => request.info.is_none_or(|info| info.response.is_none()),
        }
    }
}

/// An identification of the arm.
#[derive(Default)]
pub(crate) enum Identification {
    #[default]
    Idle,
    /// It has waited since then.
    Waiting(Instant),
    InFlight,
    /// The arm's answer, or `None` if it did not answer.
    Ended(Result<Option<FrameBytes>, Failure>),
}

impl Identification {
    /// The start of its wait.
    const fn since(&self) -> Option<Instant> {
        match self {
            Self::Waiting(since) => Some(*since),
            _ => None,
        }
    }

    /// The request goes out. Returns the start of its wait.
    pub(crate) fn take(&mut self) -> Option<Instant> {
        let since = self.since()?;
        *self = Self::InFlight;
        Some(since)
    }

    /// The arm answered the request in flight, or did not.
    pub(crate) fn end(&mut self, answer: Option<&[u8]>) {
        if let Self::InFlight = self {
            *self = Self::Ended(Ok(answer.and_then(|answer| FrameBytes::from_slice(answer).ok())));
        }
    }

    /// The result, once.
    pub(crate) fn take_result(&mut self) -> Option<Result<Option<FrameBytes>, Failure>> {
        match core::mem::take(self) {
            Self::Ended(result) => Some(result),
            other => {
                *self = other;
                None
            }
        }
    }
}

/// The pending requests.
#[derive(Default)]
pub(crate) struct Requests {
    /// Requests of hosts on CAN, in the order of arrival.
    pub(crate) can: Deque<Request, CAN_REQUESTS>,
    /// The newest cyclic command.
    pub(crate) command: Option<Request>,
    /// Start of the wait of torque-off.
    pub(crate) torque_off: Option<Instant>,
    pub(crate) stop: Option<StopRequest>,
    pub(crate) identification: Identification,
}

impl Requests {
    /// Returns true if no request is pending, which is the usual case.
    pub(crate) fn is_empty(&self) -> bool {
        self.can.is_empty()
            && self.command.is_none()
            && self.torque_off.is_none()
            && self.stop.is_none()
            && self.identification.since().is_none()
    }

    /// The next request of hosts on CAN, or the command.
    pub(crate) fn of(&self, initiator: Initiator) -> Option<&Request> {
        match initiator {
            Initiator::Can => self.can.front(),
            Initiator::Command => self.command.as_ref(),
            Initiator::Usb | Initiator::Poll | Initiator::Adapter => None,
        }
    }

    /// The start of the wait of the adapter's next request.
    pub(crate) fn of_adapter(&self) -> Option<Instant> {
        let stop = self.stop.as_ref().map(StopRequest::since);
        self.torque_off.or(stop).or(self.identification.since())
    }

    /// Returns true if torque-off or a hold waits, which wait for no answer.
    pub(crate) fn is_urgent(&self) -> bool {
        self.torque_off.is_some() || self.stop.as_ref().is_some_and(StopRequest::is_urgent)
    }

    /// The number of bytes in requests of hosts on CAN.
    pub(crate) fn can_bytes(&self) -> usize {
        self.can.iter().map(|request| request.bytes.len()).sum()
    }

    /// Start of the wait of the oldest motion of a host on CAN.
    pub(crate) fn can_motion_since(&self) -> Option<Instant> {
        self.can
            .iter()
            .find(|request| request.is_motion())
            .map(|request| request.since)
    }
}
