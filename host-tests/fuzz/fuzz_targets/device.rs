//! A device hears what a decoder finds, as requests, in any chunks, and takes all of its input; what it says is what the
//! protocol writes.
#![no_main]

use armwire::{Device, Heard, Input, Noise};
use armwire_fuzz::line::{Ear, Out};
use armwire_fuzz::{Arbitrary, Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Hears>(input));

#[derive(Arbitrary)]
enum Step<'a> {
    Request,
    Bytes(&'a [u8]),
    Idle,
    Tick,
    Respond,
}

struct Hears;

impl Check for Hears {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let mut device = Device::<P, N>::new();
        let mut ear = Ear::<P, N>::new(P::REQUESTS);
        let (mut line, mut heard) = (Vec::new(), Vec::new());
        while !u.is_empty() {
            let bytes = match u.arbitrary()? {
                Step::Request if !P::HAS_REQUESTS => continue,
                Step::Request => request_bytes::<P>(&P::any_request(u)?),
                Step::Bytes(bytes) => bytes.to_vec(),
                Step::Idle => {
                    hear(&mut device, Input::Idle, &mut heard);
                    ear.idle();
                    continue;
                }
                Step::Tick => {
                    let before = heard.len();
                    hear(&mut device, Input::Tick, &mut heard);
                    assert_eq!(heard.len(), before, "time means nothing to a device");
                    continue;
                }
                Step::Respond => {
                    let (response, _) = P::any_response(u)?;
                    let mut out = [0; N];
                    let n = device.respond(&response, &mut out).expect("there is room");
                    assert_eq!(out[..n], response_bytes::<P>(&response));
                    continue;
                }
            };
            hear(&mut device, Input::Bytes(&bytes), &mut heard);
            ear.hear(&bytes);
            line.extend(bytes);
        }
        let broken = ear.broken();
        let found: Vec<Heard<P>> = ear.heard.iter().map(|out| meaning(out, &line, broken)).collect();
        assert_eq!(heard, found);
        Ok(())
    }
}

/// Gives an input until nothing comes of it any more.
fn hear<P: Subject, const N: usize>(device: &mut Device<P, N>, mut input: Input<'_>, heard: &mut Vec<Heard<P>>) {
    while let Some(event) = device.handle(&mut input) {
        assert!(!format!("{event:?}").is_empty());
        heard.push(event);
    }
    assert!(!matches!(input, Input::Bytes([_, ..])), "it is not taken");
}

/// What a device must make of what a decoder found.
fn meaning<P: Subject>(out: &Out, line: &[u8], broken: Option<Noise>) -> Heard<P> {
    match out {
        Out::Frame(range) => {
            let frame = P::view(&line[range.clone()]).expect("it was found");
            P::parse_request(frame).map_or_else(Heard::Unknown, Heard::Request)
        }
        Out::Noise(noise) if Some(*noise) == broken => Heard::Broken(*noise),
        Out::Noise(noise) => Heard::Noise(*noise),
    }
}
