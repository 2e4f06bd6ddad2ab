//! Measurements as a table and as JSON.

use std::env::consts::{ARCH, OS};
use std::fs;
use std::time::Duration;

use serde_json::{Value, json};

use super::load::processors;
use super::measure::{Durations, Run};
use crate::error::Error;
use crate::output::print_line;

/// The computer of the measurements.
pub(super) struct System {
    /// Operating system with its version if known, and architecture.
    system: String,
    processor: String,
    processors: usize,
    adapter: Option<String>,
}

impl System {
    /// This computer, and this adapter.
    pub(super) fn of(adapter: Option<String>) -> Self {
        let read = |path| fs::read_to_string(path).ok();
        let version =
            read("/proc/sys/kernel/osrelease").map_or(String::new(), |release| format!(" {}", release.trim()));
        let processor = read("/proc/cpuinfo").and_then(|text| {
            let model = text.lines().find(|line| line.starts_with("model name"))?;
            model.split_once(": ").map(|(_, model)| model.to_owned())
        });
        Self {
            system: format!("{OS}{version}, {ARCH}"),
            processor: processor.unwrap_or_else(|| "unknown".to_owned()),
            processors: processors(),
            adapter,
        }
    }
}

/// Load, in words.
pub(super) const fn under(is_loaded: bool) -> &'static str {
    if is_loaded { ", all processors busy" } else { "" }
}

/// Prints the system, and a line for each measurement. Durations are in microseconds.
pub(super) fn print(system: &System, runs: &[Run]) -> Result<(), Error> {
    let System {
        system,
        processor,
        processors,
        adapter,
    } = system;
    print_line(format_args!("system    {system}, {processors} × {processor}"))?;
    print_line(format_args!("adapter   {}", adapter.as_deref().unwrap_or("none")))?;
    print_line("µs         call       p50     p99   p99.9     max  missed  failed    lost  age p50  age p99  load")?;
    for run in runs {
        let [p50, p99, p999, max] = columns(&run.calls).map(shown);
        let [age50, age99, ..] = columns(&run.ages).map(shown);
        let lost = run.reader.map_or("-".to_owned(), |counts| counts.lost.to_string());
        let (rate, call) = (run.rate.hertz(), run.call.to_string());
        let (missed, failed) = (run.missed, run.failed);
        let load = if run.is_loaded { "busy" } else { "none" };
        print_line(format_args!(
            "{rate:>5} Hz   {call:<6} {p50:>7} {p99:>7} {p999:>7} {max:>7} {missed:>7} {failed:>7} {lost:>7} {age50:>8} \
             {age99:>8}  {load}"
        ))?;
    }
    Ok(())
}

/// Measurements with the system, for programs.
pub(super) fn json(system: &System, runs: &[Run]) -> Value {
    let runs = runs.iter().map(|run| {
        let [p50, p99, p999, max] = columns(&run.calls).map(micros);
        let [age50, age99, age999, age_max] = columns(&run.ages).map(micros);
        json!({
            "rate_hz": run.rate.hertz(),
            "call": run.call.to_string(),
            "load": run.is_loaded,
            "calls": run.calls.ascending().len(),
            "p50_us": p50, "p99_us": p99, "p99_9_us": p999, "max_us": max,
            "missed": run.missed,
            "failed": run.failed,
            "age_p50_us": age50, "age_p99_us": age99, "age_p99_9_us": age999, "age_max_us": age_max,
            "reader": run.reader.map(|counts| json!({
                "samples": counts.samples, "lost": counts.lost, "missed": counts.missed
            })),
        })
    });
    json!({
        "armwire": env!("CARGO_PKG_VERSION"),
        "system": system.system,
        "processor": system.processor,
        "processors": system.processors,
        "adapter": system.adapter,
        "runs": runs.collect::<Vec<_>>(),
    })
}

/// The 50th, 99th and 99.9th percentile, and the maximum.
fn columns(durations: &Durations) -> [Option<Duration>; 4] {
    let [p50, p99, p999] = [500, 990, 999].map(|share| durations.permille(share));
    [p50, p99, p999, durations.max()]
}

/// A duration in microseconds, to one digit after the point below 10.
fn shown(duration: Option<Duration>) -> String {
    match duration {
        None => "-".to_owned(),
        Some(duration) if duration < Duration::from_micros(10) => format!("{:.1}", duration.as_secs_f64() * 1e6),
        Some(duration) => duration.as_micros().to_string(),
    }
}

fn micros(duration: Option<Duration>) -> Value {
    duration.map_or(Value::Null, |duration| json!(duration.as_nanos() as f64 / 1_000.0))
}
