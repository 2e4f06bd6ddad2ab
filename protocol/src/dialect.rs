//! What a frame says about the exchange that it is part of, from its bytes alone.

use core::fmt::Debug;

use crate::framing::Framing;
use crate::time::Duration;

/// What a request does to the arm.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum Effect {
    /// It changes nothing. Only such a request is ever repeated.
    Read,
    /// It moves the arm.
    Motion,
    /// It switches the torque.
    Torque,
    /// It changes anything else, or is not documented.
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

/// What a request says about its exchange.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct RequestInfo<K, E> {
    /// What its response is recognised by.
    pub key: K,
    /// What to expect on the line until the response is there.
    pub expect: E,
    /// The response to wait for; `None` if the arm does not respond.
    pub response: Option<ResponseTiming>,
    /// What it does to the arm.
    pub effect: Effect,
}

/// A [`RequestInfo`] of this dialect.
pub type InfoOf<D> = RequestInfo<<D as Dialect>::Key, <D as Framing>::Expect>;

/// Which frames are requests and responses on one kind of line, and which belong together.
///
/// It works on the bytes of frames and makes no messages of them, so an adapter between a host and an arm can afford it.
pub trait Dialect: Framing {
    /// Whether a request has a number that its response repeats. Where it has none, a response that is missing must be waited
    /// for, or given up, before the next request of its key may go.
    const HAS_TRANSACTION_ID: bool = false;

    /// What a response is recognised by.
    type Key: Copy + Eq + Debug;

    /// What a frame from a host says about its exchange. A frame with a good envelope that the document does not have may be of
    /// a newer arm: it is taken for a setting that is answered, if its shape allows. `None` if it can be no request.
    fn request(&self, frame: &[u8]) -> Option<RequestInfo<Self::Key, Self::Expect>>;

    /// Whether a frame from the arm is the response to the request with this key, whatever its values are. A request is never
    /// a response: a line may give it back.
    fn is_response_to(&self, key: Self::Key, frame: &[u8]) -> bool;

    /// Writes the sender's number into a request, where the wire has room for one.
    fn stamp(&self, _frame: &mut [u8], _number: u16) {}
}
