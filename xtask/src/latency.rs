//! `cargo xtask latency`: measures how long a program waits for a pose, with the released builds.

use std::fs;
use std::path::Path;
use std::process::Command;
use std::time::Duration;

use anyhow::{Context, Result, bail, ensure};
use clap::Args;
use serde_json::Value;

use crate::cargo::{cargo, target_dir};
use crate::process::{output, run};
use crate::python;
use crate::vendor::background::Background;
use crate::workspace::root;

/// The marks around the tables in `docs/latency.md`.
const MARKS: [&str; 2] = ["<!-- measured: begin -->\n", "<!-- measured: end -->"];
/// Timeout until the port of the virtual arm exists.
const START: Duration = Duration::from_secs(10);

#[derive(Args)]
pub(crate) struct Options {
    /// Write the tables into docs/latency.md
    #[arg(long)]
    write: bool,
}

/// Builds the command and the wheel, measures both with virtual arms, and prints the tables.
///
/// # Errors
///
/// If a build or a measurement fails, or if the newest pose or the start of the wheel's command takes longer than its
/// limit.
pub(crate) fn measure(options: &Options) -> Result<()> {
    let folder = target_dir()?.join("latency");
    fs::create_dir_all(&folder)?;
    run(&mut cargo("build --quiet --release --package armwire-cli"))?;
    let command = target_dir()?.join("release/armwire");
    let environment = python::environment_with_wheel(&folder)?;
    let load = load_average()?;

    println!("measuring for two minutes; other programs falsify the result");
    let report = bench(&command, &folder.join("arm"))?;
    let newest_pose = root().join("python/benchmarks/newest_pose.py");
    // Its tables are complete if it misses a limit, too.
    let lerobot = environment.python().arg(newest_pose).output()?;

    let tables = format!(
        "{}\n{}",
        table(&report, &load)?,
        String::from_utf8_lossy(&lerobot.stdout)
    );
    println!("{tables}");
    if options.write {
        write(&tables)?;
    }
    let reason = String::from_utf8_lossy(&lerobot.stderr);
    ensure!(lerobot.status.success(), "newest_pose.py failed: {}", reason.trim());
    let command_start = root().join("python/benchmarks/command_start.py");
    run(environment.python().arg(command_start))
}

/// The average number of waiting threads in the last minute.
fn load_average() -> Result<String> {
    let text = fs::read_to_string("/proc/loadavg").context("the load average is known on Linux only")?;
    Ok(text.split(' ').next().unwrap_or_default().to_owned())
}

/// The measurements of a virtual arm, which runs in a process of its own.
fn bench(command: &Path, port: &Path) -> Result<Value> {
    // The link of a killed arm may point to another program's terminal.
    let _ = fs::remove_file(port);
    let mut arm = Background::start(Command::new(command).args(["sim", "ling", "--pty"]).arg(port))?;
    arm.wait_for_file(port, START)?;
    let report = output(Command::new(command).arg("bench").arg(port).args(["--load", "--json"]))?;
    Ok(serde_json::from_str(&report)?)
}

/// The system, and a table of these measurements.
fn table(report: &Value, load: &str) -> Result<String> {
    let text = |name: &str| report[name].as_str().unwrap_or("unknown");
    let runs = report["runs"].as_array().context("`armwire bench` printed no runs")?;
    let mut table = format!(
        "armwire {} on {}, {} × {}; the load average at the start was {load}.\n\n\
         | µs | read p50 | read p99 | read max | latest p50 | latest p99 | latest max | age p50 | age p99 | too old |\n\
         |---|---:|---:|---:|---:|---:|---:|---:|---:|---:|\n",
        text("armwire"),
        series(text("system")),
        report["processors"],
        text("processor"),
    );
    for pair in runs.chunks(2) {
        let [read, latest] = pair else {
            bail!("`armwire bench` printed an odd number of runs");
        };
        ensure!(
            read["call"] == "read" && latest["call"] == "latest",
            "`armwire bench` printed other runs: {read} and {latest}"
        );
        let load = if read["load"] == true { ", `--load`" } else { "" };
        table += &format!("| {} Hz{load}", read["rate_hz"]);
        for (run, names) in [
            (read, ["p50_us", "p99_us", "max_us"].as_slice()),
            (latest, &["p50_us", "p99_us", "max_us", "age_p50_us", "age_p99_us"]),
        ] {
            for name in names {
                table += &format!(" | {}", micros(&run[*name]));
            }
        }
        let failed = latest["failed"].as_f64().unwrap_or_default() / latest["calls"].as_f64().unwrap_or(1.0);
        table += &format!(" | {:.0} % |\n", failed * 100.0);
    }
    Ok(table)
}

/// `linux 6.12` of `linux 6.12.3-cloud`: the rest of a kernel's release names a build of it.
fn series(system: &str) -> String {
    system.split('.').take(2).collect::<Vec<_>>().join(".")
}

/// A duration in microseconds, to one digit after the point below 10.
fn micros(value: &Value) -> String {
    match value.as_f64() {
        None => "-".to_owned(),
        Some(micros) if micros < 10.0 => format!("{micros:.1}"),
        Some(micros) => format!("{micros:.0}"),
    }
}

/// Replaces the tables in the page.
fn write(tables: &str) -> Result<()> {
    let page = root().join("docs/latency.md");
    let text = fs::read_to_string(&page)?;
    let [begin, end] = MARKS;
    let (before, rest) = text
        .split_once(begin)
        .context("docs/latency.md has no begin of the tables")?;
    let (_, after) = rest
        .split_once(end)
        .context("docs/latency.md has no end of the tables")?;
    fs::write(&page, format!("{before}{begin}\n{tables}\n{end}{after}"))?;
    println!("written: {}", page.display());
    Ok(())
}

#[cfg(test)]
mod tests {
    use serde_json::json;

    use super::*;

    fn run(call: &str, load: bool) -> Value {
        json!({"rate_hz": 50, "call": call, "load": load, "calls": 200, "failed": 3, "p50_us": 9.96, "p99_us": 49.6,
            "max_us": 16801.4, "age_p50_us": null, "age_p99_us": 3.25})
    }

    fn table_of(runs: &[Value]) -> Result<String> {
        let system = json!({"armwire": "1.2.3", "system": "linux 6.12.3-cloud", "processors": 2, "processor": "P", "runs": runs});
        table(&system, "0.07")
    }

    #[test]
    fn row_has_a_rate_with_both_calls() {
        let runs = [
            run("read", false),
            run("latest", false),
            run("read", true),
            run("latest", true),
        ];
        let table = table_of(&runs).unwrap();
        let lines: Vec<_> = table.lines().collect();
        assert_eq!(
            lines[0],
            "armwire 1.2.3 on linux 6.12, 2 × P; the load average at the start was 0.07."
        );
        assert_eq!(
            lines[4],
            "| 50 Hz | 10.0 | 50 | 16801 | 10.0 | 50 | 16801 | - | 3.2 | 2 % |"
        );
        assert!(lines[5].starts_with("| 50 Hz, `--load` | "), "{}", lines[5]);
        assert_eq!(lines.len(), 6);
    }

    #[test]
    fn runs_in_another_order_are_refused() {
        assert!(table_of(&[run("latest", false), run("read", false)]).is_err());
        assert!(table_of(&[run("read", false)]).is_err());
    }
}
