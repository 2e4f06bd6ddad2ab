//! An intact frame comes out whatever is around it, unless another frame, good by its own checksum, began before it and
//! reaches into it. On a line that loses nothing, frames come out as long as there are only frames.
#![no_main]

use armwire::Scan;
use armwire_fuzz::line::{Ear, Out};
use armwire_fuzz::{Check, Result, Subject, Unstructured, check};
use libfuzzer_sys::fuzz_target;

fuzz_target!(|input: &[u8]| check::<Resync>(input));

struct Resync;

impl Check for Resync {
    fn check<P: Subject, const N: usize>(u: &mut Unstructured<'_>) -> Result<()> {
        let expect = P::any_expect(u)?;
        let (mut line, mut intact) = (Vec::new(), Vec::new());
        while intact.len() < 20 {
            if !P::RELIABLE {
                let len = usize::from(u.arbitrary::<u8>()? % 32);
                line.extend(u.bytes(len.min(u.len()))?);
            }
            // What is left may be too short for one more.
            let Ok(frame) = P::any_frame(u, expect) else { break };
            intact.push(line.len()..line.len() + frame.len());
            line.extend(frame);
            if u.is_empty() {
                break;
            }
        }
        line.extend(if P::RELIABLE { &[] } else { u.bytes(u.len())? });
        let mut ear = Ear::<P, N>::new(expect);
        ear.hear(&line);
        ear.idle();
        for frame in intact {
            let reaches_into_it = |out: &Out| {
                let range = out.range();
                matches!(out, Out::Frame(_))
                    && range.start < frame.start
                    && frame.start < range.end
                    && P::scan(&line[range.clone()], expect) == Scan::Frame(range.len())
            };
            assert!(
                ear.heard.contains(&Out::Frame(frame.clone())) || ear.heard.iter().any(reaches_into_it),
                "lost {frame:?} of {:?} on {line:02X?}",
                ear.heard
            );
        }
        Ok(())
    }
}
