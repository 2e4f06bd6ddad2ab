//! The matrix of faults and moments with the results of the runs, as in `docs/faults.md`.

use std::collections::BTreeMap;
use std::fmt;

use armwire_virtual_board::Nanos;

use super::Outcome;
use super::matrix::{Fault, Moment};

/// Results of the runs with one fault.
#[derive(Clone, Debug, Default)]
struct Row {
    runs: BTreeMap<Moment, u32>,
    failed: u32,
    /// The longest recovery in runs without a second fault.
    worst: Nanos,
    losses: BTreeMap<&'static str, u32>,
}

/// The matrix.
#[derive(Clone, Debug)]
pub struct Table {
    rows: Vec<(Fault, Row)>,
    two: u32,
}

impl Table {
    /// The matrix of these runs.
    pub fn of(outcomes: &[Outcome]) -> Self {
        let mut rows: Vec<(Fault, Row)> = Fault::ALL.map(|fault| (fault, Row::default())).into();
        for outcome in outcomes {
            let Some((_, row)) = rows.iter_mut().find(|(fault, _)| *fault == outcome.case.fault) else {
                continue;
            };
            *row.runs.entry(outcome.case.moment).or_default() += 1;
            match &outcome.result {
                Ok((recovery, losses)) => {
                    if outcome.case.second.is_none() {
                        row.worst = row.worst.max(*recovery);
                    }
                    for &(name, count) in losses.iter().filter(|(_, count)| *count > 0) {
                        *row.losses.entry(name).or_default() += count;
                    }
                }
                Err(_) => row.failed += 1,
            }
        }
        let two = outcomes.iter().filter(|outcome| outcome.case.second.is_some()).count() as u32;
        Self { rows, two }
    }
}

/// In Markdown.
impl fmt::Display for Table {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let millis = |span: Nanos| span.0 as f64 / 1e6;
        write!(f, "| Fault |")?;
        for moment in Moment::ALL {
            write!(f, " {} |", moment.name())?;
        }
        writeln!(f, " recovered | worst, ms | limit, ms | counted |")?;
        writeln!(f, "|---|{}", "---:|".repeat(Moment::ALL.len() + 3) + "---|")?;
        let (mut runs, mut recovered) = (0, 0);
        for (fault, row) in &self.rows {
            write!(f, "| {} |", fault.name())?;
            for moment in Moment::ALL {
                write!(f, " {} |", row.runs.get(&moment).copied().unwrap_or(0))?;
            }
            let all: u32 = row.runs.values().sum();
            (runs, recovered) = (runs + all, recovered + all - row.failed);
            let losses: Vec<String> = row
                .losses
                .iter()
                .map(|(name, count)| format!("{name} {count}"))
                .collect();
            writeln!(
                f,
                " {} of {all} | {:.1} | {:.0} | {} |",
                all - row.failed,
                millis(row.worst),
                millis(fault.limit()),
                losses.join(", ")
            )?;
        }
        writeln!(
            f,
            "\n{recovered} of {runs} runs recovered; {} of them with a second fault.",
            self.two
        )
    }
}
