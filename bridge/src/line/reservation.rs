//! The reservation of the line for the host on USB.

use armwire::time::Instant;

use crate::control::{Failure, LineState};

use super::Line;
use super::guard::ControlPort;

impl Line {
    /// A host on the control port reserves the line for USB.
    pub(crate) fn reserve_line(&mut self, port: ControlPort, now: Instant) -> Result<(), Failure> {
        if self.outbox.is_torque_off_due() || self.guard.dead_man.is_any_streaming() {
            return Err(Failure::StreamArmed);
        }
        // The gate would withhold or drop bytes of an upload.
        let may_reserve = !self.guard.stop.refuses_motion();
        let is_reserved = may_reserve && self.change_rate(now, |rate, _| rate.reserve(port, now));
        is_reserved.then_some(()).ok_or(Failure::Busy)
    }

    /// A host on the control port ends its reservation.
    pub(crate) fn release_line(&mut self, port: ControlPort, now: Instant) {
        self.change_rate(now, |rate, _| rate.end_reservation(port));
    }

    /// Applies the begin or the end of a reservation, if there is one.
    // Not inlined: it has many callers.
    #[inline(never)]
    pub(super) fn follow_reservation(&mut self, now: Instant) {
        if let Some(is_reserved) = self.guard.changed_reservation(self.outbox.queued()) {
            #[cfg(feature = "defmt")]
            crate::log::reservation(self.state().reservation);
            self.outbox.reserve(self.kind, is_reserved, now, &mut self.journal);
        }
    }

    /// The state of the line for [`Reply::Line`](crate::control::Reply::Line).
    pub(crate) fn state(&self) -> LineState {
        self.guard.rate.state(self.outbox.queued())
    }
}
