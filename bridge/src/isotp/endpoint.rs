//! Both directions of one connection.

use armwire::Micros;

use super::{Config, Events, SendError};
use crate::can::Frame;

/// The longest PDU there is without the 32-bit length, in bytes.
pub const MAX_PDU: usize = 4095;

/// One end of a connection: it may receive a PDU while it sends another.
///
/// `RX` and `TX` are the longest PDUs it receives and sends, in bytes, 1 to [`MAX_PDU`].
pub struct Endpoint<const RX: usize, const TX: usize> {
    config: Config,
}

impl<const RX: usize, const TX: usize> Endpoint<RX, TX> {
    /// An endpoint that neither receives nor sends. Does not compile when it could do neither a PDU of one byte nor more
    /// than [`MAX_PDU`].
    pub const fn new(config: Config) -> Self {
        Self { config }
    }

    /// A frame came for this endpoint, with this data.
    ///
    /// Then ask [`received`](Self::received), [`transmit_at`](Self::transmit_at) and [`timeout`](Self::timeout).
    pub fn receive(&mut self, data: &[u8], now: Micros) -> Events {
        let _ = (data, now, self.config);
        Events::default()
    }

    /// It is `now`: what is late is given up.
    pub fn tick(&mut self, now: Micros) -> Events {
        let _ = now;
        Events::default()
    }

    /// When to call [`tick`](Self::tick), unless something happens before. `None` when nothing is waited for.
    pub fn timeout(&self) -> Option<Micros> {
        None
    }

    /// Begins to send a PDU.
    ///
    /// Then ask [`transmit_at`](Self::transmit_at).
    ///
    /// # Errors
    ///
    /// [`SendError`] when it cannot be sent, or not now. Nothing is changed.
    pub fn send(&mut self, pdu: &[u8]) -> Result<(), SendError> {
        let _ = pdu;
        Err(SendError::Busy)
    }

    /// Whether a PDU is being sent. When it no longer is and nothing was said about it, it has been handed over whole.
    pub fn is_sending(&self) -> bool {
        false
    }

    /// When [`transmit`](Self::transmit) has a frame, perhaps at a time that has passed. `None` when it will have none
    /// unless something happens before.
    pub fn transmit_at(&self) -> Option<Micros> {
        None
    }

    /// The next frame for the bus, if one is due: flow control before all else.
    pub fn transmit(&mut self, now: Micros) -> Option<Frame> {
        let _ = now;
        None
    }

    /// The frame that [`transmit`](Self::transmit) gave last has left.
    pub fn transmitted(&mut self, now: Micros) {
        let _ = now;
    }

    /// The PDU that was received. It stays until it is [released](Self::release), and no other is taken until then.
    pub fn received(&self) -> Option<&[u8]> {
        None
    }

    /// Makes room for the next PDU. Does nothing when none was received.
    pub fn release(&mut self) {}

    /// Gives up what is being received and sent, as after bus-off. A PDU that is whole stays.
    pub fn abort(&mut self) {}
}
