//! Every byte of any line comes out once and in order: in a frame that encodes to the same bytes, in noise, or as padding
//! between frames.
#![no_main]

use armwire::decoder::Kind;
use armwire::framing::Scan;
use armwire_fuzz::line::LineDecoder;
use armwire_fuzz::{Check, Result, Subject, Unstructured, check, request_bytes, response_bytes};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Decode>(input));

/// Ling's self-check has a data byte, and length 0. A frame with length 1 is read too, with the same meaning.
const SELF_CHECK: [u8; 7] = [0xAA, 0xFE, 0x00, 0x00, 0xFE, 0x93, 0xFF];
const SELF_CHECK_WITH_LENGTH: [u8; 7] = [0xAA, 0xFE, 0x00, 0x01, 0xFE, 0xD2, 0xFF];

struct Decode;

impl Check for Decode {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let expect = P::any_expect(u)?;
        let line = u.bytes(u.len())?;
        let mut decoder = LineDecoder::<P, N>::new(expect);
        decoder.on_bytes(line);
        decoder.idle();

        let mut at = 0;
        for span in &decoder.received {
            assert_eq!(span.range.start, at, "a gap in {:?}", decoder.received);
            assert!(!span.range.is_empty());
            at = span.range.end;
            let bytes = &line[span.range.clone()];
            match span.kind {
                Kind::Frame => check_frame::<P>(bytes, expect),
                Kind::Padding => assert!(bytes.iter().all(|byte| Some(*byte) == P::PADDING), "lost {bytes:02X?}"),
                Kind::Noise(reason) => assert!(!reason.to_string().is_empty()),
                // Later bytes are not read.
                Kind::Broken(reason) => assert_eq!((decoder.broken(), at), (Some(reason), line.len())),
            }
        }
        // On a line that loses nothing a frame may still be waited for.
        assert_eq!(line.len() - at, decoder.pending());
        Ok(())
    }
}

/// Checks that the frame encodes to the same bytes, and its message to a frame with the same meaning.
fn check_frame<P: Subject>(bytes: &[u8], expect: P::Expect) {
    assert_eq!(
        P::rewrite(bytes),
        if bytes == SELF_CHECK_WITH_LENGTH {
            &SELF_CHECK
        } else {
            bytes
        }
    );
    let protocol = P::default();
    let request_info = protocol.request(bytes);
    let from_host = protocol.scan(bytes, protocol.requests()) == Scan::Frame(bytes.len());
    match protocol.parse_request(bytes) {
        // A response may be longer than any request.
        Ok(_) if !from_host => {}
        Ok(request) => {
            let again = request_bytes(protocol, &request);
            assert_eq!(protocol.scan(&again, protocol.requests()), Scan::Frame(again.len()));
            let read = protocol.parse_request(&again).expect("it was written");
            assert_eq!(format!("{read:?}"), format!("{request:?}"));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    match protocol.parse_response(bytes, expect) {
        Ok(response) => {
            let to = request_info.map(|info| info.key);
            let again = response_bytes(protocol, &response, to);
            let read = protocol.parse_response(&again, expect).expect("it was written");
            assert_eq!(format!("{read:?}"), format!("{response:?}"));
        }
        Err(error) => assert!(!error.to_string().is_empty()),
    }
    // A line may return an echo.
    let may_come_back = !P::LOSSLESS && expect == protocol.requests() && protocol.parse_request(bytes).is_ok();
    if let Some(info) = request_info.filter(|_| may_come_back) {
        assert!(!protocol.is_response_to(info.key, bytes), "it answers itself");
    }
}
