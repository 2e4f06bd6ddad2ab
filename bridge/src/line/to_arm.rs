//! Bytes to the arm, and what follows from them.

use armwire::time::Instant;

use crate::control::{Initiator, MAX_FRAME};

use super::Line;
use super::outbox::{Burst, BurstKind, Transmit, View};

impl Line {
    /// Returns true if [`transmit`](Self::transmit) has work.
    pub(crate) fn is_transmit_due(&self, now: Instant) -> bool {
        self.uart_change().is_some() || self.outbox.next(self.view(), now).is_some()
    }

    /// Copies the next bytes for the arm to the front of `out`, passes them to `send` with the start of the first one,
    /// and then accounts for them; or returns the configuration that the UART must change to before. `None` if nothing is
    /// due now.
    pub(crate) fn transmit(
        &mut self,
        out: &mut [u8; MAX_FRAME],
        now: Instant,
        send: impl FnOnce(&[u8], Option<Instant>),
    ) -> Option<Transmit> {
        self.tick_requests(now);
        self.tick_turn(now);
        if let Some(uart) = self.uart_change() {
            return Some(Transmit::Configure(uart));
        }
        let burst = self.next_burst(out, now)?;
        let Burst { len, start, .. } = burst;
        send(out.get(..len)?, start);
        self.transmitted(burst, now);
        Some(Transmit::Burst { len, start })
    }

    /// Copies the next burst to the front of `out`.
    fn next_burst(&mut self, out: &mut [u8; MAX_FRAME], now: Instant) -> Option<Burst> {
        let Self {
            kind,
            wire,
            outbox,
            guard,
            ..
        } = self;
        let view = View {
            kind: *kind,
            wire,
            guard,
        };
        let burst = outbox.next_burst(view, out, now)?;
        let sent = out.get(..burst.len).unwrap_or_default();
        guard.stop.on_request(*kind, burst.info, sent);
        Some(burst)
    }

    /// Accounts for a burst that the UART has been sending since `now`.
    fn transmitted(&mut self, burst: Burst, now: Instant) {
        self.outbox.transmitted(&burst, now, &mut self.journal);
        match burst.kind {
            BurstKind::Host => return self.host_transmitted(burst.len, now),
            BurstKind::Zeros => return,
            BurstKind::TorqueOn => {
                self.guard.dead_man.end(burst.initiator);
            }
            _ => {}
        }
        let byte_time = self.guard.rate.byte_time();
        let end = burst.began(now) + byte_time.times(burst.len);
        self.wire
            .track(burst.initiator, burst.info, end, byte_time, &mut self.journal);
        match burst.kind {
            BurstKind::Hold => {
                self.guard.stop.hold_sent();
                self.step_stop(now);
            }
            BurstKind::Reading => self.guard.stop.reading_sent(),
            _ => {}
        }
    }

    /// Accounts for bytes of the host on USB.
    fn host_transmitted(&mut self, len: usize, now: Instant) {
        if self.is_host_delayed() {
            self.guard.dead_man.keep_alive(Initiator::Usb, now);
        }
        let Self {
            kind,
            wire,
            outbox,
            guard,
            journal,
        } = self;
        guard.rate.sent(len);
        let is_at_arms_rate = guard.rate.is_arms();
        if !is_at_arms_rate {
            outbox.sent_at_other_rate();
        }
        let byte_time = guard.rate.byte_time();
        let end = now + byte_time.times(len);
        let mut rest = len;
        while rest > 0 {
            let taken = outbox.host_sent(rest, now);
            if taken == 0 {
                break;
            }
            rest = rest.saturating_sub(taken);
            while let Some(request) = outbox.next_host_request(*kind, is_at_arms_rate, journal) {
                let is_motion = request.is_motion();
                guard.stop.on_request(*kind, request.info, request.bytes);
                guard.host_requested(is_motion, kind.is_torque_on(request.bytes), now);
                let behind = byte_time.times(rest.saturating_add(request.behind));
                wire.track(Initiator::Usb, request.info, end - behind, byte_time, journal);
            }
            if is_at_arms_rate {
                outbox.end_void(journal);
            }
        }
    }

    /// Ends what is due at `now`: exchanges without an answer, the wait of polls, and old commands.
    pub(super) fn tick_requests(&mut self, now: Instant) {
        self.tick_exchange(now);
        self.outbox.tick(now, &mut self.journal);
    }

    /// Ends the turn of a host on USB that has paused, if others wait.
    pub(super) fn tick_turn(&mut self, now: Instant) {
        let view = View {
            kind: self.kind,
            wire: &self.wire,
            guard: &self.guard,
        };
        self.outbox.tick_turn(view, now);
    }

    pub(super) const fn view(&self) -> View<'_> {
        View {
            kind: self.kind,
            wire: &self.wire,
            guard: &self.guard,
        }
    }
}
