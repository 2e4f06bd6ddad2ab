//! The decoder on every kind of line: no missing byte, no effect of chunks, every frame of the documents.

#[allow(dead_code, unreachable_pub, reason = "it is shared with other tests")]
mod vectors;

use std::cell::Cell;
use std::fmt::Debug;

use armwire::alpha1::{Alpha1, Expect, ServoAnswer, ServoId};
use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Reason, Scan};
use armwire::ling::{self, Ling, legacy::Legacy};
use armwire::raw::Raw;
use armwire::xarm::{Direction, XArm};
use proptest::collection::vec;
use proptest::prelude::*;
use proptest::test_runner::TestCaseResult;

/// Fits every frame.
const ROOMY: usize = 260;

/// Fits every frame on the lines of the adapter, except for long names.
const TIGHT: usize = 70;

/// An item, with its bytes.
type Owned = (u64, Kind, Vec<u8>);

/// All items of a line that arrives in chunks and then goes idle.
fn decode<F: Framing, const N: usize>(framing: &F, expect: F::Expect, chunks: &[&[u8]]) -> Vec<Owned> {
    let (mut decoder, mut items) = (Decoder::<_, N>::new(), Vec::new());
    for chunk in chunks {
        let mut rest = *chunk;
        while !rest.is_empty() {
            rest = decoder.push(rest);
            drain(&mut decoder, framing, expect, &mut items);
            assert!(!decoder.space().is_empty(), "no space and no item");
        }
    }
    decoder.idle();
    drain(&mut decoder, framing, expect, &mut items);
    items
}

fn drain<F: Framing, const N: usize>(
    decoder: &mut Decoder<F, N>,
    framing: &F,
    expect: F::Expect,
    items: &mut Vec<Owned>,
) {
    while let Some(item) = decoder.next(framing, expect) {
        assert!(!item.bytes.is_empty());
        items.push((item.offset, item.kind, item.bytes.to_vec()));
    }
}

/// The items, with adjacent ones of the same kind joined. Frames are not joined.
fn joined(items: Vec<Owned>) -> Vec<Owned> {
    let mut joined: Vec<Owned> = Vec::new();
    for (offset, kind, bytes) in items {
        match joined.last_mut() {
            Some(last) if last.1 == kind && kind != Kind::Frame => last.2.extend(bytes),
            _ => joined.push((offset, kind, bytes)),
        }
    }
    joined
}

fn frames(items: &[Owned]) -> Vec<Vec<u8>> {
    let frames = items.iter().filter(|item| item.1 == Kind::Frame);
    frames.map(|(_, _, bytes)| bytes.clone()).collect()
}

/// All bytes come out once, in order; only the end of a lossless line may stay undecided.
fn no_byte_is_missing<F: Framing, const N: usize>(framing: &F, expect: F::Expect, line: &[u8]) -> TestCaseResult {
    let items = decode::<F, N>(framing, expect, &[line]);
    let mut at = 0;
    for (offset, _, bytes) in &items {
        prop_assert_eq!(*offset, at as u64);
        prop_assert_eq!(&line[at..at + bytes.len()], &bytes[..]);
        at += bytes.len();
    }
    prop_assert!(F::LOSSLESS || at == line.len(), "{} of {} bytes", at, line.len());
    Ok(())
}

/// The items of a line do not depend on its chunks, once joined.
fn chunks_have_no_effect<F: Framing, const N: usize>(
    framing: &F,
    expect: F::Expect,
    line: &[u8],
    cuts: &[usize],
) -> TestCaseResult {
    let whole = joined(decode::<F, N>(framing, expect, &[line]));
    let bytes: Vec<_> = line.chunks(1).collect();
    prop_assert_eq!(&joined(decode::<F, N>(framing, expect, &bytes)), &whole);
    let (mut chunks, mut rest) = (Vec::new(), line);
    for cut in cuts {
        let (chunk, later) = rest.split_at(rest.len().min(*cut));
        chunks.push(chunk);
        rest = later;
    }
    chunks.push(rest);
    prop_assert_eq!(&joined(decode::<F, N>(framing, expect, &chunks)), &whole);
    Ok(())
}

/// The threshold never exceeds the number of missing bytes of the next frame, and is never zero while no item is ready.
fn threshold_never_exceeds_the_missing_bytes<F: Framing, const N: usize>(
    framing: &F,
    expect: F::Expect,
    line: &[u8],
) -> TestCaseResult {
    let mut decoder = Decoder::<_, N>::new();
    let mut earliest = decoder.need(framing, expect);
    for (n, byte) in line.iter().enumerate() {
        prop_assert!(decoder.push(&[*byte]).is_empty());
        while let Some(item) = decoder.next(framing, expect) {
            if item.kind == Kind::Frame {
                prop_assert!(
                    n + 1 >= earliest,
                    "a frame after {} bytes, threshold {}",
                    n + 1,
                    earliest
                );
            }
        }
        let need = decoder.need(framing, expect);
        prop_assert!(need > 0);
        earliest = n + 1 + need;
    }
    Ok(())
}

fn every_property<F: Framing + Debug>(framing: &F, expect: F::Expect, line: &[u8], cuts: &[usize]) -> TestCaseResult {
    no_byte_is_missing::<F, ROOMY>(framing, expect, line)?;
    no_byte_is_missing::<F, TIGHT>(framing, expect, line)?;
    chunks_have_no_effect::<F, ROOMY>(framing, expect, line, cuts)?;
    chunks_have_no_effect::<F, TIGHT>(framing, expect, line, cuts)?;
    threshold_never_exceeds_the_missing_bytes::<F, ROOMY>(framing, expect, line)
}

/// Frames of these vectors, whole or damaged, and bytes that look like parts of frames.
fn line(vectors: Vec<vectors::Vector>) -> impl Strategy<Value = Vec<u8>> {
    let frames: Vec<_> = vectors.into_iter().map(|vector| vector.bytes).collect();
    let likely = prop_oneof![
        4 => any::<u8>(),
        2 => prop::sample::select(&[0xAA, 0xFF, 0xED, 0xFA, 0xAF, 0xF3, 0x3F, 0xF1, 0x1F, 0xFB, 0xBF][..]),
        1 => 0..4_u8,
    ];
    let damaged = (
        prop::sample::select(frames.clone()),
        any::<prop::sample::Index>(),
        any::<u8>(),
    );
    let part = prop_oneof![
        3 => prop::sample::select(frames),
        1 => damaged.prop_map(|(mut frame, at, byte)| {
            let at = at.index(frame.len());
            frame[at] = byte;
            frame
        }),
        2 => vec(likely, 0..30),
        1 => (0..80_usize).prop_map(|zeros| vec![0; zeros]),
    ];
    vec(part, 0..10).prop_map(|parts| parts.concat())
}

fn ling_vectors() -> Vec<vectors::Vector> {
    [vectors::ling_requests(), vectors::ling_answers()].concat()
}

fn alpha1_vectors() -> Vec<vectors::Vector> {
    [
        vectors::alpha1_requests(),
        vectors::alpha1_answers(),
        vectors::alpha1_servo_answers(),
    ]
    .concat()
}

fn any_alpha1_expect() -> impl Strategy<Value = Expect> {
    prop_oneof![
        Just(Expect::Requests),
        Just(Expect::Responses(None)),
        Just(Expect::Responses(Some(ServoAnswer::Angles))),
        (1..=240_u8)
            .prop_map(|id| { Expect::Responses(Some(ServoAnswer::Acknowledgement(ServoId::new(id).unwrap()))) }),
    ]
}

/// Ling's frames, with the number of scans.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Counted<'a>(&'a Cell<u32>);

impl Framing for Counted<'_> {
    type Expect = ();

    fn scan(&self, window: &[u8], (): ()) -> Scan {
        self.0.set(self.0.get() + 1);
        Ling.scan(window, ())
    }

    fn terminator(&self, (): ()) -> Option<u8> {
        Ling.terminator(())
    }

    fn shortest(&self, (): ()) -> usize {
        Ling.shortest(())
    }

    fn requests(&self) {}

    fn unsolicited(&self) {}
}

#[test]
fn bytes_inside_a_frame_cost_no_scan() {
    let data = [1; 15];
    let mut frame = [0; 21];
    let answer = ling::Frame {
        command: 0x06,
        function: 0x00,
        data: &data,
    };
    assert_eq!(answer.encode(&mut frame), Ok(21));
    let scans = Cell::new(0);
    let framing = Counted(&scans);
    let mut decoder = Decoder::<_, TIGHT>::new();
    for byte in &frame[..20] {
        assert!(decoder.push(&[*byte]).is_empty());
        assert_eq!(decoder.next(&framing, ()), None);
        assert!(decoder.need(&framing, ()) > 0);
    }
    // After the first byte three more are needed. The fourth is the length.
    assert_eq!(scans.get(), 2);
    assert!(decoder.push(&frame[20..]).is_empty());
    assert!(decoder.next(&framing, ()).is_some_and(|item| item.kind == Kind::Frame));
    assert_eq!(scans.get(), 3);
}

proptest! {
    #[test]
    fn changed_expectation_applies_to_undecided_bytes(
        line in line(alpha1_vectors()),
        expects in vec(any_alpha1_expect(), 1..8),
        calls_of_need in any::<bool>(),
    ) {
        let mut decoder = Decoder::<_, ROOMY>::new();
        let mut window = Vec::new();
        for (byte, expect) in line.iter().zip(expects.into_iter().cycle()) {
            prop_assert!(decoder.push(&[*byte]).is_empty());
            window.push(*byte);
            loop {
                // A decoder without a memory.
                let mut fresh = Decoder::<_, ROOMY>::new();
                prop_assert!(fresh.push(&window).is_empty());
                if calls_of_need {
                    prop_assert_eq!(decoder.need(&Alpha1, expect), fresh.need(&Alpha1, expect));
                }
                let item = fresh.next(&Alpha1, expect).map(|item| (item.kind, item.bytes.to_vec()));
                let got = decoder.next(&Alpha1, expect).map(|item| (item.kind, item.bytes.to_vec()));
                prop_assert_eq!(&got, &item);
                match item {
                    Some((_, bytes)) => drop(window.drain(..bytes.len())),
                    None => break,
                }
            }
        }
    }

    #[test]
    fn every_ling_byte_comes_out_once(line in line(ling_vectors()), cuts in vec(1..40_usize, 0..30)) {
        every_property(&Ling, (), &line, &cuts)?;
    }

    #[test]
    fn every_legacy_ling_byte_comes_out_once(
        line in line(vectors::legacy()),
        cuts in vec(1..40_usize, 0..30),
    ) {
        every_property(&Legacy, (), &line, &cuts)?;
    }

    #[test]
    fn every_alpha1_byte_comes_out_once(
        line in line(alpha1_vectors()),
        expect in any_alpha1_expect(),
        cuts in vec(1..40_usize, 0..30),
    ) {
        every_property(&Alpha1, expect, &line, &cuts)?;
    }

    #[test]
    fn every_xarm_byte_comes_out_once(
        line in line([vectors::xarm_requests(), vectors::xarm_answers()].concat()),
        requests in any::<bool>(),
        cuts in vec(1..40_usize, 0..30),
    ) {
        let direction = if requests { Direction::Requests } else { Direction::Responses };
        every_property(&XArm::PRIVATE, direction, &line, &cuts)?;
    }

    #[test]
    fn every_raw_byte_comes_out_once(line in vec(any::<u8>(), 0..300), cuts in vec(1..40_usize, 0..30)) {
        every_property(&Raw, (), &line, &cuts)?;
    }

    #[test]
    fn place_of_the_length_agrees_with_the_scan(start in vec(any::<u8>(), 4)) {
        let length = Ling.length(()).unwrap();
        let start = [&[length.header], &start[1..]].concat();
        prop_assert_eq!(length.at + 1, start.len());
        let got = start[length.at];
        match Ling.scan(&start, ()) {
            Scan::Need(missing) => prop_assert_eq!(start.len() + missing, usize::from(got) + length.overhead),
            _ => prop_assert!(got > length.max),
        }
    }

    #[test]
    fn ling_frame_survives_noise_before_it(
        noise in vec(prop_oneof![3 => any::<u8>(), 1 => Just(0xAA)], 0..200),
        frame in prop::sample::select(ling_vectors()),
    ) {
        let line = [&noise[..], &frame.bytes].concat();
        let items = decode::<_, TIGHT>(&Ling, (), &[&line]);
        let start = noise.len() as u64;
        // Noise that is a valid frame by chance may overlap the frame: it arrived first.
        let overlapped = items.iter().any(|(offset, kind, bytes)| {
            *kind == Kind::Frame && *offset < start && start < offset + bytes.len() as u64
        });
        prop_assert!(overlapped || items.contains(&(start, Kind::Frame, frame.bytes.clone())));
    }
}

/// Every vector is one frame, whole and byte by byte, in both sizes of decoder where it fits.
fn every_vector_is_a_frame<F: Framing>(framing: &F, expect: F::Expect, vectors: Vec<vectors::Vector>) {
    for vector in vectors {
        let whole = decode::<F, ROOMY>(framing, expect, &[&vector.bytes]);
        assert_eq!(frames(&whole), [&vector.bytes[..]], "{}", vector.name);
        let bytes: Vec<_> = vector.bytes.chunks(1).collect();
        assert_eq!(decode::<F, TIGHT>(framing, expect, &bytes), whole, "{}", vector.name);
        assert!(vector.bytes.len() >= framing.shortest(expect), "{}", vector.name);
        if let Some(terminator) = framing.terminator(expect) {
            assert_eq!(vector.bytes.last(), Some(&terminator), "{}", vector.name);
        }
    }
}

#[test]
fn every_documented_frame_is_decoded() {
    every_vector_is_a_frame(&Ling, (), ling_vectors());
    every_vector_is_a_frame(&Legacy, (), vectors::legacy());
    every_vector_is_a_frame(&Alpha1, Expect::Requests, vectors::alpha1_requests());
    every_vector_is_a_frame(&Alpha1, Expect::Responses(None), vectors::alpha1_answers());
    every_vector_is_a_frame(&XArm::PRIVATE, Direction::Requests, vectors::xarm_requests());
    every_vector_is_a_frame(&XArm::PRIVATE, Direction::Responses, vectors::xarm_answers());
}

#[test]
fn offsets_count_every_byte_once() {
    let joints = vectors::hex("AA 06 00 01 FE 9A FF");
    let line = [&[1, 2, 0xAA, 0xAA][..], &joints, &[3], &joints].concat();
    let items = joined(decode::<_, TIGHT>(&Ling, (), &[&line]));
    let at: Vec<_> = items
        .iter()
        .map(|(offset, kind, bytes)| (*offset, bytes.len(), *kind == Kind::Frame))
        .collect();
    // A header before a header has the length AA, and the one before it the length 6, command AA.
    assert_eq!(at.iter().map(|(_, len, _)| len).sum::<usize>(), line.len());
    assert!(at.contains(&(4, 7, true)) && at.contains(&(12, 7, true)), "{at:?}");
}

#[test]
fn idle_line_truncates_an_incomplete_frame() {
    let joints = vectors::hex("AA 06 00 01 FE 9A FF");
    let line = [&[0xAA, 0, 0, 60][..], &joints].concat();
    let mut decoder = Decoder::<_, TIGHT>::new();
    assert!(decoder.push(&line).is_empty());
    assert_eq!(decoder.next(&Ling, ()), None);
    decoder.idle();
    let noise = decoder.next(&Ling, ()).unwrap();
    assert_eq!(noise.kind, Kind::Noise(Reason::Truncated { missing: 55 }));
    let items = std::iter::from_fn(|| decoder.next(&Ling, ()).map(|item| item.kind)).collect::<Vec<_>>();
    assert_eq!(items, [Kind::Noise(Reason::Stray), Kind::Frame]);
}

#[test]
fn received_bytes_end_the_idle_state() {
    let mut decoder = Decoder::<_, TIGHT>::new();
    decoder.idle();
    assert!(decoder.push(&[0xAA, 0x06]).is_empty());
    assert_eq!(decoder.next(&Ling, ()), None);
}

/// A frame with a name of this many bytes.
fn play(len: usize) -> Vec<u8> {
    let name = vec![0xF2; len];
    let count = len as u8 + 1;
    let sum = name.iter().fold(count, |sum, byte| sum.wrapping_add(*byte));
    [&[0xF3, 0x3F, count][..], &name, &[sum, 0xED]].concat()
}

#[test]
fn frame_too_long_for_decoder_is_skipped_whole() {
    // The name contains frames: none of it may be decoded as one.
    let mut long = play(100);
    let stop = vectors::hex("F2 2F 00 00 00 00 00 00 00 ED");
    long[20..30].copy_from_slice(&stop);
    let line = [&long[..], &stop].concat();
    for chunk in [1, 7, 64, 200] {
        let chunks: Vec<_> = line.chunks(chunk).collect();
        let items = joined(decode::<_, TIGHT>(&Alpha1, Expect::Requests, &chunks));
        let reason = Reason::Length {
            min: 0,
            max: 70,
            got: 105,
        };
        let expected = [(0, Kind::Noise(reason), long.clone()), (105, Kind::Frame, stop.clone())];
        assert_eq!(items, expected, "chunks of {chunk}");
    }
}

#[test]
fn idle_line_ends_the_skip() {
    let stop = vectors::hex("F2 2F 00 00 00 00 00 00 00 ED");
    let mut decoder = Decoder::<_, TIGHT>::new();
    let mut items = Vec::new();
    assert!(decoder.push(&play(100)[..30]).is_empty());
    drain(&mut decoder, &Alpha1, Expect::Requests, &mut items);
    assert_eq!(decoder.need(&Alpha1, Expect::Requests), 75 + 5);
    decoder.idle();
    drain(&mut decoder, &Alpha1, Expect::Requests, &mut items);
    assert!(decoder.push(&stop).is_empty());
    assert_eq!(
        decoder.next(&Alpha1, Expect::Requests).map(|item| item.kind),
        Some(Kind::Frame)
    );
}

#[test]
fn names_of_documented_lengths_fit_a_large_decoder() {
    for len in 0..=254 {
        let frame = play(len);
        let items = decode::<_, ROOMY>(&Alpha1, Expect::Requests, &[&frame]);
        assert_eq!(frames(&items), [&frame[..]], "{len}");
    }
}

#[test]
fn xarm_reply_ends_at_its_length() {
    let next = vectors::hex("00 02 00 02 00 02 04 00");
    for len in [0, 1, 255, 300, 5_000] {
        let reply = [&[0, 1, 0, 2][..], &u16::to_be_bytes(len), &vec![9; len.into()]].concat();
        let line = [&reply[..], &next].concat();
        let items = joined(decode::<_, ROOMY>(&XArm::PRIVATE, Direction::Responses, &[&line]));
        let reason = Reason::Length {
            min: 2,
            max: 254,
            got: len,
        };
        let expected = [
            (0, Kind::Noise(reason), reply.clone()),
            (reply.len() as u64, Kind::Frame, next.clone()),
        ];
        assert_eq!(items, expected, "{len}");
    }
}

#[test]
fn nothing_is_read_after_a_lossless_stream_broke() {
    let reply = vectors::hex("00 01 00 02 00 02 04 10");
    let line = [&reply[..], &[0, 1, 0, 9], &reply].concat();
    for chunk in [1, 3, 50] {
        let chunks: Vec<_> = line.chunks(chunk).collect();
        let items = joined(decode::<_, ROOMY>(&XArm::PRIVATE, Direction::Responses, &chunks));
        let reason = Reason::Byte {
            offset: 3,
            expected: &[0, 1, 2, 3],
            got: 9,
        };
        let expected = [
            (0, Kind::Frame, reply.clone()),
            (8, Kind::Broken(reason), line[8..].to_vec()),
        ];
        assert_eq!(items, expected, "chunks of {chunk}");
    }
}

#[test]
fn idle_has_no_effect_on_a_lossless_line() {
    let reply = vectors::hex("00 01 00 02 00 02 04 10");
    let mut decoder = Decoder::<_, ROOMY>::new();
    assert!(decoder.push(&reply[..5]).is_empty());
    decoder.idle();
    assert_eq!(decoder.next(&XArm::PRIVATE, Direction::Responses), None);
    assert!(decoder.push(&reply[5..]).is_empty());
    assert!(
        decoder
            .next(&XArm::PRIVATE, Direction::Responses)
            .is_some_and(|item| item.kind == Kind::Frame)
    );
}

#[test]
fn excess_commit_is_an_error_and_consumes_nothing() {
    let mut decoder = Decoder::<Ling, 8>::new();
    let error = decoder.commit(9).unwrap_err();
    assert_eq!((error.got, error.max), (9, 8));
    assert_eq!((decoder.pending(), decoder.received()), (0, 0));
    assert!(decoder.commit(8).is_ok() && decoder.commit(1).is_err());
}

#[test]
fn idle_line_completes_a_single_byte_frame() {
    let servo = ServoId::new(0x50).unwrap();
    // FA could begin a frame of a servo.
    let expect = Expect::Responses(Some(ServoAnswer::Acknowledgement(servo)));
    assert_eq!(Alpha1.scan(&[0xFA], expect), Scan::Need(1));
    assert_eq!(Alpha1.scan_idle(&[0xFA], expect), Scan::Frame(1));
    assert_eq!(frames(&decode::<_, TIGHT>(&Alpha1, expect, &[&[0xFA]])), [[0xFA]]);
    assert!(frames(&decode::<_, TIGHT>(&Alpha1, Expect::Responses(None), &[&[0xFA]])).is_empty());
}

#[test]
fn padding_is_not_noise() {
    let stop = vectors::hex("F2 2F AA ED");
    let line = [&[0; 60][..], &stop, &[0; 60]].concat();
    let items = joined(decode::<_, TIGHT>(&Alpha1, Expect::Responses(None), &[&line]));
    let kinds: Vec<_> = items.iter().map(|item| (item.1, item.2.len())).collect();
    assert_eq!(kinds, [(Kind::Padding, 60), (Kind::Frame, 4), (Kind::Padding, 60)]);
}

#[test]
fn hid_reports_unpack_to_the_frames_packed() {
    use armwire::alpha1::hid;
    let mut line = Vec::new();
    let sent: Vec<_> = [0, 5, 58, 59, 60, 123, 254].map(play).into();
    for frame in &sent {
        let reports: Vec<_> = hid::reports(frame).collect();
        assert_eq!(reports.len(), frame.len().div_ceil(hid::REPORT));
        line.extend(reports.concat());
    }
    let items = decode::<_, ROOMY>(&Alpha1, Expect::Requests, &line.chunks(hid::REPORT).collect::<Vec<_>>());
    assert_eq!(frames(&items), sent);
    assert!(items.iter().all(|item| matches!(item.1, Kind::Frame | Kind::Padding)));
}

#[test]
fn longest_ling_frame_fits_a_tight_decoder() {
    let data = [0x55; ling::MAX_DATA];
    let frame = ling::Frame {
        command: 0x06,
        function: 0x7F,
        data: &data,
    };
    let mut out = [0; TIGHT];
    assert_eq!(frame.encode(&mut out), Ok(TIGHT));
    assert_eq!(frames(&decode::<_, TIGHT>(&Ling, (), &[&out])), [out]);
}

#[test]
fn damaged_frame_is_whole_with_the_frame_in_it() {
    let good = [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF];
    let damaged = [&[0xAA, 0x06, 0x00, 0x05][..], &good].concat();
    for cut in 0..damaged.len() {
        let mut decoder = Decoder::<_, 70>::new();
        let (first, rest) = damaged.split_at(cut);
        assert!(decoder.push(first).is_empty());
        assert_eq!(decoder.advance(&Ling, ()), None, "{cut}");
        assert!(decoder.push(rest).is_empty());
        assert!(decoder.push(&[0x11; 3]).is_empty());
        let noise = decoder.advance(&Ling, ()).unwrap();
        assert!(matches!(noise.kind, Kind::Noise(Reason::Checksum { .. })));
        assert_eq!(decoder.candidate(noise, &Ling, ()), damaged);
        let stray = decoder.next(&Ling, ()).unwrap();
        assert_eq!((stray.offset, stray.bytes), (1, &damaged[1..4]));
        assert_eq!(decoder.next(&Ling, ()).unwrap().bytes, good);
    }
}

#[test]
fn break_is_whole_up_to_its_byte() {
    let mut decoder = Decoder::<_, 260>::new();
    assert!(decoder.push(&[0, 1, 0, 9, 7, 7]).is_empty());
    let broken = decoder.advance(&XArm::PRIVATE, Direction::Responses).unwrap();
    let candidate = decoder.candidate(broken, &XArm::PRIVATE, Direction::Responses);
    assert_eq!(candidate, [0, 1, 0, 9]);
}

#[test]
fn skipped_frame_states_the_bytes_to_come() {
    let mut decoder = Decoder::<_, 260>::new();
    let frame = [&[0, 1, 0, 2, 1, 0][..], &[7; 256]].concat();
    for byte in &frame[..100] {
        assert!(decoder.push(&[*byte]).is_empty());
        while decoder.advance(&XArm::PRIVATE, Direction::Responses).is_some() {}
    }
    assert_eq!(decoder.skipping(), 162);
    assert!(decoder.push(&frame[100..]).is_empty());
    assert!(decoder.advance(&XArm::PRIVATE, Direction::Responses).is_some());
    assert_eq!(decoder.skipping(), 0);
}
