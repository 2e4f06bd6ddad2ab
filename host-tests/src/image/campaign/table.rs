//! The matrix of faults and moments with the results of the runs, as in `docs/faults.md`.

use std::collections::BTreeMap;

use armwire_virtual_board::Nanos;
use strum::VariantArray;

use super::Outcome;
use super::matrix::{Fault, Moment};

/// The matrix of these runs, in Markdown.
pub fn table(outcomes: &[Outcome]) -> String {
    let moments: String = Moment::VARIANTS.iter().map(|moment| format!(" {moment} |")).collect();
    let columns = "---:|".repeat(Moment::VARIANTS.len() + 3);
    let mut text = format!("| Fault |{moments} recovered | worst, ms | limit, ms | counted |\n|---|{columns}---|\n");
    for &fault in Fault::VARIANTS {
        let runs: Vec<&Outcome> = outcomes.iter().filter(|outcome| outcome.case.fault == fault).collect();
        text += &row(fault, &runs);
    }
    let recovered = outcomes.iter().filter(|outcome| outcome.result.is_ok()).count();
    let two = outcomes.iter().filter(|outcome| outcome.case.second.is_some()).count();
    let all = outcomes.len();
    text + &format!("\n{recovered} of {all} runs recovered; {two} of them with a second fault.\n")
}

fn row(fault: Fault, runs: &[&Outcome]) -> String {
    let count = |moment| runs.iter().filter(|run| run.case.moment == moment).count();
    let counts: String = Moment::VARIANTS
        .iter()
        .map(|&moment| format!(" {} |", count(moment)))
        .collect();
    let (mut recovered, mut worst, mut losses) = (0, Nanos(0), BTreeMap::<&str, u32>::new());
    for run in runs {
        let Ok((recovery, lost)) = &run.result else { continue };
        recovered += 1;
        if run.case.second.is_none() {
            worst = worst.max(*recovery);
        }
        for &(name, count) in lost.iter().filter(|(_, count)| *count > 0) {
            *losses.entry(name).or_default() += count;
        }
    }
    let losses: Vec<String> = losses.iter().map(|(name, count)| format!("{name} {count}")).collect();
    let [worst, limit] = [worst, fault.limit()].map(|span| span.0 as f64 / 1e6);
    format!(
        "| {fault} |{counts} {recovered} of {} | {worst:.1} | {limit:.0} | {} |\n",
        runs.len(),
        losses.join(", ")
    )
}
