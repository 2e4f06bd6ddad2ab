//! An intact frame between arbitrary bytes is decoded, unless another frame with a valid checksum began earlier and
//! overlaps it. On a lossless line, frames are decoded as long as there are only frames. A reference decoder, written from
//! the documents alone, finds the same frames.
#![no_main]

use std::ops::Range;

use armwire_fuzz::line::{LineDecoder, Span};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check};
use armwire_host_tests::reference::Piece;
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Resync>(input));

struct Resync;

impl Check for Resync {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let expect = P::any_expect(u)?;
        let protocol = P::any_protocol(u)?;
        let (mut line, mut intact) = (Vec::new(), Vec::new());
        while intact.len() < 20 {
            if !P::LOSSLESS {
                let len = usize::from(u.arbitrary::<u8>()? % 32);
                line.extend(u.bytes(len.min(u.len()))?);
            }
            // The rest may be too short for another frame.
            let Ok(frame) = protocol.any_frame(u, expect) else {
                break;
            };
            intact.push(line.len()..line.len() + frame.len());
            line.extend(frame);
            if u.is_empty() {
                break;
            }
        }
        line.extend(if P::LOSSLESS { &[] } else { u.bytes(u.len())? });
        let mut decoder = LineDecoder::<P, N>::new(expect);
        decoder.on_bytes(&line);
        decoder.idle();
        let received: Vec<_> = decoder.received.iter().filter_map(Span::frame).collect();
        let frames: Vec<_> = P::reference(&line, expect).iter().filter_map(Piece::frame).collect();
        assert_eq!(received, frames, "on {line:02X?}");
        for frame in intact {
            let reaches_into_it = |other: &Range<usize>| other.start < frame.start && frame.start < other.end;
            assert!(
                frames.contains(&frame) || frames.iter().any(reaches_into_it),
                "lost {frame:?} of {frames:?} on {line:02X?}"
            );
        }
        Ok(())
    }
}
