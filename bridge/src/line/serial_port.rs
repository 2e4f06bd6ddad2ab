//! The serial port on USB: state, packets and line coding.

use armwire::time::Instant;

use crate::control::Initiator;
use crate::counters::count;
use crate::line_coding::{LineCoding, UnsupportedCoding};

use super::Line;
use super::rate::ControlPort;
use super::to_host::PACKET;

impl Line {
    /// The host enabled or disabled the adapter's configuration.
    pub(crate) fn usb_configured(&mut self, configured: bool, now: Instant) {
        self.to_host.configured(configured, &mut self.counters);
        self.rate.reset(self.from_host.len());
        self.release_line(ControlPort::Usb, now);
    }

    pub(crate) fn usb_reset(&mut self, now: Instant) {
        count(&mut self.counters.usb_resets, 1);
        self.usb_configured(false, now);
    }

    pub(crate) fn usb_suspended(&mut self, now: Instant) {
        count(&mut self.counters.usb_suspends, 1);
        self.rate.release(self.from_host.len());
        self.follow_holder(now);
    }

    /// Returns true if the port was opened or closed.
    pub(crate) fn dtr(&mut self, high: bool, now: Instant) -> bool {
        if self.to_host.is_attached() {
            self.rate.dtr(high, self.from_host.len(), now);
            self.follow_holder(now);
        }
        self.to_host.dtr(high, &mut self.counters)
    }

    /// A packet of this length that was handed over could not be sent.
    pub(crate) fn packet_lost(&mut self, len: usize) {
        count(&mut self.counters.undelivered_bytes, len);
    }

    /// Returns true if the next packet of the host may be accepted. While a line coding waits to take effect it may
    /// not: its bytes are for the new one.
    pub(crate) fn has_packet_room(&self) -> bool {
        !self.rate.changes() && self.from_host.room() >= self.stop.packet_room
    }

    /// Returns true if the host's next packet may take the line from the others.
    pub(crate) fn may_be_taken(&self) -> bool {
        self.rate.is_unmet()
    }

    /// Handles a packet of the host. Returns true if the next one fits.
    pub(crate) fn packet_received(&mut self, packet: &[u8], now: Instant) -> bool {
        count(&mut self.counters.packets_from_host, 1);
        if self.rate.is_unmet() && !packet.is_empty() && !self.take_rate(now) {
            self.refuse_packet(packet.len(), now);
        } else {
            if !self.is_held {
                self.dead_man.keep_alive(Initiator::Usb, now);
            }
            if self.stop.refuses_motion() {
                self.from_host.touch(now);
                self.pass_gate(packet, now);
            } else {
                let refused = self.from_host.push(packet, now);
                count(&mut self.counters.refused_bytes, refused);
            }
        }
        self.has_packet_room()
    }

    /// The next packet for the host.
    pub(crate) fn packet(&mut self, packet: &mut [u8; PACKET]) -> Option<usize> {
        self.to_host.transmit(packet, &mut self.counters)
    }

    /// The host on USB set a line coding.
    pub(crate) fn set_line_coding(&mut self, bytes: [u8; 7], now: Instant) -> Result<(), UnsupportedCoding> {
        let coding = LineCoding::from_cdc(bytes).inspect_err(|_| count(&mut self.counters.refused_line_codings, 1))?;
        self.from_host.touch(now);
        self.rate.request(coding, self.from_host.len(), now);
        self.follow_holder(now);
        Ok(())
    }

    pub(crate) const fn line_coding(&self) -> LineCoding {
        self.rate.requested()
    }
}
