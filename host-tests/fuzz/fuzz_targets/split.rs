//! Any division of a line into chunks has the same result: chunks, chunks read into the decoder's buffer, single bytes,
//! and pieces of the receive threshold.
#![no_main]

use armwire::correlation::Correlation;
use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Reason};
use armwire::ling::legacy::Detector;
use armwire::raw::Raw;
use armwire_fuzz::line::LineDecoder;
use armwire_fuzz::{Check, Result, Subject, Unstructured, check};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Split>(input));

/// In a cut: the line goes idle after the chunk.
const IDLE: u8 = 0x80;

struct Split;

impl Check for Split {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let expect = P::any_expect(u)?;
        let cuts: &[u8] = u.arbitrary()?;
        let line = u.bytes(u.len())?;
        let mut chunked = LineDecoder::<P, N>::new(expect);
        let mut buffered = LineDecoder::<P, N>::new(expect);
        let mut bytewise = LineDecoder::<P, N>::new(expect);
        let mut needed = LineDecoder::<P, N>::new(expect);
        let (mut whole, mut pieces) = (Detector::new(), Detector::new());
        let hint = whole.push(line);
        let mut rest = line;
        for cut in cuts.iter().copied().chain([u8::MAX]) {
            let len = if cut == u8::MAX {
                rest.len()
            } else {
                usize::from(cut & !IDLE)
            };
            let (chunk, later) = rest.split_at(len.min(rest.len()));
            rest = later;
            chunked.on_bytes(chunk);
            buffered.on_bytes_into_room(chunk, usize::from(cut >> 4));
            chunk.iter().for_each(|byte| bytewise.on_bytes(&[*byte]));
            needed.on_bytes_by_threshold(chunk);
            pieces.push(chunk);
            if cut & IDLE != 0 {
                chunked.idle();
                buffered.idle();
                bytewise.idle();
                needed.idle();
            }
        }
        assert_eq!(chunked.received, buffered.received);
        assert_eq!(chunked.received, bytewise.received);
        assert_eq!(chunked.received, needed.received);
        assert_eq!(pieces.push(rest), hint);
        assert!(hint.is_none_or(|legacy_hint| legacy_hint.to_string().contains("older generation")));
        check_raw::<N>(line);
        Ok(())
    }
}

/// On a raw line every byte is stray, and no request is answered.
fn check_raw<const N: usize>(line: &[u8]) {
    let mut decoder = Decoder::<_, N>::new();
    let (mut rest, mut received) = (line, Vec::<u8>::new());
    loop {
        rest = decoder.push(rest);
        while let Some(item) = decoder.next(&Raw, ()) {
            assert_eq!(item.kind, Kind::Noise(Reason::Stray));
            received.extend(item.bytes);
        }
        assert_eq!(decoder.need(&Raw, ()), 1);
        if rest.is_empty() {
            break;
        }
    }
    assert_eq!(received, line);
    assert_eq!(Raw.terminator(()), None);
    let request = Raw.request(line);
    assert_eq!(request.is_none(), line.is_empty());
    assert!(request.is_none_or(|info| info.response.is_none() && !Raw.is_response_to((), line)));
}
