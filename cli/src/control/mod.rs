//! An adapter's control port: requests and what comes unasked, over USB, CAN or a port of its own.

pub(crate) mod usb;

use std::collections::VecDeque;
use std::time::{Duration, Instant};

use armwire_bridge::control::{
    self, Event, Failure, FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Malformed, Reader, Reply, Request, Stamp,
    Subscription,
};

use crate::can::CanLine;
use crate::error::Error;
use crate::link::Line;
use crate::received::Missing;
use crate::serial::Serial;

/// Timeout of an adapter's reply: it may write its flash first, or wait for a silent arm.
const PATIENCE: Duration = Duration::from_secs(3);
/// The baud rate of a port that has none.
const BAUD: u32 = 115_200;

/// The control port of one adapter.
pub struct ControlLink {
    way: Way,
    sequence: u8,
    /// True if this port is subscribed to events.
    is_subscribed: bool,
    /// Events that were received before a reply.
    events: VecDeque<(Stamp, Event)>,
}

enum Way {
    Stream(Box<Stream>),
    /// One PDU per message.
    Can(Box<CanLine>),
}

/// Messages in COBS, each ended by a zero.
struct Stream {
    line: Box<dyn Line>,
    reader: Reader<MAX_MESSAGE>,
    /// Bytes that have arrived and were not read yet.
    rest: VecDeque<u8>,
    /// True after the end of a first message: earlier bytes may be the rest of one.
    is_in_step: bool,
}

impl ControlLink {
    /// The control port of the adapter with this serial port.
    pub(crate) fn on_usb(port: &str) -> Result<Self, Error> {
        Ok(Self::stream(Box::new(usb::UsbLine::open(port)?)))
    }

    /// A port of its own.
    pub(crate) fn on_port(port: &str) -> Result<Self, Error> {
        Ok(Self::stream(Box::new(Serial::open(port, BAUD)?)))
    }

    /// On a CAN bus.
    pub(crate) fn on_can(line: CanLine) -> Self {
        Self::new(Way::Can(Box::new(line)))
    }

    fn stream(line: Box<dyn Line>) -> Self {
        Self::new(Way::Stream(Box::new(Stream {
            line,
            reader: Reader::new(),
            rest: VecDeque::new(),
            is_in_step: false,
        })))
    }

    fn new(way: Way) -> Self {
        Self {
            way,
            // An answer that a program before us did not wait for is not to be taken for ours.
            sequence: std::process::id() as u8,
            is_subscribed: false,
            events: VecDeque::new(),
        }
    }

    /// The name on the command line.
    pub fn name(&self) -> &str {
        match &self.way {
            Way::Stream(stream) => stream.line.name(),
            Way::Can(line) => line.name(),
        }
    }

    /// Makes a request and returns the answer, which is none of those that say that it was not done.
    ///
    /// # Errors
    ///
    /// [`Error`]: the port fails, or the adapter does not answer or refuses.
    pub fn call(&mut self, request: Request) -> Result<Reply, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        self.way.send(&FromHost { sequence, request })?;
        let until = Instant::now() + PATIENCE;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.way.receive(left)? {
                Some(Ok(FromAdapter::Reply { sequence: of, reply })) if of == sequence => {
                    let reply = self.good(reply)?;
                    if let Request::Subscribe(to) = request {
                        self.is_subscribed = to != Subscription::default();
                    }
                    return Ok(reply);
                }
                // To a request that was given up.
                Some(Ok(FromAdapter::Reply { .. })) => {}
                Some(Ok(FromAdapter::Event { at, event })) => self.events.push_back((at, event)),
                Some(Err(error)) => return Err(self.malformed(error)),
                None if left.is_zero() => {
                    let (millis, hints) = (PATIENCE.as_millis(), self.way.hints());
                    return Err(Error::NoAnswer {
                        name: self.name().to_owned(),
                        cause: format!("the adapter does not answer in {millis} ms: {hints}"),
                        missing: Missing::Silent,
                        bytes: 0,
                    });
                }
                None => {}
            }
        }
    }

    /// The next event of the adapter, after a wait of at most this long. Events need a
    /// [subscription](Request::Subscribe).
    ///
    /// # Errors
    ///
    /// [`Error`]: the port fails, or a message cannot be read.
    pub fn hear(&mut self, wait: Duration) -> Result<Option<(Stamp, Event)>, Error> {
        let until = Instant::now() + wait;
        loop {
            if let Some(event) = self.events.pop_front() {
                return Ok(Some(event));
            }
            let left = until.saturating_duration_since(Instant::now());
            match self.way.receive(left)? {
                Some(Ok(FromAdapter::Event { at, event })) => return Ok(Some((at, event))),
                Some(Ok(FromAdapter::Reply { .. })) => {}
                Some(Err(error)) => return Err(self.malformed(error)),
                None if left.is_zero() => return Ok(None),
                None => {}
            }
        }
    }

    fn good(&self, reply: Reply) -> Result<Reply, Error> {
        match reply {
            Reply::Unsupported { version } => Err(Error::Unsupported {
                name: self.name().to_owned(),
                version,
            }),
            Reply::BadConfig(error) => Err(Error::refused(self.name(), format_args!("rejected: {error}"))),
            Reply::Failed(failure) => Err(Error::refused(self.name(), why(failure))),
            reply => Ok(reply),
        }
    }

    fn malformed(&self, error: Malformed) -> Error {
        let reason =
            format!("the adapter says what cannot be read ({error}): is its firmware newer than this program?");
        Error::at(self.name(), reason)
    }
}

/// Why the adapter did not do what it was asked.
fn why(failure: Failure) -> String {
    match failure {
        Failure::Flash => "the adapter's flash does not take the configuration".to_owned(),
        Failure::Busy => "the adapter is busy with another such request: try again".to_owned(),
        Failure::StreamArmed => "refused while a host streams motion: stop it and try again".to_owned(),
        Failure::LineHeld => {
            "the host on USB holds the line to the arm: close the program on the adapter's serial port, \
                              or end 'armwire hold'"
                .to_owned()
        }
        Failure::TooManySaves { wait_s } => {
            format!("not saved: so many saves would wear the flash out; the next may come in {wait_s} s")
        }
        Failure::SupplyLow => "not saved: the adapter's 3.3 V supply is below 2.9 V, too low to write flash".to_owned(),
        other => format!("refused: {other:?}"),
    }
}

impl Drop for ControlLink {
    fn drop(&mut self) {
        if self.is_subscribed {
            // The program ends: an error has no recipient.
            let _ = self.call(Request::Subscribe(Subscription::default()));
        }
    }
}

impl Way {
    fn send(&mut self, message: &FromHost) -> Result<(), Error> {
        match self {
            Self::Stream(stream) => stream.send(message),
            Self::Can(line) => {
                let mut pdu = [0; MAX_MESSAGE];
                let n = control::encode(message, &mut pdu).expect("room for any message");
                line.send(&pdu[..n])
            }
        }
    }

    /// The next message, waiting so long for it.
    fn receive(&mut self, wait: Duration) -> Result<Option<Result<FromAdapter, Malformed>>, Error> {
        match self {
            Self::Stream(stream) => stream.receive(wait),
            Self::Can(line) => Ok(line.receive(wait)?.map(|pdu| control::decode(&pdu))),
        }
    }

    /// Hints for an adapter that does not reply.
    fn hints(&self) -> String {
        match self {
            Self::Stream(_) => "is it the control port of an armwire adapter?".to_owned(),
            Self::Can(line) => line.adapter_hints(),
        }
    }
}

impl Stream {
    fn send(&mut self, message: &FromHost) -> Result<(), Error> {
        // The zero in front ends what an earlier program may have begun.
        let mut out = [0; 1 + MAX_COBS];
        let n = control::encode_cobs(message, &mut out[1..]).expect("room for any message");
        let mut rest = &out[..1 + n];
        while !rest.is_empty() {
            let n = self.line.write(rest)?;
            rest = &rest[n..];
        }
        Ok(())
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Result<FromAdapter, Malformed>>, Error> {
        let until = Instant::now() + wait;
        loop {
            let unread = self.reader.push(self.rest.make_contiguous()).len();
            self.rest.drain(..self.rest.len() - unread);
            let message = self.reader.next();
            if let Some(message) = message {
                let is_in_step = std::mem::replace(&mut self.is_in_step, true);
                if is_in_step || message.is_ok() {
                    return Ok(Some(message));
                }
                continue;
            }
            let left = until.saturating_duration_since(Instant::now());
            let mut buf = [0; 512];
            let n = self.line.read(&mut buf, left)?;
            self.rest.extend(&buf[..n]);
            if n == 0 && left.is_zero() {
                return Ok(None);
            }
        }
    }
}
