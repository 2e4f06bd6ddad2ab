//! A frame's properties for the exchange, from its bytes alone.
//!
//! This layer is for firmware, monitors and implementations of other arms. It is less stable than the
//! [client](crate::Client): see [Stability](crate#stability).

use core::fmt::Debug;

use crate::framing::Framing;
use crate::time::Duration;

/// The effect of a request on the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Effect {
    /// No change. Requests with another effect are never repeated.
    Read,
    /// Motion.
    Motion,
    /// Torque on or off.
    Torque,
    /// Any other change, or an undocumented effect.
    Setting,
}

/// The timing of the response to a request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ResponseTiming {
    /// Maximum length of the response, in bytes on the wire.
    pub longest: u16,
    /// Maximum time between the last byte of the request and the first of the response.
    pub turnaround: Duration,
}

/// A request's properties for the exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RequestInfo<K, E> {
    /// The key of its response.
    pub key: K,
    /// The decoder's expectation until the response has arrived.
    pub expect: E,
    /// The timing of the response; `None` if the arm does not respond.
    pub response: Option<ResponseTiming>,
    /// Its effect on the arm.
    pub effect: Effect,
}

/// The [`RequestInfo`] of one kind of line.
pub type InfoOf<D> = RequestInfo<<D as Correlation>::Key, <D as Framing>::Expect>;

/// The requests and responses of one kind of line, and the matching between them.
///
/// It works on the bytes of frames without decoding messages, which is cheap enough for an adapter between a host and
/// an arm.
///
/// A request has one response, or none. For a request with several, such as one to all servos of a bus, an
/// implementation describes each response by an info of its own, and the program begins a send for each in the
/// [`Exchange`](crate::exchange::Exchange): a [client](crate::Client) ends its call with the first.
pub trait Correlation: Framing {
    /// True if requests have a number that their response repeats. Without a number, a missing response must arrive or
    /// expire before the next request with its key may be sent.
    const HAS_TRANSACTION_ID: bool = false;

    /// Returns true if the arm responds in the order of its requests: the response to a later one shows that an earlier
    /// one is lost.
    fn keeps_order(&self) -> bool {
        false
    }

    /// The part of a response that matches it to its request.
    type Key: Copy + Eq + Debug;

    /// A request's properties. An undocumented frame may belong to a newer arm: it counts as a setting with an answer,
    /// if its format allows. `None` if the frame cannot be a request.
    fn request(&self, frame: &[u8]) -> Option<RequestInfo<Self::Key, Self::Expect>>;

    /// Returns true if a frame from the arm is the response to the request with this key, whatever its values.
    ///
    /// A request must not match on a line that may echo it: its echo would be taken for the response. A protocol whose
    /// requests can have the form of a response [states](Self::echoes) that its line echoes; without a client, it needs a
    /// send whose [offset](crate::exchange::Handover::offset) is behind the echo.
    fn is_response_to(&self, key: Self::Key, frame: &[u8]) -> bool;

    /// Returns true if the line returns every request to its sender, as one wire for both directions does. A
    /// [client](crate::Client) then takes the first frame that equals its request for the echo, even if it has the form of
    /// a response. It knows the request in flight only: submit none before the echo of a cancelled one, and of one without
    /// a response, has arrived. Not needed where [`is_request`](Self::is_request) tells them apart.
    fn echoes(&self) -> bool {
        false
    }

    /// Returns true if a frame has the form of a request, and of no response: a [client](crate::Client) that receives it
    /// reports an echo. Always `false` for a protocol whose line echoes nothing.
    fn is_request(&self, _frame: &[u8]) -> bool {
        false
    }

    /// Writes the sender's number into a request, on protocols with a field for it.
    fn stamp(&self, _frame: &mut [u8], _number: u16) {}
}
