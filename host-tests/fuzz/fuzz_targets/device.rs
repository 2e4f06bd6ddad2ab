//! A device receives the frames of a decoder, as requests, in any chunks, and consumes all of its input. Its answers
//! are the encodings of the protocol.
#![no_main]

use core::fmt::Debug;
use core::ops::Range;

use armwire::decoder::Kind;
use armwire::{Device, DeviceEvent};
use armwire_fuzz::line::{LineDecoder, Span};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Requests>(input));

/// A received item, with its position on the line if it is no frame.
#[derive(Debug, PartialEq)]
enum Received {
    Frame(String),
    Rest(Range<usize>, Kind),
}

struct Requests;

impl Check for Requests {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let protocol = P::any_protocol(u)?;
        let mut device = Device::<P, N>::new(protocol);
        let mut decoder = LineDecoder::<P, N>::new(protocol.requests());
        let (mut line, mut received) = (Vec::new(), Vec::new());
        while !u.is_empty() {
            let bytes = match u.int_in_range(0..=3)? {
                0 if !P::HAS_REQUESTS => continue,
                0 => request_bytes(protocol, &P::any_request(u)?),
                1 => u.arbitrary::<&[u8]>()?.to_vec(),
                2 => {
                    device.idle();
                    on_bytes(&mut device, &mut received);
                    decoder.idle();
                    continue;
                }
                _ => {
                    let any = P::any_response(u)?;
                    let mut out = [0; N];
                    let n = device.respond(&any.response, any.to, &mut out).expect("there is room");
                    assert_eq!(out[..n], response_bytes(protocol, &any.response, any.to));
                    continue;
                }
            };
            let mut rest = &*bytes;
            while !rest.is_empty() {
                let later = device.receive(rest);
                assert!(later.len() < rest.len(), "it is not taken");
                rest = later;
                on_bytes(&mut device, &mut received);
            }
            decoder.on_bytes(&bytes);
            line.extend(bytes);
        }
        let found: Vec<_> = decoder
            .received
            .iter()
            .filter_map(|span| expected(protocol, span, &line))
            .collect();
        assert_eq!(received, found);
        Ok(())
    }
}

/// Takes all events.
fn on_bytes<P: Subject, const N: usize>(device: &mut Device<P, N>, received: &mut Vec<Received>) {
    assert!(!format!("{device:?}").is_empty());
    while let Some(event) = device.poll() {
        match event {
            DeviceEvent::Request { request, key } => received.push(frame(request, key)),
            DeviceEvent::Unknown {
                frame: bytes,
                error,
                key,
            } => received.push(frame((bytes, error), key)),
            DeviceEvent::Noise { offset, bytes, reason } => {
                let start = usize::try_from(offset).expect("lines are short");
                let (end, kind) = (start + bytes.len(), Kind::Noise(reason));
                match received.last_mut() {
                    Some(Received::Rest(last, before)) if last.end == start && *before == kind => last.end = end,
                    _ => received.push(Received::Rest(start..end, kind)),
                }
            }
            DeviceEvent::Broken { offset, reason } => {
                let start = usize::try_from(offset).expect("lines are short");
                received.push(Received::Rest(start..start, Kind::Broken(reason)));
            }
        }
    }
}

fn frame(content: impl Debug, key: impl Debug) -> Received {
    Received::Frame(format!("{content:?} {key:?}"))
}

/// The expected item of a device for an item of a decoder.
fn expected<P: Subject>(protocol: P, span: &Span, line: &[u8]) -> Option<Received> {
    let bytes = &line[span.range.clone()];
    let key = protocol.request(bytes).map(|info| info.key);
    Some(match span.kind {
        Kind::Frame => match protocol.parse_request(bytes) {
            Ok(request) => frame(request, key),
            Err(error) => frame((bytes, error), key),
        },
        Kind::Noise(_) => Received::Rest(span.range.clone(), span.kind),
        // The error is reported once.
        Kind::Broken(_) => Received::Rest(span.range.start..span.range.start, span.kind),
        Kind::Padding => return None,
    })
}
