//! What the measuring program wrote: tables of comma-separated values.

use std::fs;
use std::path::Path;
use std::str::FromStr;

use crate::Result;

/// Everything that was measured.
#[derive(Debug)]
pub(super) struct Records {
    pub(super) latencies: Vec<Latency>,
    pub(super) stamps: Vec<Stamps>,
    pub(super) loads: Vec<Load>,
    pub(super) rates: Vec<Rate>,
    pub(super) profiles: Vec<Instructions>,
    pub(super) code: Vec<Code>,
}

/// How often something took so long on its way through the adapter.
#[derive(Debug)]
pub(super) struct Latency {
    /// What an instruction took, in percent of a cycle.
    pub(super) cost: u32,
    pub(super) way: String,
    /// Whether it had to wait for others before.
    pub(super) waited: bool,
    pub(super) nanos: u64,
    pub(super) count: u64,
}

/// How many stamps were so late, in microseconds.
#[derive(Debug)]
pub(super) struct Stamps {
    /// As above.
    pub(super) cost: u32,
    pub(super) late: u64,
    pub(super) count: u64,
}

/// What a scene took, in nanoseconds.
#[derive(Debug)]
pub(super) struct Load {
    pub(super) cost: u32,
    pub(super) scene: String,
    pub(super) time: f64,
    pub(super) busy: f64,
    pub(super) real: f64,
}

/// What passed in a second, and what the wires allow.
#[derive(Debug)]
pub(super) struct Rate {
    pub(super) what: String,
    pub(super) achieved: f64,
    pub(super) limit: f64,
}

/// How many instructions of a crate ran.
#[derive(Debug)]
pub(super) struct Instructions {
    pub(super) scene: String,
    pub(super) package: String,
    pub(super) count: u64,
}

/// How many bytes of code a crate has.
#[derive(Debug)]
pub(super) struct Code {
    pub(super) package: String,
    pub(super) bytes: u64,
}

impl Records {
    /// Reads those in this folder.
    ///
    /// # Errors
    ///
    /// If one is missing, or not as it should be.
    pub(super) fn read(folder: &Path) -> Result<Self> {
        Ok(Self {
            latencies: rows(&folder.join("latency.csv"), |[cost, way, waited, nanos, count]| {
                Some(Latency {
                    cost: number(cost)?,
                    way: way.to_owned(),
                    waited: number::<u8>(waited)? == 1,
                    nanos: number(nanos)?,
                    count: number(count)?,
                })
            })?,
            stamps: rows(&folder.join("stamps.csv"), |[cost, late, count]| {
                Some(Stamps {
                    cost: number(cost)?,
                    late: number(late)?,
                    count: number(count)?,
                })
            })?,
            loads: rows(&folder.join("load.csv"), |[cost, scene, time, busy, real]| {
                Some(Load {
                    cost: number(cost)?,
                    scene: scene.to_owned(),
                    time: number(time)?,
                    busy: number(busy)?,
                    real: number(real)?,
                })
            })?,
            rates: rows(&folder.join("rates.csv"), |[what, achieved, limit]| {
                Some(Rate {
                    what: what.to_owned(),
                    achieved: number(achieved)?,
                    limit: number(limit)?,
                })
            })?,
            profiles: rows(&folder.join("profile.csv"), |[scene, package, count]| {
                Some(Instructions {
                    scene: scene.to_owned(),
                    package: package.to_owned(),
                    count: number(count)?,
                })
            })?,
            code: rows(&folder.join("code.csv"), |[package, bytes]| {
                Some(Code {
                    package: package.to_owned(),
                    bytes: number(bytes)?,
                })
            })?,
        })
    }

    /// The share of stamps that are a microsecond late at most, and how late the worst is.
    pub(super) fn stamps(&self, cost: u32) -> (f64, u64) {
        let ours = || self.stamps.iter().filter(|stamps| stamps.cost == cost);
        let exact: u64 = ours()
            .filter(|stamps| stamps.late <= 1)
            .map(|stamps| stamps.count)
            .sum();
        let all: u64 = ours().map(|stamps| stamps.count).sum();
        let worst = ours().map(|stamps| stamps.late).max();
        (exact as f64 / all.max(1) as f64, worst.unwrap_or_default())
    }

    /// The spans of this way, from the shortest on, each with how often it was measured.
    pub(super) fn spans(&self, cost: u32, way: &str) -> Spans {
        let ours = |row: &&Latency| row.cost == cost && row.way == way;
        let mut spans: Vec<(u64, u64)> = Vec::new();
        let mut waited = 0;
        for row in self.latencies.iter().filter(ours) {
            spans.push((row.nanos, row.count));
            waited += if row.waited { row.count } else { 0 };
        }
        spans.sort_unstable();
        let count = spans.iter().map(|(_, count)| count).sum();
        Spans { spans, count, waited }
    }
}

/// Spans that were measured, in nanoseconds.
#[derive(Debug)]
pub(super) struct Spans {
    /// Each with how often, from the shortest on.
    pub(super) spans: Vec<(u64, u64)>,
    pub(super) count: u64,
    /// How many of them had to wait for others before they began.
    pub(super) waited: u64,
}

impl Spans {
    /// What this share of them does not exceed, in microseconds.
    pub(super) fn quantile(&self, share: f64) -> f64 {
        let wanted = (self.count as f64 * share).ceil();
        let mut so_far = 0;
        let reached = self.spans.iter().find(|(_, count)| {
            so_far += count;
            so_far as f64 >= wanted
        });
        reached.map_or(0.0, |&(nanos, _)| nanos as f64 / 1e3)
    }

    /// The longest, in microseconds.
    pub(super) fn worst(&self) -> f64 {
        self.spans.last().map_or(0.0, |&(nanos, _)| nanos as f64 / 1e3)
    }
}

fn rows<T, const N: usize>(file: &Path, row: impl Fn([&str; N]) -> Option<T>) -> Result<Vec<T>> {
    let text = fs::read_to_string(file).map_err(|error| format!("{}: {error}", file.display()))?;
    let parse = |line: &str| {
        let fields: Vec<&str> = line.split(',').collect();
        let row = <[&str; N]>::try_from(fields).ok().and_then(&row);
        row.ok_or_else(|| format!("{}: no row of the table: `{line}`", file.display()).into())
    };
    text.lines().skip(1).map(parse).collect()
}

fn number<T: FromStr>(text: &str) -> Option<T> {
    text.parse().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quantiles_are_of_all_that_was_measured() {
        let spans = Spans {
            spans: vec![(1_000, 98), (5_000, 1), (9_000, 1)],
            count: 100,
            waited: 0,
        };
        assert_eq!(
            [0.5, 0.98, 0.99, 1.0].map(|share| spans.quantile(share)),
            [1.0, 1.0, 5.0, 9.0]
        );
        assert_eq!(spans.worst(), 9.0);
    }
}
