//! A sweep of gaps between two writes: no byte waits for the next write, and only a contiguous frame counts as a
//! frame.

use std::time::Duration;

use armwire_bridge::Counters;
use serde_json::json;

use super::bench::{Bench, FRAME, at, payload};
use super::report::{Passed, Trouble, ensure};
use super::stamps::{go_round, subscribe};
use super::usb::Pipe;
use super::{Checked, Plan};

/// The gaps, in microseconds: from 0 to more than the adapter's timeout for the rest of a request.
const GAPS: [u64; 8] = [0, 50, 200, 1_000, 2_000, 5_000, 20_000, MAX_GAP];
const MAX_GAP: u64 = 50_000;
/// Lengths of writes that are not frames, including values around the packet size.
const LENGTHS: [usize; 7] = [1, 2, 6, 7, 63, 64, 65];
/// Frames with each gap.
const FRAMES: u32 = 10;
/// A gap beyond the adapter's timeout: the two halves of a frame stay separate.
const CUT: Duration = Duration::from_millis(10);

/// Sweeps the gaps.
pub(super) fn sweep(bench: &mut Bench<'_>, _: &Plan) -> Checked {
    subscribe(bench)?;
    for gap in GAPS {
        one_gap(bench, Duration::from_micros(gap)).map_err(at(format_args!("a gap of {gap} µs")))?;
    }
    for place in 1..FRAME.len() {
        cut(bench, place).map_err(at(format_args!("a frame cut after {place} bytes")))?;
    }
    let text = format!(
        "{} gaps up to {} ms, no byte delayed, no frame cut or joined",
        GAPS.len(),
        MAX_GAP / 1_000
    );
    Ok(Passed::new(text, [("gaps_us", json!(GAPS))]))
}

/// Frames and noise bytes, each followed by a gap.
fn one_gap(bench: &mut Bench<'_>, gap: Duration) -> Result<(), Trouble> {
    let before = bench.counters()?;
    for _ in 0..FRAMES {
        go_round(bench, 1)?;
        bench.usb.sleep(gap)?;
    }
    for (nth, length) in LENGTHS.into_iter().enumerate() {
        let bytes = payload(nth as u64, length);
        bench.usb.send(Pipe::Port, &bytes)?;
        bench.expect_back(&bytes).map_err(at(format_args!("{length} bytes")))?;
        bench.usb.sleep(gap)?;
    }
    let noise = LENGTHS.iter().sum::<usize>() as u32;
    let (frames, noise_bytes) = counted_since(bench, &before)?;
    ensure(
        (frames, noise_bytes) == (FRAMES, noise),
        format_args!("{FRAMES} frames and {noise} noise bytes were sent, {frames} and {noise_bytes} were counted"),
    )
}

/// Sends a frame in two pieces with an idle line between them: it must count as noise.
fn cut(bench: &mut Bench<'_>, place: usize) -> Result<(), Trouble> {
    let before = bench.counters()?;
    let (first, second) = FRAME.split_at(place);
    for piece in [first, second] {
        bench.usb.send(Pipe::Port, piece)?;
        bench.expect_back(piece)?;
        bench.usb.sleep(CUT)?;
    }
    let (frames, noise_bytes) = counted_since(bench, &before)?;
    ensure(
        (frames, noise_bytes) == (0, FRAME.len() as u32),
        format_args!("{frames} frames and {noise_bytes} noise bytes were counted"),
    )
}

/// Numbers of frames and of noise bytes that the adapter has counted since then.
fn counted_since(bench: &mut Bench<'_>, before: &Counters) -> Result<(u32, u32), Trouble> {
    let after = bench.counters()?;
    let frames = after.frames.wrapping_sub(before.frames);
    Ok((frames, after.noise_bytes.wrapping_sub(before.noise_bytes)))
}
