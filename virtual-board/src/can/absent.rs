//! A bus without a board.

use armwire_sim::can::Frame;

use super::{Capability, Controller, ErrorState, Fault};
use crate::time::Nanos;

/// A placeholder for the board's controller that neither receives nor sends.
pub(crate) struct Absent;

impl Controller for Absent {
    fn bit(&self) -> u64 {
        0
    }

    fn capability(&self) -> Capability {
        Capability::Classic
    }

    fn listens(&self) -> bool {
        false
    }

    fn drives(&self) -> bool {
        false
    }

    fn state(&self) -> ErrorState {
        ErrorState::Active
    }

    fn offer(&self) -> Option<Frame> {
        None
    }

    fn requested(&self) -> Option<Nanos> {
        None
    }

    fn sends(&self) -> bool {
        false
    }

    fn begin(&mut self, _: bool) {}

    fn lose(&mut self) {}

    fn receive(&mut self, _: &Frame) {}

    fn receive_error(&mut self, _: Fault) {}

    fn transmit_error(&mut self, _: Fault) {}

    fn end(&mut self, _: bool, _: Nanos) {}

    fn due(&self) -> Option<Nanos> {
        None
    }

    fn tick(&mut self) {}
}
