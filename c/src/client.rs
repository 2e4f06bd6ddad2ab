//! The behaviour common to the clients of all protocols.

use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, OutOfRange, SubmitError};

use crate::config::ArmwireConfig;
use crate::event::ArmwireEvent;
use crate::fault::{ArmwireFault, Refused};
use crate::memory;
use crate::status::ArmwireStatus;
use crate::version::ARMWIRE_VERSION;

/// A client and the last value that it rejected.
pub(crate) struct State<M: Messages, const N: usize> {
    client: Client<M, N>,
    refused: Refused,
}

impl<M: Messages, const N: usize> State<M, N> {
    pub(crate) fn new(
        version: u32,
        config: Option<&ArmwireConfig>,
        default: Config,
        messages: M,
    ) -> Result<Self, ArmwireStatus> {
        if version != ARMWIRE_VERSION {
            return Err(ArmwireStatus::Version);
        }
        let config = match config {
            Some(config) => config.get().map_err(|_| ArmwireStatus::OutOfRange)?,
            None => default,
        };
        Ok(Self {
            client: Client::new(messages, config),
            refused: Refused::NONE,
        })
    }

    /// Stores the error of a value.
    const fn refuse(&mut self, refused: Refused) -> ArmwireStatus {
        self.refused = refused;
        ArmwireStatus::OutOfRange
    }

    /// Submits a request, or stores its error.
    pub(crate) fn submit(&mut self, request: Result<M::Request<'_>, Refused>) -> Result<(), ArmwireStatus> {
        let request = request.map_err(|refused| self.refuse(refused))?;
        self.client.submit(&request).map_err(|error| match error {
            SubmitError::TooLong(_) => ArmwireStatus::BufferTooShort,
            SubmitError::OutOfRange(_) => ArmwireStatus::OutOfRange,
            _ => ArmwireStatus::Busy,
        })
    }

    /// Changes the properties of later requests, or stores the error of the value.
    #[cfg(feature = "xarm")]
    pub(crate) fn change<T>(
        &mut self,
        value: Result<T, Refused>,
        change: impl Fn(&mut M, T),
    ) -> Result<(), ArmwireStatus> {
        let value = value.map_err(|refused| self.refuse(refused))?;
        change(self.client.messages_mut(), value);
        Ok(())
    }

    pub(crate) fn cancel(&mut self) {
        self.client.cancel();
    }

    pub(crate) fn idle(&mut self) {
        self.client.idle();
    }

    pub(crate) fn space(&mut self, space: Option<&mut *mut u8>, len: Option<&mut usize>) -> Result<(), ArmwireStatus> {
        memory::put_space(self.client.space(), space, len)
    }

    fn accept(&mut self, accepted: Result<(), OutOfRange<usize>>) -> Result<(), ArmwireStatus> {
        accepted.map_err(|error| self.refuse(Refused::length(error)))
    }

    pub(crate) fn received(&mut self, now_us: u64, len: usize) -> Result<(), ArmwireStatus> {
        let accepted = self.client.received(Instant::from_micros(now_us), len);
        self.accept(accepted)
    }

    pub(crate) fn transmitted(&mut self, now_us: u64, len: usize) -> Result<(), ArmwireStatus> {
        let accepted = self.client.transmitted(Instant::from_micros(now_us), len);
        self.accept(accepted)
    }

    /// The number of bytes that it takes.
    pub(crate) fn receive(&mut self, now_us: u64, bytes: &[u8]) -> usize {
        let rest = self.client.receive(Instant::from_micros(now_us), bytes);
        bytes.len().saturating_sub(rest.len())
    }

    /// The next action, and its response, which `set` converts.
    pub(crate) fn poll<R>(
        &mut self,
        now_us: u64,
        event: &mut ArmwireEvent,
        response: &mut R,
        set: impl Fn(&mut R, Option<M::Response<'_>>),
    ) {
        set(
            response,
            event.set_client(self.client.poll(Instant::from_micros(now_us))),
        );
        event.set_extra(self.client.messages().extra(self.client.frame()));
    }

    pub(crate) fn fault(&self, fault: Option<&mut ArmwireFault>) -> Result<(), ArmwireStatus> {
        memory::put(fault, self.refused.fault())
    }
}
