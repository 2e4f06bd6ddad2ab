//! The fault campaign, as `cargo xtask campaign` runs it.

mod options;

use std::io::Write;
use std::process::ExitCode;
use std::sync::atomic::{AtomicU32, Ordering};
use std::time::Instant;
use std::{fs, io, panic};

use armwire_host_tests::image::campaign::{Outcome, run, table};
use armwire_host_tests::page::filled;
use clap::Parser;

use crate::options::Options;

/// The document that contains the table.
const DOC: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../docs/faults.md");

/// Number of runs between progress messages.
const PROGRESS: u32 = 500;

fn main() -> ExitCode {
    match campaign(&Options::parse()) {
        Ok(true) => ExitCode::SUCCESS,
        Ok(false) => ExitCode::FAILURE,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

/// Runs the campaign. Returns true if no run failed.
fn campaign(options: &Options) -> Result<bool, String> {
    // The message of a panic is printed with the number of its run.
    panic::set_hook(Box::new(|_| {}));
    let began = Instant::now();
    let numbers: Vec<u32> = options.only.map_or_else(
        || (options.from.unwrap_or(0)..options.runs).collect(),
        |only| vec![only],
    );
    let done = AtomicU32::new(0);
    let outcomes = run(options.seed, &numbers, |outcome| {
        print_outcome(outcome, options.only.is_some());
        let done = 1 + done.fetch_add(1, Ordering::Relaxed);
        if done.is_multiple_of(PROGRESS) {
            println!("{done} runs of {} in {:.0?}", numbers.len(), began.elapsed());
        }
        // Progress must appear without delay.
        let _ = io::stdout().flush();
    });
    let table = table(&outcomes);
    println!("\n{table}");
    println!(
        "{} runs of seed {} in {:.0?}",
        outcomes.len(),
        options.seed,
        began.elapsed()
    );
    if options.write {
        write(options, &table)?;
    }
    Ok(outcomes.iter().all(|outcome| outcome.result.is_ok()))
}

/// Prints a failure and the command that repeats it.
fn print_outcome(outcome: &Outcome, always: bool) {
    let case = outcome.case;
    let second = case.second.map_or(String::new(), |second| format!(", then {second}"));
    let run = format!("run {}: {}{second}; {}", case.number, case.fault, case.moment);
    match &outcome.result {
        Ok((recovery, losses)) if always => println!("{run}: recovered after {recovery}, {losses:?}"),
        Ok(_) => {}
        Err(error) => {
            println!("FAILED {run}\n  {error}");
            println!(
                "  again: cargo xtask campaign --seed {} --only {}",
                case.seed, case.number
            );
        }
    }
}

/// Puts the table into the document.
fn write(options: &Options, table: &str) -> Result<(), String> {
    let failed = |error| format!("{DOC}: {error}");
    let page = fs::read_to_string(DOC).map_err(failed)?;
    let command = format!(
        "`cargo xtask campaign --runs {} --seed {}`:",
        options.runs, options.seed
    );
    let page = filled(&page, "campaign", &format!("{command}\n\n{table}"));
    let page = page.ok_or_else(|| format!("{DOC} has no marks for the campaign's table"))?;
    fs::write(DOC, page).map_err(failed)
}
