//! Every byte of any line comes out once and in order: in a frame, which written anew is the same bytes, in noise, or as
//! what fills the room between frames.
#![no_main]

use armwire::Scan;
use armwire_fuzz::line::{Ear, Out};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Decode>(input));

/// Ling's self-check has a byte of data and says that it has none. One that says so is read too, and means the same.
const SELF_CHECK: [u8; 7] = [0xAA, 0xFE, 0x00, 0x00, 0xFE, 0x93, 0xFF];
const SELF_CHECK_WITH_LENGTH: [u8; 7] = [0xAA, 0xFE, 0x00, 0x01, 0xFE, 0xD2, 0xFF];

struct Decode;

impl Check for Decode {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let expect = P::any_expect(u)?;
        let line = u.bytes(u.len())?;
        let mut ear = Ear::<P, N>::new(expect);
        ear.hear(line);
        ear.idle();

        let mut at = 0;
        for out in &ear.heard {
            let range = out.range();
            assert!(at <= range.start && range.start < range.end, "twice in {:?}", ear.heard);
            check_filling::<P>(&line[at..range.start]);
            at = range.end;
            match out {
                Out::Frame(range) => check_frame::<P, N>(&line[range.clone()], expect),
                Out::Noise(noise) => assert!(!noise.to_string().is_empty()),
            }
        }
        match ear.broken() {
            // What follows is not read.
            Some(noise) => assert_eq!(ear.heard.last(), Some(&Out::Noise(noise))),
            None => {
                let rest = &line[at..];
                match P::scan(rest, expect) {
                    // Of a frame that is skipped nothing is held. It comes out when its end is there.
                    Scan::Skip(len, _) if P::RELIABLE && len > rest.len() => {}
                    _ => check_filling::<P>(&rest[..rest.len() - ear.pending()]),
                }
            }
        }
        Ok(())
    }
}

/// Bytes that did not come out are such as fill the room between frames.
fn check_filling<P: Subject>(bytes: &[u8]) {
    assert!(bytes.iter().all(|byte| Some(*byte) == P::FILL), "lost {bytes:02X?}");
}

/// Written anew it is the same bytes, and so is what it means, but for what the protocol leaves open.
fn check_frame<P: Subject, const N: usize>(bytes: &[u8], expect: P::Expect) {
    let frame = P::view(bytes).expect("it was viewed before");
    let mut out = [0; N];
    let n = P::encode_frame(frame, expect, &mut out).expect("it was read");
    assert_eq!(
        &out[..n],
        if bytes == SELF_CHECK_WITH_LENGTH {
            &SELF_CHECK
        } else {
            bytes
        }
    );
    match P::parse_request(frame) {
        Ok(request) => {
            let bytes = request_bytes::<P>(&request);
            assert_eq!(P::scan(&bytes, P::REQUESTS), Scan::Frame(bytes.len()));
            assert_eq!(P::view(&bytes).map(P::parse_request), Some(Ok(request)));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    match P::parse_response(frame, expect) {
        Ok(response) => {
            let bytes = response_bytes::<P>(&response);
            let again = P::view(&bytes).map(|frame| P::parse_response(frame, expect));
            assert_eq!(again, Some(Ok(response)));
            assert_eq!(P::to_response(&P::response_ref(&response)), response);
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
}
