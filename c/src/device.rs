//! The functions common to the devices of all protocols.

use armwire::Device;
use armwire::messages::Messages;

use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory::{self, Memory};
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// A device and the last value that it rejected.
pub(crate) struct State<M: Messages, const N: usize> {
    device: Device<M, N>,
    refused: Refused,
}

/// The reason why a response is not written.
pub(crate) enum Refusal {
    /// An unknown kind, or a pointer that is NULL.
    Status(ArmwireStatus),
    /// A value is out of its range.
    Value(Refused),
}

impl From<Refused> for Refusal {
    fn from(value: Refused) -> Self {
        Self::Value(value)
    }
}

/// Initializes a device.
pub(crate) fn init<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    version: u32,
    messages: M,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    if version != ARMWIRE_VERSION {
        return Err(ArmwireStatus::Version);
    }
    let state = State {
        device: Device::new(messages),
        refused: Refused::NONE,
    };
    memory::init(memory, state)
}

pub(crate) fn idle<S, M: Messages, const N: usize>(memory: Option<&mut S>) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory).map(|state| state.device.idle()).into()
}

pub(crate) fn space<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    space: Option<&mut *mut u8>,
    len: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let room = memory::open(memory)?.device.space();
    let (Some(space), Some(len)) = (space, len) else {
        return Err(ArmwireStatus::Null);
    };
    (*space, *len) = (room.as_mut_ptr(), room.len());
    Ok(())
}

pub(crate) fn received<S, M: Messages, const N: usize>(memory: Option<&mut S>, len: usize) -> ArmwireStatus
where
    S: Memory<Value = State<M, N>>,
{
    memory::open(memory)
        .and_then(|state| {
            state.device.received(len).map_err(|error| {
                state.refused = Refused::length(error);
                ArmwireStatus::OutOfRange
            })
        })
        .into()
}

pub(crate) fn receive<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    bytes: Result<&[u8], ArmwireStatus>,
    taken: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let (bytes, taken) = (bytes?, taken.ok_or(ArmwireStatus::Null)?);
    let rest = memory::open(memory)?.device.receive(bytes);
    *taken = bytes.len().saturating_sub(rest.len());
    Ok(())
}

/// The next event, and its request and key, which `set` converts.
pub(crate) fn poll<S, M: Messages, const N: usize, R>(
    memory: Option<&mut S>,
    event: Option<&mut ArmwireEvent>,
    request: Option<&mut R>,
    set: impl Fn(&mut R, Option<M::Request<'_>>, Option<M::Key>),
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let (Some(event), Some(request)) = (event, request) else {
        return Err(ArmwireStatus::Null);
    };
    let (message, key) = event.set_device(memory::open(memory)?.device.poll());
    set(request, message, key);
    Ok(())
}

/// Writes a response and its length, or stores its error. For a buffer that is too short, it is the required length.
pub(crate) fn respond<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    response: Result<M::Response<'_>, Refusal>,
    to: Option<M::Key>,
    out: Result<&mut [u8], ArmwireStatus>,
    len: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: Memory<Value = State<M, N>>,
{
    let (out, len) = (out?, len.ok_or(ArmwireStatus::Null)?);
    let state = memory::open(memory)?;
    let (written, result) = match response {
        Ok(response) => match state.device.respond(&response, to, out) {
            Ok(written) => (written, Ok(())),
            Err(error) => (error.needed, Err(ArmwireStatus::BufferTooShort)),
        },
        Err(Refusal::Value(refused)) => {
            state.refused = refused;
            (0, Err(ArmwireStatus::OutOfRange))
        }
        Err(Refusal::Status(status)) => (0, Err(status)),
    };
    *len = written;
    result
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
