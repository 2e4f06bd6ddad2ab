//! A host's request to read, write or erase the configuration in flash.

use crate::action::Action;
use crate::config::Saved;
use crate::control::Failure;
use crate::line::ControlPort;

/// The outcome of a request, and what was read.
pub(super) type Outcome = Result<Option<Saved>, Failure>;

/// The host that waits for the reply.
struct Waiter {
    port: ControlPort,
    sequence: u8,
}

/// The state of the one request that is accepted at a time.
enum State {
    Idle,
    /// Firmware has not taken the action yet. Without a waiter, the host has disconnected.
    Due(Action, Option<Waiter>),
    /// Firmware executes the action.
    Running(Option<Waiter>),
    /// The reply waits for room.
    Done(Waiter, Outcome),
}

/// A request for the configuration in flash. It completes even if its host disconnects.
pub(super) struct Flash(State);

impl Flash {
    pub(super) const fn new() -> Self {
        Self(State::Idle)
    }

    /// Returns true until the reply was sent, or has nobody to go to.
    pub(super) const fn is_busy(&self) -> bool {
        !matches!(self.0, State::Idle)
    }

    /// A host requests this action. Call it only if no other request is [in progress](Self::is_busy).
    pub(super) fn request(&mut self, action: Action, port: ControlPort, sequence: u8) {
        self.0 = State::Due(action, Some(Waiter { port, sequence }));
    }

    /// Takes the action that firmware has not taken yet.
    pub(super) fn take_action(&mut self) -> Option<Action> {
        match core::mem::replace(&mut self.0, State::Idle) {
            State::Due(action, waiter) => {
                self.0 = State::Running(waiter);
                Some(action)
            }
            other => {
                self.0 = other;
                None
            }
        }
    }

    /// Firmware has executed the action.
    pub(super) fn done(&mut self, outcome: Outcome) {
        if let State::Running(waiter) = &mut self.0 {
            self.0 = match waiter.take() {
                Some(waiter) => State::Done(waiter, outcome),
                None => State::Idle,
            };
        }
    }

    /// Returns true if a host on this port waits for the reply.
    pub(super) fn is_awaited(&self, port: ControlPort) -> bool {
        let waiter = match &self.0 {
            State::Idle => None,
            State::Due(_, waiter) | State::Running(waiter) => waiter.as_ref(),
            State::Done(waiter, _) => Some(waiter),
        };
        waiter.is_some_and(|waiter| waiter.port == port)
    }

    /// The host on this port has disconnected.
    pub(super) fn forget(&mut self, port: ControlPort) {
        if !self.is_awaited(port) {
            return;
        }
        match &mut self.0 {
            State::Due(_, waiter) | State::Running(waiter) => *waiter = None,
            State::Idle | State::Done(..) => self.0 = State::Idle,
        }
    }

    /// Takes the outcome for the host on this port, if it is known, and the sequence number of the request.
    pub(super) fn take_outcome(&mut self, port: ControlPort) -> Option<(u8, Outcome)> {
        match &self.0 {
            State::Done(waiter, outcome) if waiter.port == port => {
                let taken = (waiter.sequence, *outcome);
                self.0 = State::Idle;
                Some(taken)
            }
            _ => None,
        }
    }
}
