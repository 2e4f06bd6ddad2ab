//! The streaming decoder agrees with the reference for any stream in any chunks: the same frames at the same positions,
//! and the same noise for the same reason.
//!
//! The streams are drawn from a seed, so every run is the same. `ARMWIRE_STREAMS` sets their number for each line:
//! `ARMWIRE_STREAMS=2000000 cargo test --release -p armwire-host-tests --test reference` is a long run.

mod streams;

use std::collections::BTreeMap;
use std::ops::Range;
use std::{env, slice};

use armwire::alpha1::{self, Alpha1, Expect, ServoAnswer, ServoId};
use armwire::decoder::{Decoder, Kind};
use armwire::framing::{Framing, Reason};
use armwire::ling::legacy::{self, Legacy};
use armwire::ling::{self, Ling};
use armwire::xarm::{self, Direction, XArm};
use armwire_host_tests::reference::vectors::{self, Vector};
use armwire_host_tests::reference::{self, Piece};
use oorandom::Rand32;

use streams::{Dialect, below};

/// Number of streams of each line without `ARMWIRE_STREAMS`.
const STREAMS: u64 = 3_000;

/// The reference decoder.
type Reference = Box<dyn Fn(&[u8]) -> Vec<Piece>>;

/// A line: the parameters of the decoder, and the reference.
struct Line<F: Framing> {
    framing: F,
    /// The decoder's expectation of the next frame.
    expect: F::Expect,
    /// The reference.
    reference: Reference,
    /// The content of a frame, in terms of the reference.
    content: fn(&[u8]) -> Vec<u8>,
}

impl<F: Framing> Line<F> {
    /// The reference's pieces of streams with silence after each.
    fn plain(&self, streams: &[Vec<u8>]) -> Vec<Piece> {
        if F::LOSSLESS {
            return (self.reference)(&streams.concat());
        }
        let mut before = 0;
        let mut pieces = Vec::new();
        for stream in streams {
            pieces.extend((self.reference)(stream).into_iter().map(|piece| moved(piece, before)));
            before += stream.len();
        }
        pieces
    }

    /// The decoder's pieces of the streams in chunks of any lengths.
    fn streamed<const N: usize>(&self, streams: &[Vec<u8>], random: &mut Rand32) -> Vec<Piece> {
        let (mut decoder, mut pieces) = (Decoder::<_, N>::new(), Pieces::default());
        for stream in streams {
            let mut rest = &stream[..];
            while !rest.is_empty() {
                let need = decoder.need(&self.framing, self.expect);
                assert!(need > 0, "no threshold and no piece");
                let len = match random.rand_range(0..4) {
                    0 => 1,
                    1 => need,
                    2 => need - 1,
                    _ => 1 + below(random, 60),
                };
                let (mut chunk, later) = rest.split_at(len.min(rest.len()));
                rest = later;
                let (short, before) = (chunk.len() < need, pieces.frames);
                while !chunk.is_empty() {
                    chunk = decoder.push(chunk);
                    self.take(&mut decoder, &mut pieces);
                }
                assert!(!short || pieces.frames == before, "the threshold was {need} bytes");
            }
            decoder.idle();
            self.take(&mut decoder, &mut pieces);
            // The strays before and after a silence are not one piece.
            pieces.stray = None;
            assert!(F::LOSSLESS || decoder.pending() == 0, "undecided on a silent line");
        }
        pieces.pieces
    }

    /// Takes all pieces out of the decoder.
    fn take<const N: usize>(&self, decoder: &mut Decoder<F, N>, pieces: &mut Pieces) {
        while let Some(piece) = decoder.next(&self.framing, self.expect) {
            let start = piece.offset as usize;
            let at = start..start + piece.bytes.len();
            match piece.kind {
                Kind::Frame => pieces.frame(at, (self.content)(piece.bytes)),
                Kind::Padding => {}
                Kind::Noise(reason) => pieces.noise(at, reason, F::LOSSLESS),
                Kind::Broken(reason) => pieces.broken(start, reason),
            }
        }
    }
}

/// The output of a decoder, as pieces of the reference.
#[derive(Default)]
struct Pieces {
    pieces: Vec<Piece>,
    frames: usize,
    /// The end of a run of stray bytes that may go on.
    stray: Option<usize>,
    /// The received part of a frame that is skipped whole, and its start.
    skipped: Option<(usize, usize)>,
    broken: bool,
}

impl Pieces {
    fn frame(&mut self, at: Range<usize>, content: Vec<u8>) {
        self.frames += 1;
        self.pieces.push(Piece::Frame { at, content });
    }

    /// The reference has a skipped frame once it is complete.
    fn noise(&mut self, at: Range<usize>, reason: Reason, lossless: bool) {
        if let (true, Reason::Length { got, .. }) = (lossless, reason) {
            let (start, came) = self.skipped.take().unwrap_or((at.start, 0));
            let (came, whole) = (came + at.len(), xarm::HEADER + usize::from(got));
            assert!(came <= whole, "more is skipped than there is");
            match came == whole {
                true => self.pieces.push(Piece::Noise {
                    at: start..at.end,
                    reason,
                }),
                false => self.skipped = Some((start, came)),
            }
            return;
        }
        match self.pieces.last_mut() {
            Some(Piece::Noise { at: run, .. }) if reason == Reason::Stray && self.stray == Some(at.start) => {
                run.end = at.end;
            }
            _ => self.pieces.push(Piece::Noise { at: at.clone(), reason }),
        }
        self.stray = (reason == Reason::Stray).then_some(at.end);
    }

    /// The reference has the bytes up to the one that breaks the stream.
    fn broken(&mut self, start: usize, reason: Reason) {
        if !self.broken {
            let Reason::Byte { offset, .. } = reason else {
                panic!("{reason:?}")
            };
            let at = start..start + usize::from(offset) + 1;
            self.pieces.push(Piece::Noise { at, reason });
        }
        self.broken = true;
    }
}

fn moved(piece: Piece, by: usize) -> Piece {
    let to = |at: Range<usize>| at.start + by..at.end + by;
    match piece {
        Piece::Frame { at, content } => Piece::Frame { at: to(at), content },
        Piece::Noise { at, reason } => Piece::Noise { at: to(at), reason },
    }
}

/// Compares both on many streams, and returns the number of pieces of each kind.
fn compare<F: Framing, const N: usize>(line: &Line<F>, dialect: &Dialect) -> BTreeMap<&'static str, u64> {
    let streams = env::var("ARMWIRE_STREAMS").map_or(STREAMS, |n| n.parse().expect("ARMWIRE_STREAMS is a number"));
    let mut seen = BTreeMap::new();
    for seed in 0..streams {
        let random = &mut Rand32::new(seed);
        let streams: Vec<_> = (0..1 + below(random, 3)).map(|_| dialect.stream(random)).collect();
        let plain = line.plain(&streams);
        let streamed = line.streamed::<N>(&streams, random);
        let same = plain
            .iter()
            .zip(&streamed)
            .take_while(|(plain, streamed)| plain == streamed)
            .count();
        assert!(
            plain == streamed,
            "seed {seed}: {streams:02X?}\nreference {:?}\ndecoder {:?}",
            plain.get(same),
            streamed.get(same)
        );
        for piece in plain {
            *seen.entry(kind(&piece)).or_default() += 1;
        }
    }
    println!("{streams} streams: {seen:?}");
    seen
}

fn kind(piece: &Piece) -> &'static str {
    match piece {
        Piece::Frame { .. } => "frame",
        Piece::Noise { reason, .. } => match reason {
            Reason::Stray => "stray",
            Reason::Length { .. } => "length",
            Reason::Byte { .. } => "byte",
            Reason::Checksum { .. } => "checksum",
            Reason::Tail { .. } => "tail",
            Reason::Truncated { .. } => "truncated",
            _ => "other",
        },
    }
}

/// Compares both, and checks that each of these kinds of pieces occurs often.
fn agree<F: Framing, const N: usize>(line: &Line<F>, dialect: &Dialect, kinds: &[&str]) {
    let seen = compare::<F, N>(line, dialect);
    assert_eq!(seen.keys().copied().collect::<Vec<_>>(), kinds);
    assert!(seen.values().all(|&count| count > 100), "{seen:?}");
}

fn ling() -> Line<Ling> {
    Line {
        framing: Ling,
        expect: (),
        reference: Box::new(|stream| reference::decode(stream, reference::ling::scan)),
        content: |bytes| {
            let frame = ling::Frame::parse(bytes).expect("a frame");
            [&[frame.command, frame.function], frame.data].concat()
        },
    }
}

fn legacy() -> Line<Legacy> {
    Line {
        framing: Legacy,
        expect: (),
        reference: Box::new(|stream| reference::decode(stream, reference::legacy::scan)),
        content: |bytes| {
            let frame = legacy::Frame::parse(bytes).expect("a frame");
            [&[frame.command], frame.data].concat()
        },
    }
}

fn xarm(direction: Direction) -> Line<XArm> {
    Line {
        framing: XArm::PRIVATE,
        expect: direction,
        reference: Box::new(move |stream| reference::xarm::decode(stream, direction)),
        content: |bytes| {
            let frame = xarm::Frame::parse(bytes).expect("a frame");
            let ids = [frame.transaction.to_be_bytes(), frame.protocol.to_be_bytes()].concat();
            [&ids, frame.body].concat()
        },
    }
}

/// The expectation of a servo's acknowledgement.
fn acknowledgement(servo: u8) -> Expect {
    let servo = ServoId::new(servo).expect("an id");
    Expect::Responses(Some(ServoAnswer::Acknowledgement(servo)))
}

fn alpha1(expect: Expect) -> Line<Alpha1> {
    Line {
        framing: Alpha1,
        expect,
        reference: Box::new(move |stream| reference::decode(stream, |bytes| reference::alpha1::scan(bytes, expect))),
        content: |bytes| match alpha1::Frame::parse(bytes).expect("a frame") {
            alpha1::Frame::Byte(byte) => vec![byte],
            alpha1::Frame::Message { command, data } => [&[command], data].concat(),
        },
    }
}

#[test]
fn ling_is_decoded_as_by_the_reference() {
    let kinds = ["checksum", "frame", "length", "stray", "tail", "truncated"];
    agree::<_, { ling::MAX_FRAME }>(&ling(), &streams::LING, &kinds);
}

#[test]
fn legacy_ling_decodes_like_the_reference() {
    let kinds = ["checksum", "frame", "length", "stray", "tail", "truncated"];
    agree::<_, { legacy::MAX_FRAME }>(&legacy(), &streams::LEGACY, &kinds);
}

#[test]
fn xarm_requests_decode_like_the_reference() {
    let kinds = ["byte", "frame", "length"];
    agree::<_, { xarm::MAX_FRAME }>(&xarm(Direction::Requests), &streams::XARM_HOST, &kinds);
}

#[test]
fn xarm_answers_decode_like_the_reference() {
    let kinds = ["byte", "frame", "length"];
    agree::<_, { xarm::MAX_FRAME }>(&xarm(Direction::Responses), &streams::XARM_ARM, &kinds);
}

const ALPHA1_KINDS: [&str; 7] = ["byte", "checksum", "frame", "length", "stray", "tail", "truncated"];

#[test]
fn alpha1_requests_decode_like_the_reference() {
    agree::<_, { alpha1::MAX_FRAME }>(&alpha1(Expect::Requests), &streams::ALPHA1_HOST, &ALPHA1_KINDS);
}

#[test]
fn alpha1_answers_decode_like_the_reference() {
    agree::<_, { alpha1::MAX_FRAME }>(&alpha1(Expect::Responses(None)), &streams::ALPHA1_ROBOT, &ALPHA1_KINDS);
}

/// A servo's acknowledgement is one byte: an ordinary byte, a frame's first byte, padding, or an end mark.
#[test]
fn alpha1_answers_with_acknowledgement_decode_like_the_reference() {
    for id in [1, 80, 82, 86, 67] {
        let line = alpha1(acknowledgement(id));
        agree::<_, { alpha1::MAX_FRAME }>(&line, &streams::ALPHA1_ROBOT, &ALPHA1_KINDS);
    }
}

/// Checks that decoder and reference take each of these frames for one frame.
fn hold<F: Framing, const N: usize>(line: &Line<F>, vectors: Vec<Vector>) {
    for Vector { name, bytes, .. } in vectors {
        let plain = line.plain(slice::from_ref(&bytes));
        let whole = 0..bytes.len();
        assert!(
            matches!(&plain[..], [Piece::Frame { at, .. }] if *at == whole),
            "{name}: {plain:?}"
        );
        assert_eq!(line.streamed::<N>(&[bytes], &mut Rand32::new(0)), plain, "{name}");
    }
}

#[test]
fn every_frame_of_the_documents_is_one_frame() {
    hold::<_, { ling::MAX_FRAME }>(&ling(), vectors::ling_requests());
    hold::<_, { ling::MAX_FRAME }>(&ling(), vectors::ling_answers());
    hold::<_, { legacy::MAX_FRAME }>(&legacy(), vectors::legacy());
    hold::<_, { xarm::MAX_FRAME }>(&xarm(Direction::Requests), vectors::xarm_requests());
    hold::<_, { xarm::MAX_FRAME }>(&xarm(Direction::Responses), vectors::xarm_answers());
    hold::<_, { alpha1::MAX_FRAME }>(&alpha1(Expect::Requests), vectors::alpha1_requests());
    hold::<_, { alpha1::MAX_FRAME }>(&alpha1(Expect::Responses(None)), vectors::alpha1_answers());
    hold::<_, { alpha1::MAX_FRAME }>(&alpha1(acknowledgement(1)), vectors::alpha1_servo_answers());
}
