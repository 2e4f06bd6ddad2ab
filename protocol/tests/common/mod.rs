//! What holds of every protocol: each of its test files says it of its own messages.

use core::fmt::Debug;
use core::ops::Range;

use armwire::{Client, Config, Decoder, Event, Framing, Input, Micros, Noise, Protocol, Scan};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// A protocol under test.
pub(crate) trait Subject:
    Protocol<Expect: Debug + 'static, Request: 'static, Response: 'static> + 'static
{
    /// The shortest frame, in bytes.
    const MIN_FRAME: usize;

    /// The byte that fills the room between frames.
    const FILL: Option<u8>;

    /// Any request.
    fn any_request() -> BoxedStrategy<Self::Request>;

    /// Any response, and what it must be expected as.
    fn any_response() -> BoxedStrategy<(Self::Response, Self::Expect)>;

    /// Anything that a reader may know about a line.
    fn any_expect() -> BoxedStrategy<Self::Expect>;

    /// Any frame on a line of which this is known.
    fn any_frame(expect: Self::Expect) -> BoxedStrategy<Vec<u8>>;

    /// A byte that looks like part of a frame more often than chance would have it.
    fn any_noise() -> BoxedStrategy<u8>;

    /// How many bytes a frame is on the wire.
    fn wire_len(frame: Self::Frame<'_>) -> usize;
}

/// The bytes of a request.
pub(crate) fn request_bytes<P: Protocol, const N: usize>(request: &P::Request) -> Vec<u8> {
    let mut out = [0; N];
    let n = P::encode_request(request, &mut out).unwrap();
    out[..n].to_vec()
}

/// The bytes of a response.
pub(crate) fn response_bytes<P: Protocol, const N: usize>(response: &P::Response) -> Vec<u8> {
    let mut out = [0; N];
    let n = P::encode_response(response, &mut out).unwrap();
    out[..n].to_vec()
}

/// What is known of a line, and what comes on it: noise and a frame in turn.
pub(crate) type Line<P> = (<P as Framing>::Expect, Vec<(Vec<u8>, Vec<u8>)>);

/// Any line.
pub(crate) fn line<P: Subject>() -> impl Strategy<Value = Line<P>> {
    P::any_expect().prop_flat_map(|expect| {
        let parts = vec((vec(P::any_noise(), 0..24), P::any_frame(expect)), 1..12);
        (Just(expect), parts)
    })
}

/// Where to cut a line into chunks.
pub(crate) fn cuts() -> impl Strategy<Value = Vec<usize>> {
    vec(1..40_usize, 1..60)
}

/// A line in chunks of these lengths, and the rest of it.
pub(crate) fn cut<'l>(line: &'l [u8], cuts: &[usize]) -> Vec<&'l [u8]> {
    let (mut chunks, mut rest) = (Vec::new(), line);
    for cut in cuts {
        let (chunk, later) = rest.split_at(rest.len().min(*cut));
        chunks.push(chunk);
        rest = later;
    }
    chunks.push(rest);
    chunks
}

/// What happens to a client: bytes, time, and whether the line goes idle.
pub(crate) fn steps<P: Subject>() -> impl Strategy<Value = Vec<(Vec<u8>, u64, bool)>> {
    vec((vec(P::any_noise(), 0..24), 0..50_000_u64, any::<bool>()), 0..40)
}

/// A frame that came out of a decoder (its place on the line), or noise.
#[derive(Clone, Debug, PartialEq)]
pub(crate) enum Out {
    Frame(Range<usize>),
    Noise(Noise),
}

impl Out {
    fn range(&self) -> Range<usize> {
        match self {
            Self::Frame(range) => range.clone(),
            Self::Noise(noise) => noise.offset as usize..noise.offset as usize + noise.len,
        }
    }
}

/// All that comes out of a line that arrives in chunks and then goes idle.
pub(crate) fn decode<P: Subject, const N: usize>(chunks: &[&[u8]], expect: P::Expect) -> Vec<Out> {
    let (mut decoder, mut pushed, mut out) = (Decoder::<P, N>::new(), 0, Vec::new());
    for chunk in chunks {
        let mut rest = *chunk;
        while !rest.is_empty() {
            let later = decoder.push(rest);
            pushed += rest.len() - later.len();
            rest = later;
            drain(&mut decoder, expect, pushed, &mut out);
        }
    }
    loop {
        let before = out.len();
        out.extend(decoder.idle(expect).map(Out::Noise));
        drain(&mut decoder, expect, pushed, &mut out);
        if out.len() == before {
            break;
        }
    }
    assert!(P::RELIABLE || decoder.pending() == 0, "undecided on an idle line");
    out
}

fn drain<P: Subject, const N: usize>(
    decoder: &mut Decoder<P, N>,
    expect: P::Expect,
    pushed: usize,
    out: &mut Vec<Out>,
) {
    while let Some(next) = decoder.next(expect) {
        match next.map(P::wire_len) {
            Ok(len) => {
                let end = pushed - decoder.pending();
                out.push(Out::Frame(end - len..end));
            }
            Err(noise) => out.push(Out::Noise(noise)),
        }
    }
}

/// A request is the same after the way through bytes, and a buffer a byte too short for it is refused.
pub(crate) fn a_request_survives_the_wire<P: Subject, const N: usize>(request: P::Request) -> TestCaseResult {
    let bytes = request_bytes::<P, N>(&request);
    prop_assert_eq!(P::scan(&bytes, P::REQUESTS), Scan::Frame(bytes.len()));
    let frame = P::view(&bytes).unwrap();
    prop_assert_eq!(P::wire_len(frame), bytes.len());
    prop_assert_eq!(P::parse_request(frame), Ok(request));
    let mut short = vec![0; bytes.len() - 1];
    let error = P::encode_request(&request, &mut short).unwrap_err();
    prop_assert_eq!((error.needed, error.got), (bytes.len(), short.len()));
    Ok(())
}

/// The same of a response.
pub(crate) fn a_response_survives_the_wire<P: Subject, const N: usize>(
    (response, expect): (P::Response, P::Expect),
) -> TestCaseResult {
    let bytes = response_bytes::<P, N>(&response);
    let verdict = match P::scan(&bytes, expect) {
        Scan::Need(missing) => P::scan_idle(&bytes, expect, missing),
        verdict => verdict,
    };
    prop_assert_eq!(verdict, Scan::Frame(bytes.len()));
    let frame = P::view(&bytes).unwrap();
    prop_assert_eq!(P::wire_len(frame), bytes.len());
    prop_assert_eq!(P::parse_response(frame, expect), Ok(response));
    let borrowed = P::response_ref(&response);
    prop_assert_eq!(P::parse_response_ref(frame, expect), Ok(borrowed));
    prop_assert_eq!(P::to_response(&borrowed), response);
    let mut short = vec![0; bytes.len() - 1];
    let error = P::encode_response(&response, &mut short).unwrap_err();
    prop_assert_eq!((error.needed, error.got), (bytes.len(), short.len()));
    Ok(())
}

/// Until the last byte of a frame is there, nothing is said of it but how many are missing at least.
pub(crate) fn a_prefix_of_a_frame_is_given_no_verdict<P: Subject>(frame: &[u8], expect: P::Expect) -> TestCaseResult {
    for n in 1..frame.len() {
        let Scan::Need(more) = P::scan(&frame[..n], expect) else {
            panic!("a verdict on {n} of {} bytes", frame.len());
        };
        prop_assert!((1..=frame.len() - n).contains(&more));
    }
    Ok(())
}

/// However a line is cut, the same comes out.
pub(crate) fn chunks_do_not_matter<P: Subject, const N: usize>(
    (expect, parts): Line<P>,
    cuts: &[usize],
) -> TestCaseResult {
    let line: Vec<u8> = parts
        .iter()
        .flat_map(|(noise, frame)| [&noise[..], frame].concat())
        .collect();
    let whole = decode::<P, N>(&[&line], expect);
    prop_assert_eq!(&decode::<P, N>(&cut(&line, cuts), expect), &whole);
    let bytes: Vec<_> = line.chunks(1).collect();
    prop_assert_eq!(&decode::<P, N>(&bytes, expect), &whole);
    Ok(())
}

/// Every intact frame comes out, and every byte is in a frame, in noise or in filling, in that order.
pub(crate) fn nothing_is_lost_to_noise<P: Subject, const N: usize>((expect, parts): Line<P>) -> TestCaseResult {
    let (mut line, mut intact) = (Vec::new(), Vec::new());
    for (noise, frame) in &parts {
        line.extend(noise);
        intact.push(line.len()..line.len() + frame.len());
        line.extend(frame);
    }
    let out = decode::<P, N>(&[&line], expect);

    let mut at = 0;
    for Range { start, end } in out.iter().map(Out::range) {
        prop_assert!(at <= start, "twice in {:?}", out);
        for byte in &line[at..start] {
            prop_assert_eq!(Some(*byte), P::FILL, "lost before byte {} of {:?}", start, out);
        }
        at = end;
    }
    for byte in &line[at..] {
        prop_assert_eq!(Some(*byte), P::FILL, "lost at the end of {:?}", out);
    }

    for frame in intact {
        // Noise that is a good frame by chance, of this protocol or another, may reach into it: that came first.
        let overlapped = out.iter().any(|out| {
            let range = out.range();
            matches!(out, Out::Frame(_)) && range.start < frame.start && frame.start < range.end
        });
        prop_assert!(
            out.contains(&Out::Frame(frame.clone())) || overlapped,
            "lost {:?} of {:?}",
            frame,
            out
        );
    }
    Ok(())
}

/// A client takes any bytes at any time, and accounts for all of them.
pub(crate) fn a_client_takes_anything<P: Subject, const N: usize>(
    steps: Vec<(Vec<u8>, u64, bool)>,
    request: P::Request,
) -> TestCaseResult {
    let mut client = Client::<P, N>::new(Config::DEFAULT);
    let mut now = Micros(0);
    let (mut given, mut filling, mut noise, mut frames) = (0, 0, 0, 0);
    let mut count = |event: Event<P>| match event {
        Event::Noise(dropped) => noise += dropped.len,
        Event::Sent | Event::TimedOut { .. } => {}
        _ => frames += 1,
    };
    for (bytes, wait, idle) in steps {
        let _ = client.submit(request);
        if let Some(n) = client.poll_transmit(now).map(<[u8]>::len) {
            client.transmitted(now, n).unwrap();
        }
        now = now + Micros(wait);
        given += bytes.len();
        filling += bytes.iter().filter(|byte| Some(**byte) == P::FILL).count();
        for mut input in [Input::Bytes(&bytes), if idle { Input::Idle } else { Input::Tick }] {
            while let Some(event) = client.handle(now, &mut input) {
                count(event);
            }
        }
    }
    // What is left is in the decoder: less than a frame, and a run of stray bytes not yet ended.
    let mut input = Input::Idle;
    while let Some(event) = client.handle(now, &mut input) {
        count(event);
    }
    prop_assert!(noise + frames * P::MIN_FRAME <= given);
    let most = noise + frames * P::MAX_FRAME + filling;
    prop_assert!(
        given <= most,
        "{} bytes of noise, {} frames, {} given",
        noise,
        frames,
        given
    );
    Ok(())
}
