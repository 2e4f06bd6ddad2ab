//! `armwire counters`: all that an adapter has counted and measured since it started.

use armwire_bridge::control::Histogram;
use clap::Args;
use serde_json::{Value, json};

use crate::adapter::{self, AdapterPort, histograms};
use crate::error::Error;
use crate::output::{print, print_json};

/// Width of the longest bar of a histogram, in columns.
const BAR: u64 = 40;

/// The arguments of `armwire counters`.
#[derive(Args)]
pub(crate) struct Counters {
    #[command(flatten)]
    adapter: AdapterPort,
    /// Print only counters that are not zero and latencies that were measured.
    #[arg(long, conflicts_with = "json")]
    brief: bool,
    /// Print one JSON object.
    #[arg(long)]
    json: bool,
}

impl Counters {
    pub(crate) fn run(&self) -> Result<(), Error> {
        let mut control = self.adapter.open()?;
        adapter::report_reservation(&mut control)?;
        let counters = control.counters()?;
        let latencies = control.latencies()?;
        let latencies = histograms(&latencies);
        if self.json {
            let latencies = latencies.map(|(name, _, histogram)| (name.to_owned(), adapter::histogram_json(histogram)));
            let latencies = Value::Object(latencies.into_iter().collect());
            return print_json(&json!({ "counters": counters, "latencies": latencies }));
        }
        let mut text = String::new();
        for (name, count) in counters.iter().filter(|&(_, count)| !self.brief || count != 0) {
            text += &format!("{name:<24}{count:>10}\n");
        }
        for (name, what, histogram) in latencies {
            if !self.brief || adapter::total(histogram) > 0 {
                text += &format!("\n{name} ({what}): {}\n{}", adapter::total(histogram), bars(histogram));
            }
        }
        print(&text)
    }
}

/// A histogram with a bar for each bucket that has something in it.
fn bars(histogram: &Histogram) -> String {
    let most = histogram.counts.iter().copied().max().unwrap_or(0).max(1);
    let mut text = String::new();
    for (bucket, &count) in histogram.counts.iter().enumerate().filter(|&(_, &count)| count > 0) {
        // At least one, so that the rare is seen.
        let len = (u64::from(count) * BAR).div_ceil(most.into());
        text += &format!(
            "  {:>10}{count:>12}  {}\n",
            adapter::limit(bucket),
            "█".repeat(len as usize)
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn histogram_shows_rare_buckets_too() {
        let mut histogram = Histogram::default();
        histogram.counts[8] = 1_000_000;
        histogram.counts[15] = 1;
        let lines: Vec<_> = bars(&histogram).lines().map(str::to_owned).collect();
        assert_eq!(
            lines,
            [
                format!("    < 512 µs     1000000  {}", "█".repeat(40)),
                "  ≥ 32768 µs           1  █".to_owned()
            ]
        );
        assert_eq!(bars(&Histogram::default()), "");
    }

    #[test]
    fn percentiles_are_the_limits_of_their_buckets() {
        let mut histogram = Histogram::default();
        assert_eq!(adapter::percentile(&histogram, 50), None);
        histogram.counts[3] = 98;
        histogram.counts[9] = 1;
        histogram.counts[15] = 1;
        let percentile = |percent| adapter::percentile(&histogram, percent).unwrap();
        assert_eq!(
            [50, 98, 99, 100].map(percentile),
            ["< 16 µs", "< 16 µs", "< 1024 µs", "≥ 32768 µs"]
        );
    }
}
