//! The part of a frame in its exchange, from its bytes alone.

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

/// The response that a request gets, as far as time is concerned.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct ResponseTiming {
    /// The longest that the response may be, in bytes on the wire.
    pub longest: u16,
    /// The longest time between the last byte of the request and the first of the response.
    pub turnaround: Duration,
}

/// The part of a request in its exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RequestInfo<K, E> {
    /// The key of its response.
    pub key: K,
    /// The expectation of the line until the response has arrived.
    pub expect: E,
    /// The response to wait for; `None` if the arm does not respond.
    pub response: Option<ResponseTiming>,
    /// Its effect on the arm.
    pub effect: Effect,
}

/// A [`RequestInfo`] of this dialect.
pub type InfoOf<D> = RequestInfo<<D as Dialect>::Key, <D as Framing>::Expect>;

/// The requests and responses of one kind of line, and their assignment to each other.
///
/// It works on the bytes of frames and makes no messages of them, so an adapter between a host and an arm can afford it.
pub trait Dialect: Framing {
    /// Whether a request has a number that its response repeats. Where it has none, a response that is missing must be waited
    /// for, or given up, before the next request of its key may go.
    const HAS_TRANSACTION_ID: bool = false;

    /// The part of a response that assigns it to its request.
    type Key: Copy + Eq + Debug;

    /// The part of a host's frame in its exchange. A frame with a good envelope that the document does not have may be of
    /// a newer arm: it is taken for a setting that is answered, if its shape allows. `None` if it can be no request.
    fn request(&self, frame: &[u8]) -> Option<RequestInfo<Self::Key, Self::Expect>>;

    /// Whether a frame from the arm is the response to the request with this key, whatever its values are. A request is never
    /// a response: a line may give it back.
    fn is_response_to(&self, key: Self::Key, frame: &[u8]) -> bool;

    /// Writes the sender's number into a request, where the wire has room for one.
    fn stamp(&self, _frame: &mut [u8], _number: u16) {}
}
