//! The functions common to the clients of all protocols.

use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, SubmitError};

use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// A client and the last value that it rejected.
pub(crate) struct State<M: Messages, const N: usize> {
    client: Client<M, N>,
    refused: Refused,
}

impl<M: Messages, const N: usize> State<M, N> {
    /// Stores the error of a value.
    const fn refuse(&mut self, refused: Refused) -> ArmwireStatus {
        self.refused = refused;
        ArmwireStatus::OutOfRange
    }

    /// Submits a request, or stores its error.
    fn submit(&mut self, request: Result<M::Request<'_>, Refused>) -> Result<(), ArmwireStatus> {
        let request = request.map_err(|refused| self.refuse(refused))?;
        self.client.submit(&request).map_err(|error| match error {
            SubmitError::TooLong(_) => ArmwireStatus::BufferTooShort,
            _ => ArmwireStatus::Busy,
        })
    }
}

/// Initializes a client.
pub(crate) fn init<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    version: u32,
    config: Option<&ArmwireConfig>,
    default: Config,
    messages: M,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    if version != ARMWIRE_VERSION {
        return Err(ArmwireStatus::Version);
    }
    let config = match config {
        Some(config) => config.get().map_err(|_| ArmwireStatus::OutOfRange)?,
        None => default,
    };
    let state = State {
        client: Client::new(messages, config),
        refused: Refused::NONE,
    };
    memory::init(memory, state)
}

/// Submits a request, or stores its error.
pub(crate) fn submit<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    request: Result<M::Request<'_>, Refused>,
) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory).and_then(|state| state.submit(request)).into()
}

/// Changes the properties of later requests, or stores the error of the value.
#[cfg(feature = "xarm")]
pub(crate) fn change<S, M: Messages, const N: usize, T>(
    memory: Option<&mut S>,
    value: Result<T, Refused>,
    change: impl Fn(&mut M, T),
) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory)
        .and_then(|state| {
            let value = value.map_err(|refused| state.refuse(refused))?;
            change(state.client.messages_mut(), value);
            Ok(())
        })
        .into()
}

pub(crate) fn cancel<S, M: Messages, const N: usize>(memory: Option<&mut S>) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory).map(|state| state.client.cancel()).into()
}

pub(crate) fn idle<S, M: Messages, const N: usize>(memory: Option<&mut S>) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory).map(|state| state.client.idle()).into()
}

pub(crate) fn space<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let room = memory::open(memory)?.client.space();
    let (Some(space), Some(len)) = (space, len) else {
        return Err(ArmwireStatus::Null);
    };
    (*space, *len) = (room.as_mut_ptr(), room.len());
    Ok(())
}

pub(crate) fn received<S, M: Messages, const N: usize>(memory: Option<&mut S>, now_us: u64, len: usize) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory)
        .and_then(|state| {
            let result = state.client.received(Instant::from_micros(now_us), len);
            result.map_err(|error| state.refuse(Refused::length(error)))
        })
        .into()
}

pub(crate) fn receive<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    now_us: u64,
    bytes: Result<&[u8], ArmwireStatus>,
    taken: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let (bytes, taken) = (bytes?, taken.ok_or(ArmwireStatus::Null)?);
    let state = memory::open(memory)?;
    let rest = state.client.receive(Instant::from_micros(now_us), bytes);
    *taken = bytes.len().saturating_sub(rest.len());
    Ok(())
}

pub(crate) fn transmitted<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    now_us: u64,
    len: usize,
) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory)
        .and_then(|state| {
            let result = state.client.transmitted(Instant::from_micros(now_us), len);
            result.map_err(|error| state.refuse(Refused::length(error)))
        })
        .into()
}

/// The next action, and its response, which `set` converts.
pub(crate) fn poll<S, M: Messages, const N: usize, R>(
    memory: Option<&mut S>,
    now_us: u64,
    event: Option<&mut ArmwireEvent>,
    response: Option<&mut R>,
    set: impl Fn(&mut R, Option<M::Response<'_>>),
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let (Some(event), Some(response)) = (event, response) else {
        return Err(ArmwireStatus::Null);
    };
    let state = memory::open(memory)?;
    set(
        response,
        event.set_client(state.client.poll(Instant::from_micros(now_us))),
    );
    event.set_extra(state.client.messages().extra(state.client.frame()));
    Ok(())
}

pub(crate) fn fault<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    fault: Option<&mut ArmwireFault>,
) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory)
        .and_then(|state| memory::put(fault, state.refused.fault()))
        .into()
}
