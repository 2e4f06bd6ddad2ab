//! Properties of every protocol, instantiated by each of its test files.

use core::ops::Range;

use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Scan};
use armwire::messages::Messages;
use armwire::time::{Duration, Instant};
use armwire::{BufferTooShort, Client, Config, EncodeError, Output, ParseError};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// A protocol under test.
pub(crate) trait Subject: Messages<Expect: 'static, Request<'static>: 'static> + Default + 'static {
    /// The padding byte between frames.
    const PADDING: Option<u8>;

    /// Any request.
    fn any_request() -> BoxedStrategy<Self::Request<'static>>;

    /// The bytes of any response, and its expectation.
    fn any_response() -> BoxedStrategy<(Vec<u8>, Self::Expect)>;

    /// Any expectation of a decoder.
    fn any_expect() -> BoxedStrategy<Self::Expect>;

    /// Any frame with this expectation.
    fn any_frame(expect: Self::Expect) -> BoxedStrategy<Vec<u8>>;

    /// A byte that often looks like part of a frame.
    fn any_noise() -> BoxedStrategy<u8>;
}

/// Fits every frame.
pub(crate) const ROOM: usize = 260;

/// The bytes of a request.
pub(crate) fn request_bytes<M: Messages + Default>(request: &M::Request<'_>) -> Vec<u8> {
    let mut out = [0; ROOM];
    let n = M::default().encode_request(request, &mut out).unwrap();
    out[..n].to_vec()
}

/// The bytes of an unsolicited response.
pub(crate) fn response_bytes<M: Messages + Default>(response: &M::Response<'_>) -> Vec<u8> {
    let mut out = [0; ROOM];
    let n = M::default().encode_response(response, None, &mut out).unwrap();
    out[..n].to_vec()
}

/// An expectation, and alternating noise and frames.
pub(crate) type Line<P> = (<P as Framing>::Expect, Vec<(Vec<u8>, Vec<u8>)>);

/// Any line.
pub(crate) fn line<P: Subject>() -> impl Strategy<Value = Line<P>> {
    P::any_expect().prop_flat_map(|expect| {
        let parts = vec((vec(P::any_noise(), 0..24), P::any_frame(expect)), 1..12);
        (Just(expect), parts)
    })
}

/// Inputs of a client: bytes, time, and an idle line.
pub(crate) fn steps<P: Subject>() -> impl Strategy<Value = Vec<(Vec<u8>, u64, bool)>> {
    vec((vec(P::any_noise(), 0..24), 0..50_000_u64, any::<bool>()), 0..40)
}

/// The positions and kinds of all items of a line that goes idle, except noise.
fn decode<P: Subject>(line: &[u8], expect: P::Expect) -> Vec<(Range<usize>, Kind)> {
    let (mut decoder, mut rest, mut out) = (Decoder::<_, ROOM>::new(), line, Vec::new());
    loop {
        while let Some(item) = decoder.next(&P::default(), expect) {
            let start = item.offset as usize;
            out.push((start..start + item.bytes.len(), item.kind));
        }
        if rest.is_empty() {
            decoder.idle();
            while let Some(item) = decoder.next(&P::default(), expect) {
                let start = item.offset as usize;
                out.push((start..start + item.bytes.len(), item.kind));
            }
            return out;
        }
        rest = decoder.push(rest);
    }
}

/// The text of a message, which is unique.
fn text_of<T: std::fmt::Debug>(parsed: Result<T, ParseError>) -> Result<String, ParseError> {
    parsed.map(|message| format!("{message:?}"))
}

/// A request survives encoding and decoding, and a buffer that is a byte too short is refused.
pub(crate) fn a_request_survives_the_wire<P: Subject>(request: P::Request<'static>) -> TestCaseResult {
    let arm = P::default();
    let bytes = request_bytes::<P>(&request);
    prop_assert_eq!(arm.scan(&bytes, arm.requests()), Scan::Frame(bytes.len()));
    prop_assert!(arm.request(&bytes).is_some());
    match text_of(arm.parse_request(&bytes)) {
        Ok(parsed) => prop_assert_eq!(parsed, format!("{request:?}")),
        Err(error) => panic!("{error}"),
    }
    let mut short = vec![0; bytes.len() - 1];
    let error = arm.encode_request(&request, &mut short).unwrap_err().into();
    let (needed, got) = (bytes.len(), short.len());
    prop_assert_eq!(error, EncodeError::BufferTooShort(BufferTooShort { needed, got }));
    Ok(())
}

/// The bytes of a response survive decoding and encoding, and a buffer that is a byte too short is refused.
pub(crate) fn a_response_survives_the_wire<P: Subject>((bytes, expect): (Vec<u8>, P::Expect)) -> TestCaseResult {
    let arm = P::default();
    prop_assert_eq!(arm.scan_idle(&bytes, expect), Scan::Frame(bytes.len()));
    let response = match arm.parse_response(&bytes, expect) {
        Ok(response) => response,
        Err(error) => panic!("{error}"),
    };
    prop_assert_eq!(&response_bytes::<P>(&response), &bytes);
    let mut short = vec![0; bytes.len() - 1];
    let error = arm.encode_response(&response, None, &mut short).unwrap_err();
    prop_assert_eq!((error.needed, error.got), (bytes.len(), short.len()));
    Ok(())
}

/// A prefix of a frame gets no verdict except the minimum number of missing bytes.
pub(crate) fn a_prefix_of_a_frame_is_given_no_verdict<P: Subject>(frame: &[u8], expect: P::Expect) -> TestCaseResult {
    for n in 1..frame.len() {
        let Scan::Need(more) = P::default().scan(&frame[..n], expect) else {
            panic!("a verdict on {n} of {} bytes", frame.len());
        };
        prop_assert!((1..=frame.len() - n).contains(&more));
    }
    Ok(())
}

/// Every intact frame comes out, and every byte is in a frame, in noise or in padding, in that order.
pub(crate) fn nothing_is_lost_to_noise<P: Subject>((expect, parts): Line<P>) -> TestCaseResult {
    let (mut line, mut intact) = (Vec::new(), Vec::new());
    for (noise, frame) in &parts {
        line.extend(noise);
        intact.push(line.len()..line.len() + frame.len());
        line.extend(frame);
    }
    let out = decode::<P>(&line, expect);
    let mut at = 0;
    for (range, kind) in &out {
        prop_assert_eq!(range.start, at);
        at = range.end;
        let padding = line[range.clone()].iter().all(|byte| Some(*byte) == P::PADDING);
        prop_assert!(*kind != Kind::Padding || padding);
    }
    prop_assert_eq!(at, line.len());
    for frame in intact {
        // Noise that is a valid frame by chance, of this protocol or another, may overlap the frame: it arrived first.
        let overlapped = out
            .iter()
            .any(|(range, kind)| *kind == Kind::Frame && range.start < frame.start && frame.start < range.end);
        prop_assert!(
            out.contains(&(frame.clone(), Kind::Frame)) || overlapped,
            "lost {:?} of {:?}",
            frame,
            out
        );
    }
    Ok(())
}

/// A client accepts any bytes at any time, and ends every request in bounded time.
pub(crate) fn client_accepts_any_bytes<P: Subject>(
    steps: Vec<(Vec<u8>, u64, bool)>,
    request: P::Request<'static>,
) -> TestCaseResult {
    let mut client = Client::<P, ROOM>::new(P::default(), Config::DEFAULT);
    let mut now = Instant::ZERO;
    for (bytes, wait, idle) in steps {
        let _ = client.submit(&request);
        now += Duration::from_micros(wait);
        let mut rest = &bytes[..];
        loop {
            rest = client.receive(now, rest);
            settle(&mut client, now);
            if rest.is_empty() {
                break;
            }
        }
        if idle {
            client.idle();
            settle(&mut client, now);
        }
    }
    // The request in flight ends: without more bytes, each timeout leads to its end or to a repeat.
    for _ in 0..20 {
        match settle(&mut client, now) {
            None => break,
            Some(until) => now = now.max(until),
        }
    }
    prop_assert!(client.is_idle());
    Ok(())
}

/// Takes all events and transmits all bytes. Returns the next timeout.
fn settle<P: Subject>(client: &mut Client<P, ROOM>, now: Instant) -> Option<Instant> {
    loop {
        match client.poll(now) {
            Output::Timeout(until) => return until,
            Output::Event(_) => {}
            Output::Receive => client.received(now, 0).unwrap(),
            Output::Transmit(bytes) => {
                let n = bytes.len();
                client.transmitted(now, n).unwrap();
            }
        }
    }
}
