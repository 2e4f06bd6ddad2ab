//! A host for requests with several answers: each is a send of its own in an [`Exchange`].

use armwire::decoder::{Decoder, Item, Kind};
use armwire::exchange::{Exchange, FirstByte, Handover, Match};
use armwire::framing::Reason;
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Config, EncodeError};

use crate::{Expect, Feetech, MAX_FRAME, Request, Status};

/// An event on the line of a [`Host`].
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Event<'a> {
    /// An answer to the request.
    Answer(Status<'a>),
    /// An answer that did not come in time, by the id of its servo.
    Missing(u8),
    /// An answer that was missing, and arrived in the stale window.
    Late(Status<'a>),
    /// An answer without a request.
    Unsolicited(Status<'a>),
    /// Bytes of a request, on a line that echoes.
    Echo(&'a [u8]),
    /// Bytes that are not part of a packet.
    Noise(&'a [u8], Reason),
}

/// A host without I/O that waits for up to `N` answers. Answers beyond these are unsolicited.
///
/// ```
/// use armwire::Config;
/// use armwire::time::Instant;
/// use armwire_feetech::{Event, Feetech, Host, MAX_FRAME, Request, register};
///
/// let mut host = Host::<8>::new(Feetech::default(), Config::default());
/// let (mut out, sent) = ([0; MAX_FRAME], Instant::ZERO);
/// let request = Request::SyncRead { address: register::VOLTAGE.address, len: 1, ids: &[1, 2] };
/// assert_eq!(host.send(&request, sent, &mut out)?, Some(10)); // write these bytes
/// assert!(host.decoder.push(&[0xFF, 0xFF, 0x01, 0x03, 0x00, 0x4A, 0xB1]).is_empty());
/// assert!(matches!(host.poll(sent), Some(Event::Answer(status)) if status.data == [74]));
/// let late = host.exchange.timeout().expect("it waits for servo 2");
/// assert_eq!(host.poll(late), Some(Event::Missing(2)));
/// # Ok::<(), armwire::EncodeError>(())
/// ```
pub struct Host<const N: usize> {
    /// Received bytes go in here. After a silence inside a packet, call [`idle`](Decoder::idle).
    pub decoder: Decoder<Feetech, MAX_FRAME>,
    /// The expected answers, each initiated for the id of its servo.
    pub exchange: Exchange<Feetech, u8, N>,
    protocol: Feetech,
    config: Config,
    /// The offset of the first byte behind the last echo.
    behind_echo: u64,
}

impl<const N: usize> Host<N> {
    /// A host on an idle line. `config` has the line's timing.
    pub const fn new(protocol: Feetech, config: Config) -> Self {
        Self {
            decoder: Decoder::new(),
            exchange: Exchange::new(config.stale_window),
            protocol,
            config,
            behind_echo: 0,
        }
    }

    /// Writes a request at the front of `out` and returns its length in bytes, to be sent at once. `None` if an answer with
    /// the same key is expected, or may still arrive: retry after the [`exchange`](Self::exchange)'s next timeout.
    ///
    /// # Errors
    ///
    /// As [`Messages::encode_request`].
    pub fn send(&mut self, request: &Request, now: Instant, out: &mut [u8]) -> Result<Option<usize>, EncodeError> {
        let (protocol, exchange) = (self.protocol, &mut self.exchange);
        let n = protocol.encode_request(request, out)?;
        let frame = out.get(..n).unwrap_or_default();
        exchange.expire(now);
        if !protocol
            .answers(frame)
            .all(|info| exchange.can_send(&info, info.key.id))
        {
            return Ok(None);
        }
        let echo = if protocol.echoes { n } else { 0 };
        // Behind the echoes of earlier requests, which may still be due.
        let offset = self.decoder.received().max(self.behind_echo) + echo as u64;
        for info in protocol.answers(frame) {
            let timeout = info.response.map(|response| self.config.timeout(n, response));
            let due = now + timeout.unwrap_or_default();
            exchange.begin(info, info.key.id, Handover { offset, at: now, due });
        }
        self.behind_echo = offset;
        Ok(Some(n))
    }

    /// The next event; `None` if bytes or time are needed.
    pub fn poll(&mut self, now: Instant) -> Option<Event<'_>> {
        let Some(Item { offset, kind, bytes }) = self.decoder.next(&self.protocol, Expect::Responses) else {
            return self.exchange.on_timeout(now).map(Event::Missing);
        };
        if self.protocol.echoes && offset < self.behind_echo {
            return Some(Event::Echo(bytes));
        }
        let status = match (kind, self.protocol.parse_response(bytes, Expect::Responses)) {
            (Kind::Frame, Ok(status)) => status,
            (Kind::Noise(reason), _) => return Some(Event::Noise(bytes, reason)),
            _ => return None,
        };
        let first = FirstByte { offset, at: None };
        Some(match self.exchange.on_frame(&self.protocol, bytes, first, now) {
            Match::Answer { .. } => Event::Answer(status),
            Match::Late { .. } => Event::Late(status),
            Match::Unsolicited => Event::Unsolicited(status),
        })
    }
}
