//! An adapter's control port: requests and events, over USB, CAN or a port of its own.

mod reservation;
pub(crate) mod usb;

use std::collections::VecDeque;
use std::fmt;
use std::sync::atomic::{AtomicU8, Ordering};
use std::time::{Duration, Instant};

use armwire_bridge::control::{
    self, Event, Failure, FromAdapter, FromHost, MAX_COBS, MAX_MESSAGE, Malformed, Reader, Reply, Request, Stamp,
    Subscription,
};

use crate::describe::hex;
use crate::error::Error;
use crate::error::received::Missing;
use crate::error::text::{Remedy, Text};
use crate::ports::line::Line;
use crate::time::stopwatch::after;

pub use crate::error::usb_fault::{UsbFault, VENDOR_AND_PRODUCT};
pub use reservation::ReservedLine;
pub use usb::usb_serial_number;

/// Timeout of an adapter's reply: it may write its flash first, or wait for a silent arm.
const REPLY_TIMEOUT: Duration = Duration::from_secs(3);
/// Maximum number of events that wait for [`next_event`](Adapter::next_event): four seconds of polls at 1 kHz.
const MAX_EVENTS: usize = 4_096;

/// The control port of one adapter.
pub struct Adapter {
    transport: Box<dyn Transport>,
    sequence: u8,
    /// The sequence number of the last request that was sent without a wait.
    sent: Option<u8>,
    /// True if this port may be subscribed to events: from a subscription that is sent to the reply that ends it.
    is_subscribed: bool,
    /// Events that were received before a reply, and messages that cannot be read.
    events: VecDeque<Result<(Stamp, Event), Malformed>>,
    /// Number of events dropped since the last report.
    dropped: u64,
}

/// A message of the adapter.
pub(crate) type Received = Result<FromAdapter, Malformed>;

/// A transport of messages.
pub(crate) trait Transport: Send {
    /// The name that the user gave it.
    fn name(&self) -> &str;

    fn send(&mut self, message: &FromHost) -> Result<(), Error>;

    /// The next message within this time. `None` on timeout.
    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, Error>;

    /// A hint for an adapter that does not reply.
    fn hint(&self) -> String;

    /// The bytes that have arrived and are no message. A transport of whole messages has none.
    fn strays(&self) -> Strays {
        Strays::default()
    }
}

/// Bytes that are no message.
#[derive(Clone, Debug, Default)]
pub(crate) struct Strays {
    count: usize,
    /// The first of them.
    first: Vec<u8>,
}

impl Strays {
    fn extend(&mut self, bytes: &[u8]) {
        self.append(bytes.len(), bytes);
    }

    /// Appends this number of bytes, which begin with these.
    fn append(&mut self, count: usize, first: &[u8]) {
        /// The number of bytes that are kept.
        const KEPT: usize = 16;
        self.count = self.count.saturating_add(count);
        let room = KEPT - self.first.len();
        self.first.extend(first.iter().take(room));
    }
}

/// A stream of messages in COBS, each ended by a zero.
struct Stream {
    line: Box<dyn Line>,
    reader: Reader<MAX_MESSAGE>,
    /// Bytes that have arrived and were not read yet.
    rest: VecDeque<u8>,
    /// True after the end of a first message: earlier bytes may be the rest of one.
    is_in_step: bool,
    /// The bytes of the message that is being read.
    message: Strays,
    /// The bytes of messages that could not be read.
    strays: Strays,
}

/// The sequence number before the first request of a link. A reply to an earlier program, or to an earlier link of this
/// one, must not be taken for its own.
fn first_sequence() -> u8 {
    static LINKS: AtomicU8 = AtomicU8::new(0);
    /// Distance between the first numbers of two links. It is odd: 256 links have different ones.
    const STEP: u8 = 101;
    (std::process::id() as u8).wrapping_add(LINKS.fetch_add(STEP, Ordering::Relaxed))
}

impl Adapter {
    /// On USB, or on a port of its own.
    pub(crate) fn on_line(line: Box<dyn Line>) -> Self {
        Self::new(Box::new(Stream {
            line,
            reader: Reader::new(),
            rest: VecDeque::new(),
            is_in_step: false,
            message: Strays::default(),
            strays: Strays::default(),
        }))
    }

    pub(crate) fn new(transport: Box<dyn Transport>) -> Self {
        Self {
            transport,
            sequence: first_sequence(),
            sent: None,
            is_subscribed: false,
            events: VecDeque::new(),
            dropped: 0,
        }
    }

    /// The name that the user gave it.
    pub fn name(&self) -> &str {
        self.transport.name()
    }

    /// Makes a request and returns the reply. Replies of a request that failed or was refused are errors.
    ///
    /// # Errors
    ///
    /// [`Error`]: the port fails, or the adapter does not answer or refuses.
    pub fn call(&mut self, request: Request) -> Result<Reply, Error> {
        self.sequence = self.sequence.wrapping_add(1);
        let sequence = self.sequence;
        if let Request::Subscribe(to) = request {
            self.is_subscribed |= to != Subscription::default();
        }
        self.transport.send(&FromHost { sequence, request })?;
        let until = Instant::now() + REPLY_TIMEOUT;
        let mut malformed = None;
        // The reply may be behind events that have arrived while this process did not run.
        let mut overdue = MAX_EVENTS;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let received = self.transport.receive(left)?;
            overdue -= usize::from(left.is_zero());
            match received {
                Some(Ok(FromAdapter::Reply { sequence: of, reply })) if of == sequence => {
                    let reply = self.checked(reply)?;
                    if let Request::Subscribe(to) = request {
                        self.is_subscribed = to != Subscription::default();
                        // They belong to the earlier subscription.
                        self.events.clear();
                        self.dropped = 0;
                    }
                    return Ok(reply);
                }
                // To a request that was given up.
                Some(Ok(FromAdapter::Reply { .. })) => {}
                Some(Ok(FromAdapter::Event { at, event })) => self.keep(Ok((at, event))),
                // Behind more bytes than a message has, it is one by chance.
                Some(Err(error)) if error.sequence == Some(sequence) && self.transport.strays().count <= MAX_COBS => {
                    return Err(self.malformed(error));
                }
                // Perhaps an event of newer firmware.
                Some(Err(error)) => {
                    malformed = Some(error);
                    self.keep(Err(error));
                }
                None if left.is_zero() => overdue = 0,
                None => {}
            }
            if overdue == 0 {
                return Err(self.no_answer(malformed));
            }
        }
    }

    /// Sends a request without a wait for its reply. A refusal is an error of [`next_event`](Self::next_event), unless a
    /// call comes first.
    ///
    /// # Errors
    ///
    /// [`Error`]: the port fails.
    pub fn send(&mut self, request: Request) -> Result<(), Error> {
        self.sequence = self.sequence.wrapping_add(1);
        self.sent = Some(self.sequence);
        let sequence = self.sequence;
        self.transport.send(&FromHost { sequence, request })
    }

    /// Stops the arm, whoever moves it: see [`Request::Stop`].
    ///
    /// # Errors
    ///
    /// [`Error::NotStopped`] if the adapter could not stop the arm. Otherwise as [`call`](Self::call).
    pub fn stop(&mut self) -> Result<(), Error> {
        self.call(Request::Stop).map(drop)
    }

    /// The next event of the adapter, after a wait of at most this long. Events need a
    /// [subscription](Request::Subscribe). At most 4096 events wait. A new subscription begins without any.
    ///
    /// # Errors
    ///
    /// [`Error`]: the port fails, or a message cannot be read, such as one of newer firmware. A later call returns the
    /// next event. [`Error::At`], once, if too many events waited: the oldest were dropped.
    pub fn next_event(&mut self, wait: Duration) -> Result<Option<(Stamp, Event)>, Error> {
        let until = after(wait);
        loop {
            match std::mem::take(&mut self.dropped) {
                0 => {}
                dropped => {
                    let reason = format!("{dropped} events were dropped: more than {MAX_EVENTS} waited to be read");
                    return Err(Error::at(self.name(), reason));
                }
            }
            if let Some(event) = self.events.pop_front() {
                return event.map(Some).map_err(|error| self.malformed(error));
            }
            let left = until.saturating_duration_since(Instant::now());
            match self.transport.receive(left)? {
                Some(Ok(FromAdapter::Event { at, event })) => return Ok(Some((at, event))),
                Some(Ok(FromAdapter::Reply { sequence, reply })) if self.sent == Some(sequence) => {
                    self.sent = None;
                    self.checked(reply)?;
                }
                Some(Ok(FromAdapter::Reply { .. })) => {}
                Some(Err(error)) => return Err(self.malformed(error)),
                None if left.is_zero() => return Ok(None),
                None => {}
            }
        }
    }

    /// Keeps an event for [`next_event`](Self::next_event). The oldest makes room.
    fn keep(&mut self, event: Result<(Stamp, Event), Malformed>) {
        if self.events.len() == MAX_EVENTS {
            self.events.pop_front();
            self.dropped += 1;
        }
        self.events.push_back(event);
    }

    fn checked(&self, reply: Reply) -> Result<Reply, Error> {
        match reply {
            Reply::Unsupported { version } => Err(Error::Unsupported {
                name: self.name().into(),
                version,
            }),
            Reply::BadConfig(error) => Err(Error::refused(self.name(), format_args!("rejected: {error}"))),
            Reply::Failed(failure) => {
                let (name, reason) = (self.name().into(), describe(failure));
                Err(match failure {
                    Failure::ArmSilent | Failure::PoseOutOfRange | Failure::NotStoppable(_) => {
                        Error::NotStopped { name, cause: reason }
                    }
                    _ => Error::Refused { name, reason },
                })
            }
            reply => Ok(reply),
        }
    }

    fn malformed(&self, error: Malformed) -> Error {
        let reason =
            format!("a message of the adapter cannot be read ({error}): is its firmware newer than this program?");
        Error::at(self.name(), reason)
    }

    /// The error of a missing reply. A message may have been malformed meanwhile.
    fn no_answer(&self, malformed: Option<Malformed>) -> Error {
        let strays = self.transport.strays();
        let arrived = match (strays.count, malformed) {
            (0, Some(error)) => return self.malformed(error),
            (0, None) => String::new(),
            (count, _) => format!(
                ", and {count} bytes arrive that are no message of it (first bytes: {})",
                hex(&strays.first)
            ),
        };
        Error::NoAnswer {
            name: self.name().into(),
            cause: format!(
                "the adapter does not answer in {} ms{arrived}",
                REPLY_TIMEOUT.as_millis()
            )
            .into(),
            hint: self.transport.hint().into(),
            missing: Missing::Adapter,
            bytes: strays.count,
        }
    }
}

impl fmt::Debug for Adapter {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Adapter")
            .field("name", &self.name())
            .field("is_subscribed", &self.is_subscribed)
            .finish_non_exhaustive()
    }
}

/// The reason for a failed request.
fn describe(failure: Failure) -> Text {
    let reason = match failure {
        Failure::Flash => "not saved: the write to the adapter's flash failed".to_owned(),
        Failure::Busy => "the adapter is busy with an earlier request: try again".to_owned(),
        Failure::StreamArmed => "refused while a host streams motion: stop it and try again".to_owned(),
        Failure::LineReserved => {
            let reason = "the line to the arm is reserved for USB: close the program on the adapter's serial port, or end \
                          its reservation";
            return Text::from(reason).remedy(Remedy::EndReservation);
        }
        Failure::TooManySaves { wait_s } => {
            format!("not saved: the budget of saves, which limits flash wear, is used up; next save in {wait_s} s")
        }
        Failure::SupplyLow => "not saved: the adapter's 3.3 V supply is below 2.9 V, too low to write flash".to_owned(),
        Failure::NoRoom => {
            "not saved: the flash is full, and an erase would stall the adapter, whose serial port a program has open. \
             Close that program, and save again"
                .to_owned()
        }
        Failure::ArmSilent => {
            "the arm does not answer. It may still move: switch its supply off. Motion is refused for 2 s".to_owned()
        }
        Failure::PoseOutOfRange => {
            "the arm reports a pose that cannot be held, or is not an Alicia-D. It may still move: switch its supply \
             off. Motion is refused for 2 s"
                .to_owned()
        }
        Failure::NotStoppable(kind) => {
            format!("the adapter cannot stop an arm of kind '{kind}'. Only its supply's switch stops it")
        }
        other => format!("refused: {other:?}"),
    };
    reason.into()
}

impl Drop for Adapter {
    fn drop(&mut self) {
        if self.is_subscribed {
            // The program ends: an error has no recipient.
            let _ = self.call(Request::Subscribe(Subscription::default()));
        }
    }
}

impl Transport for Stream {
    fn name(&self) -> &str {
        self.line.name()
    }

    fn send(&mut self, message: &FromHost) -> Result<(), Error> {
        // The zero in front ends a partial message of an earlier program.
        let mut out = [0; 1 + MAX_COBS];
        let n = control::encode_cobs(message, &mut out[1..]).expect("room for any message");
        self.line.write_all(&out[..1 + n])
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Received>, Error> {
        let until = after(wait);
        let mut is_over = false;
        loop {
            let bytes = self.rest.make_contiguous();
            let read = bytes.len() - self.reader.push(bytes).len();
            self.message.extend(&bytes[..read]);
            self.rest.drain(..read);
            let message = self.reader.next();
            if let Some(message) = message {
                let bytes = std::mem::take(&mut self.message);
                if message.is_err() {
                    self.strays.append(bytes.count, &bytes.first);
                }
                let is_in_step = std::mem::replace(&mut self.is_in_step, true);
                if is_in_step || message.is_ok() {
                    return Ok(Some(message));
                }
                continue;
            }
            // Bytes that do not end do not extend the wait.
            if is_over {
                return Ok(None);
            }
            let left = until.saturating_duration_since(Instant::now());
            is_over = left.is_zero();
            let mut buf = [0; 512];
            let n = self.line.read(&mut buf, left)?;
            self.rest.extend(&buf[..n]);
        }
    }

    fn strays(&self) -> Strays {
        let mut strays = self.strays.clone();
        strays.append(self.message.count, &self.message.first);
        strays
    }

    fn hint(&self) -> String {
        "is it the control port of an armwire adapter?".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use armwire_bridge::config::ArmKind;
    use armwire_bridge::control::encode_cobs;

    use super::*;
    use crate::ports::endless::Endless;
    use crate::ports::line::{Names, Reception};

    /// An adapter that sends this many events before each reply, stamped 0 and up.
    struct EventSource {
        events: u64,
        reply: Reply,
        out: VecDeque<u8>,
    }

    impl EventSource {
        fn send(&mut self, message: &FromAdapter) {
            let mut bytes = [0; MAX_COBS];
            let n = encode_cobs(message, &mut bytes).unwrap();
            self.out.extend(&bytes[..n]);
        }
    }

    impl Line for EventSource {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
            let n = buf.len().min(self.out.len());
            buf.iter_mut()
                .zip(self.out.drain(..n))
                .for_each(|(to, byte)| *to = byte);
            Ok(n)
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            let mut reader = Reader::<MAX_MESSAGE>::new();
            assert!(reader.push(&bytes[1..]).is_empty());
            let request: FromHost = reader.next().unwrap().unwrap();
            for at in 0..self.events {
                let event = Event::BusOff { off: true };
                self.send(&FromAdapter::Event { at: Stamp(at), event });
            }
            let (sequence, reply) = (request.sequence, self.reply.clone());
            self.send(&FromAdapter::Reply { sequence, reply });
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    fn link(events: u64) -> Adapter {
        link_with(events, Reply::Done)
    }

    fn link_with(events: u64, reply: Reply) -> Adapter {
        let out = VecDeque::new();
        Adapter::on_line(Box::new(EventSource { events, reply, out }))
    }

    #[test]
    fn failed_stop_says_what_stops_the_arm() {
        let stop = |failure| {
            let error = link_with(0, Reply::Failed(failure)).stop().unwrap_err();
            assert!(matches!(error, Error::NotStopped { .. }), "{error:?}");
            error.to_string()
        };
        for failure in [
            Failure::ArmSilent,
            Failure::PoseOutOfRange,
            Failure::NotStoppable(ArmKind::Raw),
        ] {
            let text = stop(failure);
            assert!(
                text.starts_with("fake: not stopped: ") && text.contains("supply"),
                "{text}"
            );
        }
        assert!(stop(Failure::NotStoppable(ArmKind::Raw)).contains("'raw'"));
        assert!(link(0).stop().is_ok());
    }

    #[test]
    fn refusal_of_a_sent_request_follows() {
        let mut link = link_with(1, Reply::Unsupported { version: 1 });
        link.send(Request::EndStream).unwrap();
        assert!(link.next_event(Duration::ZERO).unwrap().is_some());
        let error = link.next_event(Duration::ZERO).unwrap_err();
        assert!(matches!(error, Error::Unsupported { .. }), "{error:?}");
        assert_eq!(link.next_event(Duration::ZERO).unwrap(), None);
    }

    #[test]
    fn dropped_events_are_reported_once() {
        let mut link = link(MAX_EVENTS as u64 + 3);
        link.call(Request::EndStream).unwrap();
        assert_eq!(
            link.next_event(Duration::ZERO).unwrap_err().to_string(),
            "fake: 3 events were dropped: more than 4096 waited to be read"
        );
        for at in 3..MAX_EVENTS as u64 + 3 {
            assert_eq!(link.next_event(Duration::ZERO).unwrap().unwrap().0, Stamp(at));
        }
        assert_eq!(link.next_event(Duration::ZERO).unwrap(), None);
    }

    #[test]
    fn subscription_begins_without_old_events() {
        let mut link = link(MAX_EVENTS as u64 + 3);
        link.call(Request::EndStream).unwrap();
        link.call(Request::Subscribe(Subscription::default())).unwrap();
        assert_eq!(link.next_event(Duration::ZERO).unwrap(), None);
    }

    /// A port that takes messages and returns none.
    struct Deaf(Arc<Mutex<Vec<Request>>>);

    impl Line for Deaf {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, _: &mut [u8], _: Duration) -> Result<usize, Error> {
            Err(Error::lost("fake", "no"))
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            let mut reader = Reader::<MAX_MESSAGE>::new();
            assert!(reader.push(&bytes[1..]).is_empty());
            let FromHost { request, .. } = reader.next().unwrap().unwrap();
            self.0.lock().unwrap().push(request);
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    #[test]
    fn subscription_without_a_reply_is_ended() {
        let requests = Arc::default();
        let mut adapter = Adapter::on_line(Box::new(Deaf(Arc::clone(&requests))));
        let (frames, events) = (true, false);
        let subscription = Subscription { frames, events };
        adapter.subscribe(subscription).unwrap_err();
        drop(adapter);
        let ended = Subscription::default();
        assert_eq!(
            *requests.lock().unwrap(),
            [Request::Subscribe(subscription), Request::Subscribe(ended)]
        );
    }

    /// An adapter that sends these messages after a request, by its sequence number.
    struct Scripted {
        messages: VecDeque<fn(u8) -> Received>,
        sequence: u8,
    }

    impl Transport for Scripted {
        fn name(&self) -> &str {
            "fake"
        }

        fn send(&mut self, message: &FromHost) -> Result<(), Error> {
            self.sequence = message.sequence;
            Ok(())
        }

        fn receive(&mut self, _: Duration) -> Result<Option<Received>, Error> {
            Ok(self.messages.pop_front().map(|message| message(self.sequence)))
        }

        fn hint(&self) -> String {
            String::new()
        }
    }

    fn scripted(messages: &[fn(u8) -> Received]) -> Adapter {
        Adapter::new(Box::new(Scripted {
            messages: messages.iter().copied().collect(),
            sequence: 0,
        }))
    }

    #[test]
    fn event_is_waited_for_without_a_limit() {
        let event = |_| {
            let (at, event) = (Stamp(1), Event::BusOff { off: true });
            Ok(FromAdapter::Event { at, event })
        };
        let (at, _) = scripted(&[event]).next_event(Duration::MAX).unwrap().unwrap();
        assert_eq!(at, Stamp(1));
    }

    #[test]
    fn unknown_event_does_not_end_a_call() {
        let event = |_| control::decode(&[1, 0, 99]);
        let reply = |sequence| {
            let reply = Reply::Done;
            Ok(FromAdapter::Reply { sequence, reply })
        };
        let mut adapter = scripted(&[event, reply]);
        assert_eq!(adapter.call(Request::EndStream).unwrap(), Reply::Done);
        let error = adapter.next_event(Duration::ZERO).unwrap_err().to_string();
        assert!(error.contains("cannot be read"), "{error}");
        assert_eq!(adapter.next_event(Duration::ZERO).unwrap(), None);
    }

    #[test]
    fn bytes_without_end_are_no_event() {
        for bytes in [&b"25.3 C\r\n"[..], &[0], &[0xFF]] {
            let mut adapter = Adapter::on_line(Box::new(Endless(bytes)));
            assert_eq!(adapter.next_event(Duration::ZERO).unwrap(), None, "{bytes:02X?}");
        }
    }

    #[test]
    fn unknown_reply_ends_its_call() {
        let mut adapter = scripted(&[|sequence| control::decode(&[0, sequence, 99])]);
        let error = adapter.call(Request::EndStream).unwrap_err().to_string();
        assert!(error.contains("cannot be read"), "{error}");
    }
}
