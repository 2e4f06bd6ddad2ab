//! The host's side of the control port on USB.

use armwire_bridge::control::{FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Reader, Request, encode_cobs};
use armwire_bridge::{Bridge, Instant, PACKET};

/// The host's side of the control port on USB.
#[derive(Debug, Default)]
pub struct ControlPort {
    sequence: u8,
    reader: Reader<MAX_MESSAGE>,
}

impl ControlPort {
    /// A message with the next sequence number.
    pub fn message(&mut self, request: Request) -> FromHost {
        self.sequence = self.sequence.wrapping_add(1);
        FromHost {
            sequence: self.sequence,
            request,
        }
    }

    /// Sends a request. Returns its sequence number. The adapter must have room for a packet.
    ///
    /// # Panics
    ///
    /// If the message is longer than a packet.
    pub fn send(&mut self, bridge: &mut Bridge, request: Request, now: Instant) -> u8 {
        let message = self.message(request);
        let mut bytes = [0; MAX_COBS];
        let len = encode_cobs(&message, &mut bytes).expect("there is room");
        assert!(len <= PACKET, "{len} bytes are more than a packet");
        bridge.control_received(&bytes[..len], now);
        message.sequence
    }

    /// Reads a packet: the messages that it completes. `None` without a packet.
    ///
    /// # Panics
    ///
    /// If the adapter's status is wrong, or its bytes are no messages.
    pub fn read_packet(&mut self, bridge: &mut Bridge, now: Instant) -> Option<Vec<FromAdapter>> {
        let mut packet = [0; PACKET];
        let mut len = None;
        while len.is_none() && bridge.update(now).control {
            len = bridge.control_transmit(&mut packet, now);
        }
        if len.is_none() {
            assert_eq!(bridge.control_transmit(&mut packet, now), None);
        }
        let mut rest = &packet[..len?];
        let mut messages = Vec::new();
        while !rest.is_empty() {
            rest = self.reader.push(rest);
            match self.reader.next() {
                Some(message) => messages.push(message.expect("the adapter sends messages")),
                None => assert!(rest.is_empty()),
            }
        }
        Some(messages)
    }
}
