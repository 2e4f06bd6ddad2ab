//! Echo: sent bytes come back, at four rates and with each parity.

use std::time::Duration;

use armwire_bridge::{LineCoding, Parity, StopBits};
use serde_json::json;

use super::bench::{Bench, at, losses, payload};
use super::report::{Passed, Trouble, ensure};
use super::{Checked, Plan, planned};

/// The slowest rate in common use, two between, and the adapter's maximum.
const RATES: [u32; 4] = [115_200, 500_000, 1_000_000, 2_000_000];
const PARITIES: [Parity; 3] = [Parity::None, Parity::Odd, Parity::Even];
/// Minimum duration of an echo, in percent of the time on the line. The adapter delays a host's last bytes, and
/// the clocks differ.
const LEAST_TIME: u32 = 97;
/// Maximum delay by the host and USB, in addition to the time on the line.
const SLACK: Duration = Duration::from_millis(200);

/// Echoes bytes at each rate and parity and checks the duration against the time on the line.
pub(super) fn at_all_rates(bench: &mut Bench<'_>, plan: &Plan) -> Checked {
    planned(plan.echo_bytes)?;
    for (baud, parity) in RATES.iter().flat_map(|&baud| PARITIES.map(|parity| (baud, parity))) {
        bench.check_stop()?;
        let coding = LineCoding {
            baud,
            parity,
            stop_bits: StopBits::One,
        };
        let seed = u64::from(baud) + parity as u64;
        at_rate(bench, coding, &payload(seed, plan.echo_bytes as usize))
            .map_err(at(format_args!("{baud} baud, {parity:?} parity")))?;
    }
    let text = format!(
        "{} bytes each at {} baud with no, odd and even parity",
        plan.echo_bytes,
        RATES.map(|baud| baud.to_string()).join(", ")
    );
    let figures = [("rates_baud", json!(RATES)), ("bytes", json!(plan.echo_bytes))];
    Ok(Passed::new(text, figures))
}

fn at_rate(bench: &mut Bench<'_>, coding: LineCoding, bytes: &[u8]) -> Result<(), Trouble> {
    bench.set_line(coding)?;
    let got = bench.line_coding()?;
    ensure(got == coding, format_args!("GET_LINE_CODING returned {got:?}"))?;
    let before = bench.counters()?;
    let took = bench.echo(bytes)?;
    if let Some(losses) = losses(&before, &bench.counters()?) {
        return Err(Trouble::failed(losses));
    }
    let line = Duration::from_micros(coding.micros(bytes.len()));
    let (len, took_us, line_us) = (bytes.len(), took.as_micros(), line.as_micros());
    ensure(
        took >= line * LEAST_TIME / 100 && took <= 2 * line + SLACK,
        format_args!("{len} bytes took {took_us} µs, and {line_us} µs on such a line"),
    )
}
