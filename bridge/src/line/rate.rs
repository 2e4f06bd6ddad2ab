//! Changes of the line's rate.

use armwire::time::Instant;

use crate::control::{Initiator, Refusal};
use crate::counters::count;
use crate::line_coding::UartConfig;

use super::Line;
use super::guard::LineRate;

impl Line {
    /// Changes the line's rate or its reservation. `change` gets the number of queued bytes of the host on USB.
    pub(super) fn change_rate<R>(&mut self, now: Instant, change: impl FnOnce(&mut LineRate, usize) -> R) -> R {
        let result = change(&mut self.guard.rate, self.outbox.queued());
        self.follow_reservation(now);
        result
    }

    /// Returns true if the host on USB may have a rate other than the arm's.
    fn may_change_rate(&self) -> bool {
        self.guard.may_change_rate(self.outbox.is_torque_off_due())
    }

    /// Puts the rate of the host on USB into effect with its next byte. Returns true if it did.
    #[cold]
    pub(super) fn take_rate(&mut self, now: Instant) -> bool {
        let takes = self.may_change_rate() && !self.guard.rate.is_revoked();
        if takes {
            self.change_rate(now, |rate, queued| rate.take(queued, now));
        }
        takes
    }

    /// Drops bytes of the host on USB whose rate is not in effect.
    #[cold]
    pub(super) fn refuse_packet(&mut self, bytes: usize, now: Instant) {
        count(&mut self.journal.counters.refused_rate_bytes, bytes);
        if self.guard.rate.refuse() {
            self.journal.refused(Initiator::Usb, Refusal::OtherRate, now);
        }
    }

    /// Torque-off and a stop need the arm's rate: bytes of the host on USB at another rate are cut off.
    pub(super) fn take_line_back(&mut self, now: Instant) {
        if self.guard.rate.revoke() {
            let dropped = self.outbox.drop_host();
            count(&mut self.journal.counters.refused_rate_bytes, dropped);
            self.follow_reservation(now);
        }
    }

    /// The time of the next change of the line's rate, or of the end of a requested reservation.
    pub(super) fn rate_timeout(&self) -> Option<Instant> {
        self.guard.rate.timeout(self.may_change_rate())
    }

    /// Changes the line's rate, or ends a requested reservation.
    #[cold]
    pub(super) fn tick_rate(&mut self, now: Instant) {
        let may_change = self.may_change_rate();
        let moved = self.outbox.host_moved().max(self.wire.last_byte());
        self.change_rate(now, |rate, queued| rate.tick(may_change, moved, queued, now));
    }

    /// The configuration that the UART must change to before anything else goes out. The change waits for the answer to
    /// another initiator's request; for torque-off it waits for none.
    pub(crate) fn uart_change(&self) -> Option<UartConfig> {
        let uart = self.guard.rate.change(self.outbox.queued())?;
        (self.outbox.is_torque_off_due() || !self.wire.is_anothers()).then_some(uart)
    }

    /// The UART was reconfigured: the rest of an unfinished frame is no longer expected. Returns the number of frames
    /// that this ended.
    pub(crate) fn uart_configured(&mut self, uart: UartConfig, now: Instant) -> usize {
        let frames = self.idle(now);
        self.outbox.cut_host();
        self.change_rate(now, |rate, _| rate.changed(uart));
        count(&mut self.journal.counters.line_codings, 1);
        frames
    }

    /// Returns true if the UART must stop transmitting: torque-off or a stop waits, and the arm cannot read bytes at this
    /// rate.
    pub(crate) fn is_cut_due(&self) -> bool {
        self.guard.is_cut_due(self.outbox.is_torque_off_due())
    }
}
