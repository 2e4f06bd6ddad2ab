//! Both directions of one connection.

use core::fmt;

use armwire::time::Instant;

use super::pci::{self, Pci};
use super::receiver::Receiver;
use super::sender::Sender;
use super::{Config, Event, Events, NEVER, SendError};
use crate::can::Frame;

/// The longest PDU of an [`Endpoint`], in bytes.
pub const MAX_PDU: usize = pci::MAX_SHORT_FIRST as usize;

/// One end of a connection. It can send a PDU and receive another at the same time.
///
/// `RX` and `TX` are the maximum lengths of received and sent PDUs, in bytes, 1 to [`MAX_PDU`].
///
/// No polling is needed: each method lists the calls to make after it.
pub struct Endpoint<const RX: usize, const TX: usize> {
    config: Config,
    receiver: Receiver,
    sender: Sender,
    rx: [u8; RX],
    tx: [u8; TX],
}

impl<const RX: usize, const TX: usize> Endpoint<RX, TX> {
    /// An idle endpoint. Fails to compile if `RX` or `TX` is not 1 to [`MAX_PDU`].
    pub const fn new(config: Config) -> Self {
        const {
            assert!(
                RX >= 1 && RX <= MAX_PDU && TX >= 1 && TX <= MAX_PDU,
                "the longest PDU is not 1 to 4095 bytes"
            )
        }
        Self {
            config,
            receiver: Receiver::new(),
            sender: Sender::new(),
            rx: [0; RX],
            tx: [0; TX],
        }
    }

    // ---- Receiving ----

    /// Handles a frame for this endpoint with this data.
    ///
    /// Call [`received`](Self::received), [`transmit_at`](Self::transmit_at) and [`timeout`](Self::timeout) afterwards.
    pub fn receive(&mut self, data: &[u8], now: Instant) -> Events {
        let config = &self.config;
        let event = match pci::parse(data) {
            Ok(Pci::Single(pdu)) => return self.receiver.single(&mut self.rx, pdu),
            Ok(Pci::First { len, data: start }) => {
                let frame = (data.len(), len, start);
                return self.receiver.first(&mut self.rx, frame, config, now);
            }
            Ok(Pci::Consecutive { number, data }) => {
                self.receiver.consecutive(&mut self.rx, (number, data), config, now)
            }
            Ok(Pci::FlowControl {
                status,
                block_size,
                st_min,
            }) => self.sender.flow_control((status, block_size, st_min), config, now),
            Err(ignored) => Some(Event::Ignored(ignored)),
        };
        Events {
            first: event,
            second: None,
        }
    }

    /// The received PDU. It stays until it is [released](Self::release), and no other is accepted until then.
    pub fn received(&self) -> Option<&[u8]> {
        self.rx.get(..self.receiver.whole()?)
    }

    /// Makes room for the next PDU. Does nothing if none was received.
    pub fn release(&mut self) {
        self.receiver.release();
    }

    // ---- Sending ----

    /// Starts the transfer of a PDU.
    ///
    /// Call [`transmit_at`](Self::transmit_at) afterwards.
    ///
    /// # Errors
    ///
    /// [`SendError`] if it cannot be sent, or not now. Nothing changes.
    ///
    /// ```
    /// use armwire_bridge::can::Id;
    /// use armwire_bridge::isotp::{Config, Endpoint, Link, SendError};
    ///
    /// let mut endpoint = Endpoint::<64, 64>::new(Config::new(Link::Fd, Id::new(0x610).unwrap()));
    /// assert_eq!(endpoint.send(&[0; 65]), Err(SendError::TooLong { max: 64, got: 65 }));
    /// assert_eq!(endpoint.send(&[1, 2]), Ok(()));
    /// assert_eq!(endpoint.send(&[3, 4]), Err(SendError::Busy));
    /// ```
    pub fn send(&mut self, pdu: &[u8]) -> Result<(), SendError> {
        if self.is_sending() {
            return Err(SendError::Busy);
        }
        if pdu.is_empty() {
            return Err(SendError::Empty);
        }
        let Some(room) = self.tx.get_mut(..pdu.len()) else {
            return Err(SendError::TooLong {
                max: TX,
                got: pdu.len(),
            });
        };
        room.copy_from_slice(pdu);
        self.sender.begin(pdu.len());
        Ok(())
    }

    /// Returns true while a PDU is being sent. If it ended without an event, all its frames were handed over.
    pub fn is_sending(&self) -> bool {
        !self.sender.is_idle()
    }

    /// The time from which [`transmit`](Self::transmit) has a frame; it may lie in the past. `None` if no frame follows
    /// without another event.
    pub fn transmit_at(&self) -> Option<Instant> {
        if self.receiver.has_answer() {
            return Some(Instant::ZERO);
        }
        some(self.sender.transmit_at())
    }

    /// The next frame for the bus, if one is due. Flow control goes first.
    ///
    /// Send the frames in this order, and call [`transmitted`](Self::transmitted) when they have left. More frames may
    /// be handed over before that, but with a separation time the next consecutive frame is not due until then. A frame
    /// that is not reported as transmitted counts as stuck after [`n_as`](Config::n_as), unless it is answered.
    ///
    /// Call [`is_sending`](Self::is_sending), [`transmit_at`](Self::transmit_at) and [`timeout`](Self::timeout)
    /// afterwards.
    pub fn transmit(&mut self, now: Instant) -> Option<Frame> {
        let answer = self.receiver.transmit(&self.config, now);
        answer.or_else(|| self.sender.transmit(&self.tx, &self.config, now))
    }

    /// All frames from [`transmit`](Self::transmit) have left the controller. Times that the standard measures from the
    /// end of a frame start now. Does nothing if called again for the same frames.
    ///
    /// Call [`transmit_at`](Self::transmit_at) and [`timeout`](Self::timeout) afterwards.
    ///
    /// ```
    /// use armwire_bridge::Instant;
    /// use armwire_bridge::can::Id;
    /// use armwire_bridge::isotp::{Config, Endpoint, Link};
    ///
    /// let mut endpoint = Endpoint::<64, 64>::new(Config::new(Link::Classic, Id::new(0x610).unwrap()));
    /// endpoint.send(&[0; 20]).unwrap();
    /// assert!(endpoint.transmit(Instant::ZERO).is_some());
    /// assert_eq!(endpoint.timeout(), Some(Instant::from_micros(1_000_000)));
    /// // Other nodes had the bus for 300 µs.
    /// endpoint.transmitted(Instant::from_micros(430));
    /// assert_eq!(endpoint.timeout(), Some(Instant::from_micros(1_000_430)));
    /// ```
    pub fn transmitted(&mut self, now: Instant) {
        self.receiver.transmitted(&self.config, now);
        self.sender.transmitted(now);
    }

    // ---- Time ----

    /// The time of the next [`tick`](Self::tick) unless another event comes first. `None` if no timeout is running.
    pub fn timeout(&self) -> Option<Instant> {
        some(self.receiver.timeout().min(self.sender.timeout(&self.config)))
    }

    /// Advances the time to `now`: a PDU whose next frame is late is aborted, in either direction. Its frames that are
    /// still in the controller may be withdrawn. Frames of it that leave later are harmless, and an answer to them is
    /// ignored while no other PDU is being sent.
    ///
    /// Pass earlier frames to [`receive`](Self::receive) first. Call [`is_sending`](Self::is_sending) afterwards.
    pub fn tick(&mut self, now: Instant) -> Events {
        Events {
            first: self.receiver.tick(&self.config, now),
            second: self.sender.tick(&self.config, now),
        }
    }

    /// Aborts both transfers without an event, for example after bus-off, and returns the number of aborted PDUs. A
    /// complete PDU stays.
    ///
    /// ```
    /// # use armwire_bridge::Instant;
    /// # use armwire_bridge::can::Id;
    /// # use armwire_bridge::isotp::{Config, Endpoint, Link};
    /// # let mut endpoint = Endpoint::<64, 64>::new(Config::new(Link::Classic, Id::new(0x610).unwrap()));
    /// endpoint.send(&[1, 2]).unwrap();
    /// assert_eq!(endpoint.abort(), 1);
    /// assert!(!endpoint.is_sending());
    /// assert_eq!(endpoint.transmit(Instant::ZERO), None);
    /// ```
    pub fn abort(&mut self) -> usize {
        usize::from(self.receiver.abort()).saturating_add(self.sender.abort().into())
    }
}

fn some(at: Instant) -> Option<Instant> {
    (at != NEVER).then_some(at)
}

impl<const RX: usize, const TX: usize> fmt::Debug for Endpoint<RX, TX> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Endpoint")
            .field("config", &self.config)
            .field("received", &self.received())
            .field("is_sending", &self.is_sending())
            .field("timeout", &self.timeout())
            .finish_non_exhaustive()
    }
}
