//! The arm's side: requests in, responses out, no I/O.

use core::fmt;

use crate::decoder::{Decoder, Item, Kind, Span};
use crate::framing::Reason;
use crate::messages::Messages;
use crate::{BufferTooShort, OutOfRange, ParseError};

/// An event of a [`Device`]: `R` is the protocol's request, `K` its key. It is exhaustive: its cases
/// account for every byte.
#[derive(Clone, Copy, Debug, PartialEq)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub enum DeviceEvent<'a, R, K> {
    /// A request.
    Request {
        /// The request.
        request: R,
        /// The key of its response.
        key: Option<K>,
    },
    /// A valid frame that is not a request of the protocol.
    Unknown {
        /// The frame.
        frame: &'a [u8],
        /// The reason.
        error: ParseError,
        /// The key of a response to it.
        key: Option<K>,
    },
    /// Bytes that are not part of a frame.
    Noise {
        /// The offset of the first byte, in bytes since the device was created.
        offset: u64,
        /// The bytes. A run of noise may be split into several events.
        bytes: &'a [u8],
        /// The reason.
        reason: Reason,
    },
    /// A lossless stream broke here: no later byte can be decoded. Close the connection.
    Broken {
        /// The offset of the break, in bytes since the device was created.
        offset: u64,
        /// The reason.
        reason: Reason,
    },
}

/// An arm-side state machine with a buffer of `N` bytes.
///
/// It implements the protocol, not the arm: the caller executes the requests and decides when responses go out.
///
/// ```
/// use armwire::ling::{Ling, Request, Response, Stroke};
/// use armwire::{Device, DeviceEvent};
///
/// let mut device = Device::<Ling, 70>::new(Ling);
/// assert!(device.receive(&[0xAA, 0x04, 0x0E, 0x01, 0xFE, 0x1B, 0xFF]).is_empty());
/// let Some(DeviceEvent::Request { request: Request::ReadStroke, key }) = device.poll() else { panic!("another request") };
/// assert_eq!(device.poll(), None);
///
/// let mut out = [0; 70];
/// let n = device.respond(&Response::Stroke(Stroke::Mm100), key, &mut out)?;
/// assert_eq!(out[..n], [0xAA, 0x04, 0x0E, 0x01, 0x02, 0x2C, 0xFF]);
/// # Ok::<(), armwire::BufferTooShort>(())
/// ```
pub struct Device<M: Messages, const N: usize> {
    messages: M,
    decoder: Decoder<M, N>,
}

impl<M: Messages, const N: usize> Device<M, N> {
    /// A device without received bytes.
    pub const fn new(messages: M) -> Self {
        Self {
            messages,
            decoder: Decoder::new(),
        }
    }

    /// The protocol. A request may borrow a text from the device: while the request is read, a copy of the protocol writes
    /// the response.
    ///
    /// ```
    /// use armwire::alpha1::{Alpha1, Outcome, Request, Response, Text};
    /// use armwire::messages::Messages;
    /// use armwire::{Device, DeviceEvent};
    ///
    /// let mut frame = [0; 64];
    /// let n = Alpha1.encode_request(&Request::Play(Text::new(b"dance")?), &mut frame).unwrap();
    /// let mut device = Device::<Alpha1, 64>::new(Alpha1);
    /// assert!(device.receive(&frame[..n]).is_empty());
    ///
    /// let arm = *device.messages();
    /// let Some(DeviceEvent::Request { request: Request::Play(name), key }) = device.poll() else { panic!("another request") };
    /// let mut out = [0; 64];
    /// let n = arm.encode_response(&Response::Playing(Outcome::Success), key, &mut out).unwrap();
    /// println!("{name}: {:02X?}", &out[..n]);
    /// # Ok::<(), armwire::OutOfRange>(())
    /// ```
    pub const fn messages(&self) -> &M {
        &self.messages
    }

    /// Free space for a read or DMA. Report the number of bytes with [`received`](Self::received). Never empty once
    /// [`poll`](Self::poll) has returned `None`.
    pub fn space(&mut self) -> &mut [u8] {
        self.decoder.space()
    }

    /// The first `n` bytes of [`space`](Self::space) arrived.
    ///
    /// # Errors
    ///
    /// [`OutOfRange`] if `n` exceeds the free space. Nothing is accepted then.
    pub fn received(&mut self, n: usize) -> Result<(), OutOfRange<usize>> {
        self.decoder.commit(n)
    }

    /// Copies in as many of the received bytes as fit and returns the rest: poll until there is no event, then pass in
    /// the rest.
    #[must_use = "the bytes that did not fit are returned"]
    pub fn receive<'b>(&mut self, bytes: &'b [u8]) -> &'b [u8] {
        self.decoder.push(bytes)
    }

    /// The UART reported an idle line. Never call this for a gap between USB packets or TCP segments.
    pub const fn idle(&mut self) {
        self.decoder.idle();
    }

    /// The next event; `None` if more bytes are needed.
    pub fn poll(&mut self) -> Option<DeviceEvent<'_, M::Request<'_>, M::Key>> {
        let span = self
            .decoder
            .advance_to_event(&self.messages, self.messages.requests())?;
        Some(self.event(span))
    }

    /// The event of an item.
    fn event(&mut self, span: Span) -> DeviceEvent<'_, M::Request<'_>, M::Key> {
        let Item { offset, kind, bytes } = self.decoder.item(span);
        match kind {
            Kind::Noise(reason) => return DeviceEvent::Noise { offset, bytes, reason },
            Kind::Broken(reason) => return DeviceEvent::Broken { offset, reason },
            Kind::Frame | Kind::Padding => {}
        }
        let key = self.messages.request(bytes).map(|info| info.key);
        match self.messages.parse_request(bytes) {
            Ok(request) => DeviceEvent::Request { request, key },
            Err(error) => DeviceEvent::Unknown {
                frame: bytes,
                error,
                key,
            },
        }
    }

    /// Writes a response at the front of `out` and returns its length in bytes. `to` is the key of its request, `None`
    /// for an unsolicited response. For a request that is still read, see [`messages`](Self::messages).
    ///
    /// # Errors
    ///
    /// [`BufferTooShort`] if `out` is too short.
    pub fn respond(
        &self,
        response: &M::Response<'_>,
        to: Option<M::Key>,
        out: &mut [u8],
    ) -> Result<usize, BufferTooShort> {
        self.messages.encode_response(response, to, out)
    }
}

impl<M: Messages + Default, const N: usize> Default for Device<M, N> {
    fn default() -> Self {
        Self::new(M::default())
    }
}

impl<M: Messages, const N: usize> fmt::Debug for Device<M, N> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Device")
            .field("decoder", &self.decoder)
            .finish_non_exhaustive()
    }
}
