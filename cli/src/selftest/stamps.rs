//! Stamps and their clock: each frame's stamp against the host's clock, and the error of the crystal.

use std::time::Duration;

use armwire_bridge::LineCoding;
use armwire_bridge::control::{Event, Request, Stamp, Subscription};
use serde_json::json;

use super::bench::{Bench, FRAME, STALL_TIMEOUT, at};
use super::report::{Passed, Trouble, ensure};
use super::usb::Pipe;
use super::{Checked, Plan, planned};

/// Frames of one round. The adapter queues 16 for events.
const BATCH: u32 = 8;
/// Frames at each end of the clock comparison. The fastest round trip counts.
const PINGS: u32 = 40;
/// Maximum difference of the two clocks, in parts per million. Crystals of these boards are within 50, a host's within
/// 50.
const MAX_PPM: f64 = 100.0;
/// Resolution of a stamp: 1 µs.
const ROUNDING: f64 = 1.0;
/// Maximum delay of a stamp after the frame's end, in microseconds: another interrupt may run before the UART's. The
/// maximum on the virtual board, which models the core's timing, is 8.
const MAX_LATE: f64 = 20.0;

/// Echoed frames and their stamps, in microseconds. The stamps use the adapter's clock, the other times the host's.
pub(super) struct Round {
    /// The time of the first frame's hand-over.
    begun: f64,
    /// The stamps, by the adapter's clock.
    stamps: Vec<f64>,
    /// The arrival time of the last frame's event.
    ended: f64,
}

impl Round {
    /// Lower and upper bound of the adapter's clock minus the host's, in microseconds.
    fn ahead(&self) -> (f64, f64) {
        let first = self.stamps.first().copied().unwrap_or_default();
        let last = self.stamps.last().copied().unwrap_or_default();
        (
            last - MAX_LATE - self.ended,
            first + ROUNDING - self.begun - line_time(),
        )
    }
}

/// Checks the stamps of many frames: in order, at least one frame time apart but after late ones, and within the bounds
/// of the host's clock.
pub(super) fn plausible(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    planned(plan.stamps)?;
    subscribe(bench)?;
    let before = bench.counters()?;
    let mut series = Series::default();
    while series.count < plan.stamps {
        bench.check_stop()?;
        let count = series.count;
        let round = go_round(bench, BATCH.min(plan.stamps - count));
        series.add(&round.map_err(at(format_args!("frame {count}")))?)?;
    }
    let after = bench.counters()?;
    let late = after.late_stamps.wrapping_sub(before.late_stamps);
    series.check_gaps(late)?;
    let Series { count, closest, .. } = series;
    let text = format!("{count} in order and consistent with this computer's clock, {late} late");
    let figures = [
        ("stamps", json!(count)),
        ("late", json!(late)),
        ("closest_us", json!(closest)),
    ];
    Ok(Passed::new(text, figures))
}

/// The stamps so far.
#[derive(Default)]
struct Series {
    count: u32,
    last: Option<f64>,
    /// The minimum interval between two stamps.
    closest: Option<f64>,
    /// Intervals shorter than a frame, as text.
    short: Vec<String>,
    /// Time of the first round, and the clock difference at that time.
    anchor: Option<(f64, (f64, f64))>,
}

impl Series {
    fn add(&mut self, round: &Round) -> Result<(), Trouble> {
        for &stamp in &round.stamps {
            let since = self.last.replace(stamp).map(|last| stamp - last);
            if let Some(since) = since.filter(|since| *since < line_time() - MAX_LATE) {
                let (count, takes) = (self.count, line_time());
                let text =
                    format!("frame {count}: its stamp is {since} µs after the one before, and it takes {takes} µs");
                if since < 0.0 {
                    return Err(Trouble::Failed(text));
                }
                self.short.push(text);
            }
            self.closest = [self.closest, since].into_iter().flatten().reduce(f64::min);
            self.count += 1;
        }
        let (since, (least, most)) = *self.anchor.get_or_insert((round.begun, round.ahead()));
        let drift = (round.ended - since) * 2.0 * MAX_PPM / 1e6;
        let now = round.ahead();
        if now.0 > most + drift || now.1 < least - drift {
            return Err(Trouble::failed(format_args!(
                "frame {}: the stamps are {:.0} to {:.0} µs ahead of this computer's clock, and were {least:.0} to {most:.0}",
                self.count, now.0, now.1
            )));
        }
        Ok(())
    }

    /// A short interval follows a stamp that the adapter counted as late. Without such a count it is a fault.
    fn check_gaps(&self, late: u32) -> Result<(), Trouble> {
        match self.short.first() {
            Some(first) if self.short.len() > late as usize => Err(Trouble::Failed(first.clone())),
            _ => Ok(()),
        }
    }
}

/// Measures the crystal's error: the rate of the adapter's clock against the host's.
pub(super) fn crystal(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    subscribe(bench)?;
    let begin = best_ping(bench)?;
    bench.sleep(plan.crystal)?;
    let end = best_ping(bench)?;
    clock_error(&begin, &end)
}

/// The error of the adapter's clock between two frames.
fn clock_error(begin: &Round, end: &Round) -> Checked {
    let (first, second) = (begin.ahead(), end.ahead());
    let elapsed = end.begun - begin.begun;
    let ppm = |difference| difference / elapsed * 1e6;
    let (least, most) = (ppm(second.0 - first.1), ppm(second.1 - first.0));
    let (error, uncertainty) = ((least + most) / 2.0, (most - least) / 2.0);
    // Negative zero becomes zero.
    let (rounded, seconds) = (error.round() + 0.0, elapsed / 1e6);
    let text = format!("{rounded:+.0} ± {uncertainty:.0} ppm against this computer's clock, in {seconds:.0} s");
    ensure(
        error.abs() - uncertainty <= MAX_PPM,
        format_args!("{text}: more than {MAX_PPM:.0} ppm"),
    )?;
    if uncertainty > MAX_PPM {
        return Err(Trouble::NotTried(format!(
            "{text}: this host is too slow for a better measurement"
        )));
    }
    let figures = [("error_ppm", json!(error)), ("uncertainty_ppm", json!(uncertainty))];
    Ok(Passed::new(text, figures))
}

/// The frame with the tightest bounds.
fn best_ping(bench: &mut Bench<'_>) -> Result<Round, Trouble> {
    let mut best = go_round(bench, 1)?;
    for _ in 1..PINGS {
        let round = go_round(bench, 1)?;
        if round.ended - round.begun < best.ended - best.begun {
            best = round;
        }
    }
    Ok(best)
}

/// Subscribes to every frame.
pub(super) fn subscribe(bench: &mut Bench<'_>) -> Result<(), Trouble> {
    bench.order(Request::Subscribe(Subscription {
        frames: true,
        events: false,
    }))
}

/// Sends frames back to back and expects their echoes and events.
pub(super) fn go_round(bench: &mut Bench<'_>, frames: u32) -> Result<Round, Trouble> {
    let begun = micros(bench.usb.now());
    let sent = FRAME.repeat(frames as usize);
    bench.usb.send(Pipe::Port, &sent)?;
    let mut stamps = Vec::new();
    for nth in 0..frames {
        stamps.push(match bench.next_event(STALL_TIMEOUT)? {
            Some((Stamp(at), Event::Frame { bytes, .. })) if bytes == FRAME => at as f64,
            Some((_, event)) => return Err(Trouble::failed(format_args!("unexpected event: {event:?}"))),
            None => return Err(Trouble::failed(format_args!("{nth} of {frames} frames were reported"))),
        });
    }
    let ended = micros(bench.usb.now());
    bench.expect_back(&sent)?;
    Ok(Round { begun, stamps, ended })
}

/// Duration of a frame on the line, in microseconds.
fn line_time() -> f64 {
    LineCoding::LING.micros(FRAME.len()) as f64
}

fn micros(time: Duration) -> f64 {
    time.as_secs_f64() * 1e6
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Frames from `begun` to `ended`, with these stamps.
    fn round(begun: f64, stamps: &[f64], ended: f64) -> Round {
        let stamps = stamps.to_vec();
        Round { begun, stamps, ended }
    }

    #[test]
    fn stamp_that_goes_back_is_reported() {
        let mut series = Series::default();
        series.add(&round(0.0, &[5_100.0, 5_170.0], 300.0)).unwrap();
        assert_eq!(series.closest, Some(70.0));
        let error = series.add(&round(400.0, &[5_169.0], 600.0)).unwrap_err();
        assert_eq!(
            error.to_string(),
            "frame 2: its stamp is -1 µs after the one before, and it takes 70 µs"
        );
    }

    #[test]
    fn stamps_closer_than_frames_are_reported() {
        let mut series = Series::default();
        series.add(&round(0.0, &[5_100.0, 5_150.0], 300.0)).unwrap();
        series.add(&round(0.0, &[5_199.0], 300.0)).unwrap();
        let error = series.check_gaps(0).unwrap_err().to_string();
        assert_eq!(
            error,
            "frame 2: its stamp is 49 µs after the one before, and it takes 70 µs"
        );
        // The stamp before it was late.
        series.check_gaps(1).unwrap();
    }

    #[test]
    fn stamps_that_jump_against_hosts_clock_are_reported() {
        for jump in [-400.0, 400.0] {
            let mut series = Series::default();
            series.add(&round(0.0, &[5_100.0], 300.0)).unwrap();
            series.add(&round(1_000.0, &[6_100.0], 1_300.0)).unwrap();
            let error = series.add(&round(2_000.0, &[7_100.0 + jump], 2_300.0)).unwrap_err();
            assert!(error.to_string().contains("ahead of this computer's clock"), "{error}");
        }
    }

    /// The error of a clock that deviates by this many microseconds after this time.
    fn error_after(seconds: f64, off: f64) -> Checked {
        let begun = seconds * 1e6;
        clock_error(
            &round(0.0, &[5_110.0], 180.0),
            &round(begun, &[begun + 5_110.0 + off], begun + 180.0),
        )
    }

    #[test]
    fn clock_error_comes_with_its_uncertainty() {
        let passed = error_after(10.0, 500.0).unwrap();
        assert_eq!(passed.text, "+50 ± 13 ppm against this computer's clock, in 10 s");
    }

    #[test]
    fn clock_error_that_is_too_large_fails() {
        for off in [-5_000.0, 5_000.0] {
            assert!(matches!(error_after(10.0, off), Err(Trouble::Failed(_))));
        }
    }

    #[test]
    fn unmeasurable_clock_error_is_not_tried() {
        assert!(matches!(error_after(1.0, 0.0), Err(Trouble::NotTried(_))));
    }
}
