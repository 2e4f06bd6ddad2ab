//! The behaviour common to the devices of all protocols.

use armwire::Device;
use armwire::messages::Messages;

use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory;
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

impl<M: Messages, const N: usize> State<M, N> {
    pub(crate) fn new(version: u32, messages: M) -> Result<Self, ArmwireStatus> {
        if version != ARMWIRE_VERSION {
            return Err(ArmwireStatus::Version);
        }
        Ok(Self {
            device: Device::new(messages),
            refused: Refused::NONE,
        })
    }

    pub(crate) fn idle(&mut self) {
        self.device.idle();
    }

    pub(crate) fn space(&mut self, space: Option<&mut *mut u8>, len: Option<&mut usize>) -> Result<(), ArmwireStatus> {
        memory::put_space(self.device.space(), space, len)
    }

    pub(crate) fn received(&mut self, len: usize) -> Result<(), ArmwireStatus> {
        self.device.received(len).map_err(|error| {
            self.refused = Refused::length(error);
            ArmwireStatus::OutOfRange
        })
    }

    /// The number of bytes that it takes.
    pub(crate) fn receive(&mut self, bytes: &[u8]) -> usize {
        bytes.len().saturating_sub(self.device.receive(bytes).len())
    }

    /// The next event, and its request and key, which `set` converts.
    pub(crate) fn poll<R>(
        &mut self,
        event: &mut ArmwireEvent,
        request: &mut R,
        set: impl Fn(&mut R, Option<M::Request<'_>>, Option<M::Key>),
    ) {
        let (message, key) = event.set_device(self.device.poll());
        set(request, message, key);
    }

    /// Writes a response, or stores its error. Returns its length, for a buffer that is too short the required one.
    pub(crate) fn respond(
        &mut self,
        response: Result<M::Response<'_>, Refusal>,
        to: Option<M::Key>,
        out: &mut [u8],
    ) -> (usize, Result<(), ArmwireStatus>) {
        match response {
            Ok(response) => match self.device.respond(&response, to, out) {
                Ok(written) => (written, Ok(())),
                Err(error) => (error.needed, Err(ArmwireStatus::BufferTooShort)),
            },
            Err(Refusal::Value(refused)) => {
                self.refused = refused;
                (0, Err(ArmwireStatus::OutOfRange))
            }
            Err(Refusal::Status(status)) => (0, Err(status)),
        }
    }

    pub(crate) fn fault(&self, fault: Option<&mut ArmwireFault>) -> Result<(), ArmwireStatus> {
        memory::put(fault, self.refused.fault())
    }
}

/// Writes a response and its length.
pub(crate) fn respond<S, M: Messages, const N: usize>(
    memory: Option<&mut S>,
    response: Result<M::Response<'_>, Refusal>,
    to: Option<M::Key>,
    out: Result<&mut [u8], ArmwireStatus>,
    len: Option<&mut usize>,
) -> Result<(), ArmwireStatus>
where
    S: memory::Memory<Value = State<M, N>>,
{
    let (out, len) = (out?, len.ok_or(ArmwireStatus::Null)?);
    let (written, result) = memory::open(memory)?.respond(response, to, out);
    *len = written;
    result
}
