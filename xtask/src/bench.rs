//! `cargo xtask bench`: how fast this machine takes in and gives out frames, beside what others do of the same kind.
//!
//! `host-tests/benches` measures. What a machine does besides only makes a run slower, so the fastest of the samples is
//! what is compared.

use std::collections::BTreeMap;
use std::ffi::OsString;
use std::fs;
use std::path::Path;

use serde_json::{Value, json};

use crate::Result;
use crate::process::{cargo, run as run_command};
use crate::workspace;

/// Of how many frames a measurement of a clean stream is, and of how many bytes one of a hostile stream.
const FRAMES: f64 = 1000.0;
const HOSTILE: f64 = 21_000.0;

/// How long a reply of Ling is, and one of Alpha1, as they are measured.
const REPLIES: [(&str, f64); 2] = [("ling", 21.0), ("alpha1", 15.0)];

/// Ling's checksum: what it is called here, the feature for it, and what is measured with it.
const CHECKSUMS: [(&str, &str, &str); 3] = [
    ("crc-table16", "crc-table16", ""),
    ("crc-table", "crc-table", "ling"),
    ("64-byte table", "", "ling"),
];

/// Nanoseconds by what is measured and of whom.
type Times = BTreeMap<(String, String), f64>;

/// Runs the measurements, prints tables of them, and writes `bench.json` into the target directory.
///
/// # Errors
///
/// If a stream is not taken in as it should be, or something does not build.
pub(crate) fn run(args: &[OsString]) -> Result {
    if !args.is_empty() {
        return Err("usage: cargo xtask bench".into());
    }
    let mut all = Vec::new();
    for (checksum, feature, filter) in CHECKSUMS {
        let times = measure(feature, filter)?;
        println!("\nLing's checksum: {checksum}");
        print(&times, filter.is_empty());
        let goals = goals(&times);
        for goal in &goals {
            println!("{goal}");
        }
        for ((what, who), nanos) in &times {
            all.push(json!({ "checksum": checksum, "what": what, "who": who, "nanoseconds": nanos }));
        }
        for Goal {
            what,
            value,
            limit,
            most,
        } in goals
        {
            all.push(json!({ "checksum": checksum, "goal": what, "value": value, "limit": limit, "at_most": most }));
        }
    }
    let file = workspace::target_dir()?.join("bench.json");
    fs::write(&file, serde_json::to_string_pretty(&all)?)?;
    println!("\nas JSON: {}", file.display());
    Ok(())
}

/// Runs all measurements whose name has the filter in it.
fn measure(feature: &str, filter: &str) -> Result<Times> {
    let target = workspace::target_dir()?;
    let folder = target.join("criterion");
    if folder.exists() {
        fs::remove_dir_all(&folder)?;
    }
    let mut bench = cargo();
    bench
        .args(["bench", "--quiet", "--features", feature, "--", "--quiet", filter])
        .env("CARGO_TARGET_DIR", &target)
        .current_dir(workspace::root().join("host-tests/benches"));
    run_command(&mut bench)?;
    let mut times = Times::new();
    for entry in fs::read_dir(&folder)? {
        let entry = entry?.path();
        let Ok(text) = fs::read_to_string(entry.join("new/benchmark.json")) else {
            continue;
        };
        let name: Value = serde_json::from_str(&text)?;
        let name = name["full_id"].as_str().ok_or("a measurement has no name")?;
        let (what, who) = name.split_once('/').ok_or("a measurement has another name")?;
        let of = if what == "hostile" { HOSTILE } else { FRAMES };
        times.insert((what.to_owned(), who.to_owned()), fastest(&entry)? / of);
    }
    Ok(times)
}

/// The fastest sample of a measurement, in nanoseconds.
fn fastest(folder: &Path) -> Result<f64> {
    let sample: Value = serde_json::from_str(&fs::read_to_string(folder.join("new/sample.json"))?)?;
    let numbers = |name: &str| -> Option<Vec<f64>> { sample[name].as_array()?.iter().map(Value::as_f64).collect() };
    let (iters, times) = numbers("iters")
        .zip(numbers("times"))
        .ok_or("a measurement has no samples")?;
    let fastest = times
        .iter()
        .zip(&iters)
        .map(|(time, iters)| time / iters)
        .reduce(f64::min);
    Ok(fastest.ok_or("a measurement has no samples")?)
}

/// The times of all, and how many times as fast the arms are as each peer.
fn print(times: &Times, with_peers: bool) {
    let arms = ["ling", "xarm", "alpha1"];
    println!(
        "{:32}{:>12}{:>44}",
        "ns a frame, or a hostile byte",
        "",
        if with_peers { "so many times as fast are" } else { "" }
    );
    println!("{:32}{:>12}{:>12}{:>12}{:>12}", "", "ns", "Ling", "xArm", "Alpha1");
    for ((what, who), nanos) in times {
        print!("{:32}{nanos:>12.2}", format!("{what}, {who}"));
        if what != "hostile" && !arms.contains(&&**who) {
            for arm in arms {
                match times.get(&(what.clone(), arm.to_owned())) {
                    Some(ours) => print!("{:>12.2}", nanos / ours),
                    None => print!("{:>12}", "-"),
                }
            }
        }
        println!();
    }
}

/// A ratio, and its limit.
struct Goal {
    what: String,
    value: f64,
    limit: f64,
    /// Whether the limit is the most that it may be, or the least.
    most: bool,
}

impl std::fmt::Display for Goal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self {
            what,
            value,
            limit,
            most,
        } = self;
        let reached = if *most { value <= limit } else { value >= limit };
        let sign = if *most { '≤' } else { '≥' };
        let missed = if reached { "" } else { "  goal missed" };
        write!(f, "{what:72}{value:>8.2}  goal {sign} {limit}{missed}")
    }
}

/// The ratios that have a goal, as far as they were measured.
fn goals(times: &Times) -> Vec<Goal> {
    let time = |what: &str, who: &str| times.get(&(what.to_owned(), who.to_owned())).copied();
    let mut goals = Vec::new();
    let mut goal = |what: String, ratio: Option<(f64, f64)>, limit, most| {
        if let Some((of, to)) = ratio {
            goals.push(Goal {
                what,
                value: of / to,
                limit,
                most,
            });
        }
    };
    for (what, how, limit) in [("chunks", "chunks of 64 bytes", 2.5), ("bytes", "byte by byte", 1.0)] {
        let ratio = time(what, "mavlink").zip(time(what, "ling"));
        goal(
            format!("{how}: Ling's frames a second to mavlink's"),
            ratio,
            limit,
            false,
        );
    }
    for (arm, _) in REPLIES {
        let ratio = time("frames", arm).zip(time("checksum", arm));
        goal(format!("{arm}: decoding to its checksum alone"), ratio, 2.0, true);
    }
    for (arm, reply) in REPLIES {
        for ((_, who), nanos) in times
            .iter()
            .filter(|((what, who), _)| what == "hostile" && who.starts_with(arm))
        {
            let ratio = time("chunks", arm).map(|frame| (*nanos, frame / reply));
            goal(format!("{who}: a hostile byte to one of a reply"), ratio, 6.0, true);
        }
    }
    goals
}
