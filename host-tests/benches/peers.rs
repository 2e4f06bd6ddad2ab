//! `cargo xtask bench` runs this and prints what comes of it.
//!
//! Each measurement is named `what/who`. What it takes in is right, and all of it comes out, or nothing is measured.

use std::hint::black_box;
use std::time::Duration;

use armwire::{alpha1, ling, xarm};
use armwire_benches::others::{mavlink2, modbus, postcard_cobs, ubx};
use armwire_benches::{FRAMES, arms, repeated};
use criterion::{Criterion, criterion_group, criterion_main};

/// How long chunks of a clean stream are: a packet of USB.
const CHUNK: usize = 64;

/// How many bytes a hostile stream has.
const HOSTILE: usize = 21_000;

/// Measures what comes to this count.
fn measure(criterion: &mut Criterion, what: &str, who: &str, count: usize, run: impl Fn() -> usize) {
    assert_eq!(run(), count, "{what}/{who}");
    criterion.bench_function(&format!("{what}/{who}"), |bencher| bencher.iter(&run));
}

/// Clean streams, down to typed values.
fn streams(criterion: &mut Criterion) {
    let (ling, xarm, alpha1) = (arms::ling::arm(), arms::xarm::arm(), arms::alpha1::arm());
    let lings = repeated(&ling.reply());
    let xarms = repeated(&xarm.reply());
    let alphas = repeated(&alpha1.reply());
    let [mavs, ubxs, modbuses, posts] =
        [mavlink2::frame(), ubx::frame(), modbus::frame(), postcard_cobs::frame()].map(|frame| repeated(&frame));
    for (what, chunk) in [("chunks", CHUNK), ("bytes", 1)] {
        let mut stream = |who, run: &dyn Fn() -> usize| measure(criterion, what, who, FRAMES, run);
        stream("ling", &|| ling.decode::<{ ling::MAX_FRAME }>(black_box(&lings), chunk));
        stream("mavlink", &|| mavlink2::decode(black_box(&mavs), chunk));
        stream("xarm", &|| xarm.decode::<{ xarm::MAX_FRAME }>(black_box(&xarms), chunk));
        stream("alpha1", &|| {
            alpha1.decode::<{ alpha1::MAX_FRAME }>(black_box(&alphas), chunk)
        });
        stream("ublox", &|| ubx::decode(black_box(&ubxs), chunk));
        stream("rmodbus", &|| modbus::decode(black_box(&modbuses), chunk));
        stream("postcard", &|| postcard_cobs::decode(black_box(&posts), chunk));
    }
    let mut framing = |who, run: &dyn Fn() -> usize| measure(criterion, "frames", who, FRAMES, run);
    framing("ling", &|| ling.frames::<{ ling::MAX_FRAME }>(black_box(&lings), CHUNK));
    framing("xarm", &|| xarm.frames::<{ xarm::MAX_FRAME }>(black_box(&xarms), CHUNK));
    framing("alpha1", &|| {
        alpha1.frames::<{ alpha1::MAX_FRAME }>(black_box(&alphas), CHUNK)
    });
}

/// The checksums alone, over what they cover of the same frames.
fn checksums(criterion: &mut Criterion) {
    let (reply, version, heartbeat) = (
        arms::ling::arm().reply(),
        arms::alpha1::arm().reply(),
        mavlink2::frame(),
    );
    let covered = |frame: &[u8], start| frame[start..frame.len() - 2].to_vec();
    let (lings, alphas, mavs) = (covered(&reply, 1), covered(&version, 2), covered(&heartbeat, 1));
    let mut alone = |who, run: &dyn Fn()| {
        measure(criterion, "checksum", who, FRAMES, || {
            (0..FRAMES).for_each(|_| run());
            FRAMES
        });
    };
    alone("ling", &|| _ = black_box(ling::checksum(black_box(&lings))));
    alone("alpha1", &|| _ = black_box(alpha1::checksum(black_box(&alphas))));
    alone("mavlink", &|| {
        _ = black_box(mavlink::calculate_crc(black_box(&mavs), 50))
    });
}

/// Requests, written; and whole calls: written, answered, matched, typed.
fn calls(criterion: &mut Criterion) {
    let (ling, xarm, alpha1) = (arms::ling::arm(), arms::xarm::arm(), arms::alpha1::arm());
    let mut encode = |who, run: &dyn Fn(usize) -> usize| measure(criterion, "encode", who, FRAMES, || run(FRAMES));
    encode("ling", &|times| ling.encode(times));
    encode("xarm", &|times| xarm.encode(times));
    encode("alpha1", &|times| alpha1.encode(times));
    encode("mavlink", &mavlink2::encode);
    encode("ublox", &ubx::encode);
    encode("rmodbus", &modbus::encode);
    encode("postcard", &postcard_cobs::encode);

    let replies = [ling.reply(), xarm.reply(), alpha1.reply(), modbus::frame()];
    let mut call = |who, run: &dyn Fn(usize) -> usize| measure(criterion, "call", who, FRAMES, || run(FRAMES));
    call("ling", &|times| ling.call::<{ ling::MAX_FRAME }>(&replies[0], times));
    call("xarm", &|times| xarm.call::<{ xarm::MAX_FRAME }>(&replies[1], times));
    call("alpha1", &|times| {
        alpha1.call::<{ alpha1::MAX_FRAME }>(&replies[2], times)
    });
    call("rmodbus", &|times| modbus::call(&replies[3], times));
}

/// Streams made to be slow. None has a frame in it. The xArm's line breaks at the first such byte.
fn hostile(criterion: &mut Criterion) {
    let (ling, alpha1) = (arms::ling::arm(), arms::alpha1::arm());
    let streams: [(&str, &[u8]); 4] = [
        ("ling-nested", &[0xAA, 0x06, 0x00, 0x0F]),
        ("ling-headers", &[0xAA]),
        ("ling-lengths", &[0xAA, 0xFF, 0x00, 64]),
        // As many beginnings as a stream can have: each takes three bytes of its own, and the end mark can be shared.
        ("ling-worst", &[0xAA, 0xAA, 0xAA, 64, 63, 62, 0xFF]),
    ];
    for (who, pattern) in streams {
        let stream: Vec<u8> = pattern.iter().copied().cycle().take(HOSTILE).collect();
        let run = || ling.decode::<{ ling::MAX_FRAME }>(black_box(&stream), CHUNK);
        measure(criterion, "hostile", who, 0, run);
    }
    let streams: [(&str, &[u8]); 3] = [
        ("alpha1-nested", &[0xF5, 0x5F]),
        ("alpha1-headers", &[0xF5]),
        ("alpha1-lengths", &[0xF1, 0x1F, 60, 0xED]),
    ];
    for (who, pattern) in streams {
        let stream: Vec<u8> = pattern.iter().copied().cycle().take(HOSTILE).collect();
        let run = || alpha1.decode::<{ alpha1::MAX_FRAME }>(black_box(&stream), CHUNK);
        measure(criterion, "hostile", who, 0, run);
    }
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800))
        .sample_size(60)
        .without_plots();
    targets = streams, checksums, calls, hostile
}
criterion_main!(benches);
