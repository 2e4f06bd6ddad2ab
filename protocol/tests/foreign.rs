//! A protocol outside the crate on its engine: requests without a void, values that do not fit, a line that echoes. And
//! the voids of the crate's protocols.

#[allow(dead_code, unreachable_pub, reason = "it is shared with other tests")]
mod vectors;

use std::cell::{Cell, RefCell};
use std::fmt;
use std::future::pending;
use std::pin::pin;
use std::task::{Context, Waker};

use armwire::alpha1::Alpha1;
use armwire::correlation::{Correlation, Effect, InfoOf, RequestInfo, ResponseTiming};
use armwire::driver::{Clock, Driver};
use armwire::framing::{Framing, LONGEST_VOID, Reason, Scan};
use armwire::ling::Ling;
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{
    BufferTooShort, Cause, Client, Config, Device, DeviceEvent, EncodeError, Event, MessageId, OutOfRange, Output,
    ParseError, SubmitError,
};
use embedded_io_async::{ErrorKind, ErrorType, Read, Write};
use proptest::prelude::*;
use vectors::Vector;

/// A protocol without an end mark: 55 from the host or 56 from the arm, a number of bytes, the bytes, their sum.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Summed {
    /// The header of the arm's frames.
    header: u8,
    echoes: bool,
}

const SUMMED: Summed = Summed {
    header: 0x56,
    echoes: false,
};

/// One wire, on which a request and its answer look alike.
const ONE_WIRE: Summed = Summed {
    header: 0x55,
    echoes: true,
};

/// The bytes of a message.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Bytes<'a>(&'a [u8]);

impl fmt::Display for Bytes<'_> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{:02X?}", self.0)
    }
}

fn sum(bytes: &[u8]) -> u8 {
    bytes.iter().fold(0, |sum, byte| sum.wrapping_add(*byte))
}

/// The most bytes of a message.
const MAX: u16 = 200;

fn put(header: u8, bytes: &[u8], out: &mut [u8]) -> Result<usize, BufferTooShort> {
    let frame = [&[header, bytes.len() as u8], bytes, &[sum(bytes)]].concat();
    let (needed, got) = (frame.len(), out.len());
    out.get_mut(..needed)
        .ok_or(BufferTooShort { needed, got })?
        .copy_from_slice(&frame);
    Ok(needed)
}

fn parse(frame: &[u8]) -> Result<Bytes<'_>, ParseError> {
    let (message, cause) = (MessageId::None, Cause::Unknown);
    frame
        .get(2..frame.len() - 1)
        .map(Bytes)
        .ok_or(ParseError { message, cause })
}

impl Framing for Summed {
    /// The header.
    type Expect = u8;

    fn scan(&self, window: &[u8], header: u8) -> Scan {
        match window {
            [first, ..] if *first != header => Scan::Noise(1, Reason::Stray),
            [_, len, rest @ ..] => match rest.split_at_checked(usize::from(*len)) {
                Some((bytes, [got, ..])) if sum(bytes) == *got => Scan::Frame(3 + bytes.len()),
                Some((_, [_, ..])) => Scan::Noise(1, Reason::Stray),
                _ => Scan::Need(usize::from(*len) + 1 - rest.len()),
            },
            _ => Scan::Need(3 - window.len()),
        }
    }

    fn terminator(&self, _: u8) -> Option<u8> {
        None
    }

    fn shortest(&self, _: u8) -> usize {
        3
    }

    fn requests(&self) -> u8 {
        0x55
    }

    fn unsolicited(&self) -> u8 {
        self.header
    }
}

impl Correlation for Summed {
    type Key = ();

    fn request(&self, _frame: &[u8]) -> Option<InfoOf<Self>> {
        Some(RequestInfo {
            key: (),
            expect: self.header,
            response: Some(ResponseTiming {
                longest: 10,
                turnaround: Duration::from_millis(1),
            }),
            effect: Effect::Read,
        })
    }

    fn is_response_to(&self, (): (), frame: &[u8]) -> bool {
        frame.first() == Some(&self.header)
    }

    fn echoes(&self) -> bool {
        self.echoes
    }
}

impl Messages for Summed {
    type Request<'a> = Bytes<'a>;
    type Response<'a> = Bytes<'a>;
    type EncodeError = EncodeError;

    fn encode_request(&self, request: &Bytes<'_>, out: &mut [u8]) -> Result<usize, EncodeError> {
        match request.0.len() {
            len if len > MAX.into() => Err(OutOfRange::new("message", "bytes", len as u16, 0, MAX))?,
            _ => Ok(put(0x55, request.0, out)?),
        }
    }

    fn parse_request<'a>(&self, frame: &'a [u8]) -> Result<Bytes<'a>, ParseError> {
        parse(frame)
    }

    fn encode_response(&self, response: &Bytes<'_>, _: Option<()>, out: &mut [u8]) -> Result<usize, BufferTooShort> {
        put(self.header, response.0, out)
    }

    fn parse_response<'a>(&self, frame: &'a [u8], _: u8) -> Result<Bytes<'a>, ParseError> {
        parse(frame)
    }
}

/// The requests that an arm executes, which searches every byte for a frame.
fn executed<M: Messages>(arm: M, line: &[u8]) -> Vec<String> {
    let (mut device, mut requests) = (Device::<M, 300>::new(arm), Vec::new());
    // A false header delays what follows, if all bytes arrive at once.
    for byte in line {
        assert!(device.receive(&[*byte]).is_empty());
        while let Some(event) = device.poll() {
            if let DeviceEvent::Request { request, .. } = event {
                requests.push(format!("{request:?}"));
            }
        }
    }
    requests
}

/// Transmits up to `limit` bytes to an empty port, and returns them and the texts of events.
fn transmit<M: Messages>(client: &mut Client<M, 260>, limit: usize) -> (Vec<u8>, Vec<String>) {
    let (mut line, mut events) = (Vec::new(), Vec::new());
    while line.len() < limit {
        match client.poll(Instant::ZERO) {
            Output::Receive => client.received(Instant::ZERO, 0).unwrap(),
            Output::Transmit(bytes) => {
                let n = bytes.len().min(limit - line.len());
                line.extend(&bytes[..n]);
                client.transmitted(Instant::ZERO, n).unwrap();
            }
            Output::Event(event) => events.push(format!("{event:?}")),
            Output::Timeout(_) => break,
        }
    }
    (line, events)
}

/// Cancels each request after each number of its bytes, and submits the next one.
fn each_cut_is_voided<M: Messages>(arm: M, requests: &[Vector]) {
    for (vector, next) in requests.iter().zip(requests.iter().cycle().skip(1)) {
        let (request, next) = (
            arm.parse_request(&vector.bytes).unwrap(),
            arm.parse_request(&next.bytes).unwrap(),
        );
        let len = arm.encode_request(&request, &mut [0; 260]).unwrap();
        for cut in 1..len {
            let mut client = Client::<M, 260>::new(arm, Config::DEFAULT);
            client.submit(&request).unwrap();
            let (mut line, _) = transmit(&mut client, cut);
            client.cancel();
            client.submit(&next).unwrap();
            line.extend(transmit(&mut client, usize::MAX).0);
            assert_eq!(
                executed(arm, &line),
                [format!("{next:?}")],
                "{} cut after {cut} bytes",
                vector.name
            );
        }
    }
}

#[test]
fn no_cut_of_a_request_is_executed() {
    each_cut_is_voided(Ling, &vectors::ling_requests());
    each_cut_is_voided(Alpha1, &vectors::alpha1_requests());
}

proptest! {
    #[test]
    fn no_cut_of_random_bytes_is_executed(bytes in prop::collection::vec(any::<u8>(), 1..80), cut in any::<prop::sample::Index>()) {
        // A receiver that is out of step takes any of these for the front of a request.
        let start = [&[0xAA, 0x06][..], &bytes].concat();
        let line = [&start[..=cut.index(start.len())], &[0; LONGEST_VOID]].concat();
        let whole = |line: &[u8]| executed(Ling, line);
        // Those that are whole before the void.
        prop_assert_eq!(whole(&line), whole(&line[..line.len() - LONGEST_VOID]));
    }
}

/// It is completed by zeros, as its sum is 0.
const REQUEST: Bytes<'static> = Bytes(&[0x00, 0x00, 0x00, 0x00]);
const NEXT: Bytes<'static> = Bytes(&[0x07]);
const NEXT_BYTES: [u8; 4] = [0x55, 0x01, 0x07, 0x07];
const WHOLE: [u8; 7] = [0x55, 0x04, 0x00, 0x00, 0x00, 0x00, 0x00];

#[test]
fn request_without_void_is_transmitted_to_its_end() {
    for cut in 1..WHOLE.len() {
        let mut client = Client::<Summed, 260>::new(SUMMED, Config::DEFAULT);
        client.submit(&REQUEST).unwrap();
        let (mut line, _) = transmit(&mut client, cut);
        client.cancel();
        assert_eq!(client.submit(&NEXT), Err(SubmitError::Busy), "after {cut} bytes");
        let (rest, events) = transmit(&mut client, usize::MAX);
        line.extend(rest);
        assert_eq!(
            (&line[..], &events[..]),
            (&WHOLE[..], &["Sent".to_owned()][..]),
            "after {cut} bytes"
        );
        assert!(client.is_idle());

        // Its answer is late, and the next request waits for it.
        client.submit(&NEXT).unwrap();
        assert_eq!(transmit(&mut client, usize::MAX), (vec![], vec![]));
        assert!(client.receive(Instant::ZERO, &[0x56, 0, 0]).is_empty());
        assert_eq!(
            transmit(&mut client, usize::MAX),
            (NEXT_BYTES.to_vec(), vec!["Late(Bytes([]))".to_owned()])
        );
    }
}

#[test]
fn unstarted_request_without_void_is_never_sent() {
    let mut client = Client::<Summed, 260>::new(SUMMED, Config::DEFAULT);
    client.submit(&REQUEST).unwrap();
    client.cancel();
    assert_eq!(transmit(&mut client, usize::MAX), (vec![], vec![]));
    assert!(client.is_idle());
}

#[test]
fn repeat_without_void_ends_before_its_answer() {
    let mut client = Client::<Summed, 260>::new(SUMMED, Config::DEFAULT);
    client.submit(&NEXT).unwrap();
    assert_eq!(transmit(&mut client, usize::MAX).0, NEXT_BYTES);
    let Output::Timeout(Some(due)) = client.poll(Instant::ZERO) else {
        panic!("no timeout")
    };
    assert!(matches!(client.poll(due), Output::Transmit(_)));
    client.transmitted(due, 1).unwrap();
    assert!(client.receive(due, &[0x56, 0, 0]).is_empty());
    assert_eq!(client.poll(due), Output::Transmit(&NEXT_BYTES[1..]));
    client.transmitted(due, 3).unwrap();
    assert_eq!(client.poll(due), Output::Event(Event::Answer(Bytes(&[]))));
    assert!(client.is_idle());
}

#[test]
fn request_whose_value_does_not_fit_is_refused() {
    let mut client = Client::<Summed, 260>::new(SUMMED, Config::DEFAULT);
    let error = client.submit(&Bytes(&[0; 201])).unwrap_err();
    assert_eq!(error.to_string(), "message is 201 bytes, must be 0..=200");
    assert!(client.is_idle());
}

#[test]
fn echo_is_no_answer_though_it_looks_alike() {
    let mut client = Client::<Summed, 260>::new(ONE_WIRE, Config::DEFAULT);
    client.submit(&NEXT).unwrap();
    assert_eq!(transmit(&mut client, usize::MAX).0, NEXT_BYTES);
    assert!(
        client
            .receive(Instant::ZERO, &[NEXT_BYTES, NEXT_BYTES].concat())
            .is_empty()
    );
    assert_eq!(client.poll(Instant::ZERO), Output::Event(Event::Echo));
    assert_eq!(client.frame(), NEXT_BYTES);
    assert_eq!(client.poll(Instant::ZERO), Output::Event(Event::Answer(NEXT)));
}

#[test]
fn answer_counts_without_its_echo() {
    let mut client = Client::<Summed, 260>::new(ONE_WIRE, Config::DEFAULT);
    client.submit(&NEXT).unwrap();
    transmit(&mut client, usize::MAX);
    assert!(client.receive(Instant::ZERO, &[0x55, 0, 0]).is_empty());
    assert_eq!(client.poll(Instant::ZERO), Output::Event(Event::Answer(Bytes(&[]))));
}

/// Accepts one byte at a time, as long as some are free. It has nothing to read.
struct Slow<'a> {
    line: &'a RefCell<Vec<u8>>,
    free: &'a Cell<usize>,
}

impl ErrorType for Slow<'_> {
    type Error = ErrorKind;
}

impl Read for Slow<'_> {
    async fn read(&mut self, _: &mut [u8]) -> Result<usize, ErrorKind> {
        pending().await
    }
}

impl Write for Slow<'_> {
    async fn write(&mut self, bytes: &[u8]) -> Result<usize, ErrorKind> {
        let Some(free) = self.free.get().checked_sub(1) else {
            return pending().await;
        };
        self.free.set(free);
        self.line.borrow_mut().push(bytes[0]);
        Ok(1)
    }

    async fn flush(&mut self) -> Result<(), ErrorKind> {
        Ok(())
    }
}

/// It stands still.
struct Still;

impl Clock for Still {
    fn now(&self) -> Instant {
        Instant::ZERO
    }

    async fn wait_until(&self, instant: Instant) {
        if instant > Instant::ZERO {
            pending().await
        }
    }
}

#[test]
fn dropped_call_without_void_is_written_to_its_end() {
    let (line, free) = (RefCell::new(Vec::new()), Cell::new(3));
    let port = Slow {
        line: &line,
        free: &free,
    };
    let mut driver = Driver::<Summed, _, _, 260>::new(SUMMED, port, Still, Config::DEFAULT);
    let mut start = |request| {
        let call = pin!(driver.call(request, |_| ()));
        assert!(call.poll(&mut Context::from_waker(Waker::noop())).is_pending());
    };
    start(&REQUEST);
    assert_eq!(*line.borrow(), WHOLE[..3]);
    free.set(100);
    start(&NEXT);
    assert_eq!(*line.borrow(), WHOLE, "the next request waits for the late answer");
}
