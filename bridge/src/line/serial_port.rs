//! The serial port on USB: state, packets and line coding.

use armwire::time::Instant;

use crate::control::Initiator;
use crate::counters::count;
use crate::line_coding::{LineCoding, UnsupportedCoding};

use super::Line;
use super::guard::{ControlPort, LineRate};

impl Line {
    /// The host enabled or disabled the adapter's configuration.
    pub(crate) fn usb_configured(&mut self, configured: bool, now: Instant) {
        self.wire.usb_configured(configured, &mut self.journal);
        self.change_rate(now, |rate, queued| {
            rate.reset(queued);
            rate.end_reservation(ControlPort::Usb);
        });
    }

    pub(crate) fn usb_reset(&mut self, now: Instant) {
        count(&mut self.journal.counters.usb_resets, 1);
        self.usb_configured(false, now);
    }

    pub(crate) fn usb_suspended(&mut self, now: Instant) {
        count(&mut self.journal.counters.usb_suspends, 1);
        self.change_rate(now, LineRate::release);
    }

    /// Returns true if the port was opened or closed.
    pub(crate) fn dtr(&mut self, high: bool, now: Instant) -> bool {
        if self.wire.to_host().is_attached() {
            self.change_rate(now, |rate, queued| rate.dtr(high, queued, now));
        }
        self.wire.dtr(high, &mut self.journal)
    }

    /// A packet of this length that was handed over could not be sent.
    pub(crate) fn packet_lost(&mut self, len: usize) {
        count(&mut self.journal.counters.undelivered_bytes, len);
    }

    /// Returns true if the next packet of the host may be accepted. While a line coding waits to take effect it may
    /// not: its bytes are for the new one.
    pub(crate) fn has_packet_room(&self) -> bool {
        !self.guard.rate.changes() && self.outbox.has_packet_room()
    }

    /// Returns true if the host's next packet may take the line from the others.
    pub(crate) fn may_be_taken(&self) -> bool {
        self.guard.rate.is_unmet()
    }

    /// Handles a packet of the host. Returns true if the next one fits.
    pub(crate) fn packet_received(&mut self, packet: &[u8], now: Instant) -> bool {
        count(&mut self.journal.counters.packets_from_host, 1);
        if self.guard.rate.is_unmet() && !packet.is_empty() && !self.take_rate(now) {
            self.refuse_packet(packet.len(), now);
        } else {
            if !self.guard.is_reserved() {
                self.guard.dead_man.keep_alive(Initiator::Usb, now);
            }
            if self.guard.stop.refuses_motion() {
                self.outbox.push_through_gate(self.kind, packet, now, &mut self.journal);
            } else {
                self.outbox.push(packet, now, &mut self.journal);
            }
        }
        self.has_packet_room()
    }

    /// Passes the next packet for the host to `send`, and removes it if that returns true.
    pub(crate) fn send_packet(&mut self, send: impl FnOnce(&[u8]) -> bool) -> Option<usize> {
        self.wire.send_packet(send, &mut self.journal)
    }

    /// The host on USB set a line coding.
    pub(crate) fn set_line_coding(&mut self, bytes: [u8; 7], now: Instant) -> Result<(), UnsupportedCoding> {
        let refused = &mut self.journal.counters.refused_line_codings;
        let coding = LineCoding::from_cdc(bytes).inspect_err(|_| count(refused, 1))?;
        self.outbox.touch(now);
        self.change_rate(now, |rate, queued| rate.request(coding, queued, now));
        Ok(())
    }

    pub(crate) const fn line_coding(&self) -> LineCoding {
        self.guard.rate.requested()
    }
}
