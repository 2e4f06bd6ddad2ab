//! A device receives the frames of a decoder, as requests, in any chunks, and consumes all of its input. Its answers
//! are the encodings of the protocol.
#![no_main]

use core::fmt::Debug;
use core::ops::Range;

use armwire::decoder::Kind;
use armwire::{Device, DeviceEvent};
use armwire_fuzz::line::{Ear, Out};
use armwire_fuzz::{Arbitrary, Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Hears>(input));

#[derive(Arbitrary)]
enum Step<'a> {
    Request,
    Bytes(&'a [u8]),
    Idle,
    Respond,
}

/// A received item, with its position on the line if it is no frame.
#[derive(Debug, PartialEq)]
enum Received {
    Frame(String),
    Rest(Range<usize>, Kind),
}

struct Hears;

impl Check for Hears {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let protocol = P::any_protocol(u)?;
        let mut device = Device::<P, N>::new(protocol);
        let mut ear = Ear::<P, N>::new(protocol.requests());
        let (mut line, mut received) = (Vec::new(), Vec::new());
        while !u.is_empty() {
            let bytes = match u.arbitrary()? {
                Step::Request if !P::HAS_REQUESTS => continue,
                Step::Request => request_bytes(protocol, &P::any_request(u)?),
                Step::Bytes(bytes) => bytes.to_vec(),
                Step::Idle => {
                    device.idle();
                    on_bytes(&mut device, &mut received);
                    ear.idle();
                    continue;
                }
                Step::Respond => {
                    let any = P::any_response(u)?;
                    let mut out = [0; N];
                    let n = device.respond(&any.response, any.to, &mut out).expect("there is room");
                    assert_eq!(out[..n], response_bytes(protocol, &any));
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
            ear.on_bytes(&bytes);
            line.extend(bytes);
        }
        let found: Vec<_> = ear
            .received
            .iter()
            .filter_map(|out| meaning(protocol, out, &line))
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

fn frame(what: impl Debug, key: impl Debug) -> Received {
    Received::Frame(format!("{what:?} {key:?}"))
}

/// The expected item of a device for an item of a decoder.
fn meaning<P: Subject>(protocol: P, out: &Out, line: &[u8]) -> Option<Received> {
    let bytes = &line[out.range.clone()];
    let key = protocol.request(bytes).map(|info| info.key);
    Some(match out.kind {
        Kind::Frame => match protocol.parse_request(bytes) {
            Ok(request) => frame(request, key),
            Err(error) => frame((bytes, error), key),
        },
        Kind::Noise(_) => Received::Rest(out.range.clone(), out.kind),
        // The error is reported once.
        Kind::Broken(_) => Received::Rest(out.range.start..out.range.start, out.kind),
        Kind::Padding => return None,
    })
}
