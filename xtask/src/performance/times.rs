//! How long builds and tests take.

use std::fmt::Write as _;
use std::fs;
use std::process::{Command, Stdio};
use std::time::Instant;

use crate::Result;
use crate::process;
use crate::workspace;

/// The processors that a clean test may use.
const TWO_CORES: &str = "0,1";
/// What each may take, in seconds.
const TEST_GOAL: f64 = 90.0;
const DEMO_GOAL: f64 = 5.0;
/// The kernel's unit of processor time in `/proc` on every Linux that Rust supports, in a second.
const TICKS: f64 = 100.0;

/// A clean `cargo test` of the default members on two cores, and a warm `cargo demo`.
///
/// # Errors
///
/// If one fails, or this is no Linux.
pub(super) fn table() -> Result<String> {
    let target = workspace::target_dir()?.join("performance").join("clean");
    if target.exists() {
        fs::remove_dir_all(&target)?;
    }
    let cargo = process::cargo();
    let mut test = Command::new("taskset");
    test.args(["--cpu-list", TWO_CORES]).arg(cargo.get_program());
    test.args(["test", "--quiet"]).env("CARGO_TARGET_DIR", &target);
    process::forget_our_package(&mut test);
    let test = timed(&mut test)?;
    let mut demo = process::cargo();
    demo.arg("demo").stdin(Stdio::null());
    timed(&mut demo)?;
    let demo = timed(&mut demo)?;

    let mut table = "| What | Took | Processor time ÷ 2 | Goal | Load of the machine before |\n".to_owned();
    table += "|---|---:|---:|---:|---:|\n";
    for (name, time, goal) in [
        ("`cargo test`, clean, two cores", test, TEST_GOAL),
        ("`cargo demo`, warm", demo, DEMO_GOAL),
    ] {
        let _ = writeln!(
            table,
            "| {name} | {:.1} s | {:.1} s | {goal} s | {} |",
            time.took,
            time.processor / 2.0,
            time.load
        );
    }
    Ok(table)
}

/// What a command took, in seconds.
#[derive(Clone, Debug)]
struct Time {
    took: f64,
    /// Of all processors together.
    processor: f64,
    /// The load average of the minute before.
    load: String,
}

fn timed(command: &mut Command) -> Result<Time> {
    let load = fs::read_to_string("/proc/loadavg")?;
    let (began, before) = (Instant::now(), children()?);
    process::run(command.current_dir(workspace::root()))?;
    Ok(Time {
        took: began.elapsed().as_secs_f64(),
        processor: children()? - before,
        load: load.split(' ').next().unwrap_or_default().to_owned(),
    })
}

/// The processor time of all processes that we started and that are over, in seconds.
fn children() -> Result<f64> {
    let stat = fs::read_to_string("/proc/self/stat")?;
    // proc(5): behind the name in brackets, cutime and cstime are the fields 16 and 17, counted from 1.
    let (_, rest) = stat.rsplit_once(')').ok_or("/proc/self/stat has no name")?;
    let fields: Vec<&str> = rest.split_whitespace().collect();
    let [user, system] =
        [fields.get(13), fields.get(14)].map(|field| field.and_then(|field| field.parse::<f64>().ok()));
    Ok((user.ok_or("no cutime")? + system.ok_or("no cstime")?) / TICKS)
}
