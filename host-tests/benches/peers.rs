//! The times of decoding and encoding on this machine, beside other crates for frames of about the same size.
//!
//! Each measurement is named `operation/crate`. The input is valid, and a measurement requires that all of it is decoded.

mod others;

use std::hint::black_box;
use std::time::Duration;

use armwire::messages::Messages;
use armwire_benches::{ALPHA1, Arm, LING, xarm};
use criterion::{Criterion, criterion_group, criterion_main};
use others::{mavlink2, modbus, postcard_cobs, ubx};

/// The frames of a stream, and of a measurement.
const FRAMES: usize = 1000;

/// The ways in which a stream comes: in packets of USB, and byte by byte.
const CHUNKS: [(&str, usize); 2] = [("chunks", 64), ("bytes", 1)];

fn peers(criterion: &mut Criterion) {
    arm(criterion, "Ling", &LING);
    arm(criterion, "xArm", &xarm());
    arm(criterion, "Alpha1", &ALPHA1);
    measure(
        criterion,
        "mavlink",
        &mavlink2::frame(),
        mavlink2::decode,
        mavlink2::encode,
    );
    measure(criterion, "ublox", ubx::FRAME, ubx::decode, ubx::encode);
    measure(criterion, "rmodbus", modbus::FRAME, modbus::decode, modbus::encode);
    let postcard = postcard_cobs::frame();
    measure(
        criterion,
        "postcard",
        &postcard,
        postcard_cobs::decode,
        postcard_cobs::encode,
    );
}

fn arm<M: Messages + Copy, const N: usize>(criterion: &mut Criterion, name: &str, arm: &Arm<M, N>) {
    let decode = |stream: &[u8], chunk| arm.replies(&mut arm.decoder(), stream, chunk);
    let mut room = [0; N];
    let encode = |times| (0..times).filter(|_| arm.encode(black_box(&mut room)) > 0).count();
    measure(criterion, name, arm.reply, decode, encode);
}

/// Measures a crate: the decoding of a stream of this frame in chunks, and the encoding of a number of frames. Both
/// functions return the number of frames.
fn measure(
    criterion: &mut Criterion,
    name: &str,
    frame: &[u8],
    decode: impl Fn(&[u8], usize) -> usize,
    mut encode: impl FnMut(usize) -> usize,
) {
    let mut measure = |operation: &str, run: &mut dyn FnMut() -> usize| {
        assert_eq!(run(), FRAMES, "{operation}/{name}");
        criterion.bench_function(&format!("{operation}/{name}"), |bencher| bencher.iter(&mut *run));
    };
    let stream = frame.repeat(FRAMES);
    for (operation, chunk) in CHUNKS {
        measure(operation, &mut || decode(black_box(&stream), chunk));
    }
    measure("encode", &mut || encode(FRAMES));
}

criterion_group! {
    name = benches;
    config = Criterion::default()
        .warm_up_time(Duration::from_millis(200))
        .measurement_time(Duration::from_millis(800))
        .sample_size(60)
        .without_plots();
    targets = peers
}
criterion_main!(benches);
