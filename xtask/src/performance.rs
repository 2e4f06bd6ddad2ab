//! `cargo xtask performance`: latency, load and rates of the firmware image, in virtual time, and how long builds and tests
//! take, in ours.

mod others;
mod page;
mod plot;
mod records;
mod times;

use std::ffi::OsString;
use std::fs;
use std::path::Path;

use self::records::Records;
use crate::Result;
use crate::image;
use crate::process;
use crate::workspace;

/// What `--help` prints.
pub(crate) const USAGE: &str = "\
usage: cargo xtask performance [--frames N] [--write] [--again] [--times]

--frames N   measure latency in N answers of the arm, 2000 without this option
--write      measure all that is on the page, for 100000 answers and slower processors too, and write docs/performance.md;
             with what `cargo xtask bench`, `counts` and `size` measured last, if they have been run
--again      measure nothing, but take what was measured last
--times      how long a clean `cargo test` and a warm `cargo demo` take, for the page too; a matter of minutes";

/// The program.
const RUN: &str = "run --package armwire-host-tests --features image --bin performance --";

/// An instruction takes a cycle, in percent.
const FULL: u32 = 100;
/// What else an instruction is made to take, in percent of a cycle.
const COSTS: &str = "100,150,200,300";

/// The ways through the adapter, by their names in the records and on the page; and what none may exceed, in
/// microseconds: a little more than the worst case that is, so that it gets no worse.
const WAYS: [(&str, &str, f64); 4] = [
    ("answer-to-usb", "answer to USB", 45.0),
    ("request-from-usb", "request from USB", 46.0),
    ("answer-to-can", "answer to CAN", 50.0),
    ("request-from-can", "request from CAN", 52.0),
];

/// What the adapter may add, in microseconds: a tenth of the time that an answer with joints takes on the line.
const LATENCY_GOAL: f64 = 21.0;
/// The part of its time that the core may work while the UART is saturated both ways.
const LOAD_GOAL: f64 = 0.15;
/// The part of what the wires allow that must pass.
const RATE_GOAL: f64 = 0.95;
/// How fast the virtual board should be, by scene.
const SPEED_GOAL: [(&str, f64); 2] = [("saturated-with-can", 3.0), ("polled-200", 20.0)];

/// What no image may exceed: where the goals are not reached, a little more than what is, so that it gets no worse.
const LOAD_LIMIT: f64 = 0.2;
/// The part of the stamps that must be right to a microsecond.
const STAMP_LIMIT: f64 = 0.9995;
const SATURATED: &str = "saturated-1000000";
const RATE_LIMIT: f64 = 0.93;

/// Measures, prints the tables, and fails if a limit is exceeded. Nothing of it depends on our time.
///
/// # Errors
///
/// If an option is unknown, the program fails, or a limit is exceeded.
pub(crate) fn run(args: &[OsString]) -> Result {
    let (mut frames, mut write, mut again, mut times) = (None, false, false, false);
    let mut args = args.iter().map(|arg| arg.to_string_lossy());
    while let Some(arg) = args.next() {
        match &*arg {
            "--frames" => frames = Some(args.next().ok_or(USAGE)?.parse::<u32>().map_err(|_| USAGE)?),
            "--write" => write = true,
            "--again" => again = true,
            "--times" => times = true,
            _ => return Err(format!("unknown option `{arg}`\n\n{USAGE}").into()),
        }
    }
    let frames = frames.unwrap_or(if write { 100_000 } else { 2_000 });
    let costs = if write { COSTS.to_owned() } else { FULL.to_string() };
    let folder = workspace::target_dir()?.join("performance");
    if !again {
        measure(frames, &costs, &folder)?;
    }
    let records = Records::read(&folder)?;
    let tables = [
        ("latency", page::latency(&records)),
        ("sweep", page::sweep(&records)),
        ("stamps", page::stamps(&records)),
        ("load", page::load(&records)),
        ("profile", page::profile(&records)),
        ("code", page::code(&records)),
        ("rates", page::rates(&records)),
        ("speed", page::speed(&records)),
    ];
    for (name, table) in &tables {
        println!("{name}\n{table}");
    }
    if write {
        self::write(&tables)?;
        self::write(&others::tables()?)?;
        draw(&records)?;
    }
    if times {
        let table = times::table()?;
        println!("times\n{table}");
        if write {
            self::write(&[("times", table)])?;
        }
    }
    check(&records)
}

/// Builds the image, or takes that which `ARMWIRE_IMAGE` names, and measures it.
fn measure(frames: u32, costs: &str, folder: &Path) -> Result {
    let image = image::for_virtual_board()?;
    let mut cargo = process::cargo();
    cargo.args(RUN.split(' ')).arg("--out").arg(folder);
    cargo.args(["--frames", &frames.to_string(), "--costs", costs]);
    process::run(cargo.env("ARMWIRE_IMAGE", image).current_dir(workspace::root()))
}

/// Puts the tables between their marks on the page.
fn write(tables: &[(&str, String)]) -> Result {
    let page = workspace::root().join("docs/performance.md");
    let mut text = fs::read_to_string(&page).map_err(|error| format!("{}: {error}", page.display()))?;
    for (name, table) in tables {
        let (begin, end) = (format!("<!-- {name}: begin -->\n"), format!("<!-- {name}: end -->\n"));
        let parts = text
            .split_once(&begin)
            .and_then(|(head, rest)| Some((head, rest.split_once(&end)?.1)));
        let (head, tail) = parts.ok_or_else(|| format!("{} has no marks for {name}", page.display()))?;
        text = format!("{head}{begin}\n{table}\n{end}{tail}");
    }
    Ok(fs::write(&page, text)?)
}

/// Draws the plots of the page.
fn draw(records: &Records) -> Result {
    let plots = workspace::root().join("docs/performance");
    fs::create_dir_all(&plots)?;
    for (name, plot) in page::plots(records) {
        fs::write(plots.join(name), plot)?;
    }
    Ok(())
}

/// The ways that take longer than they may, or were not measured.
fn too_slow(records: &Records) -> Vec<String> {
    let failure = |(way, name, limit)| {
        let spans = records.spans(FULL, way);
        let (worst, count) = (spans.worst(), spans.count);
        (count == 0 || worst > limit).then(|| format!("{name}: {worst} µs at worst of {count}, the limit is {limit}"))
    };
    WAYS.into_iter().filter_map(failure).collect()
}

/// That no limit is exceeded.
fn check(records: &Records) -> Result {
    let mut failures = too_slow(records);
    let (exact, worst) = records.stamps(FULL);
    if exact < STAMP_LIMIT {
        failures.push(format!(
            "{exact:.4} of the stamps are a microsecond late at most, the latest {worst} µs; it must be {STAMP_LIMIT}"
        ));
    }
    let saturated = records
        .loads
        .iter()
        .find(|load| load.cost == FULL && load.scene == SATURATED);
    let load = page::share(saturated.ok_or("no load was measured")?);
    if load > LOAD_LIMIT {
        failures.push(format!(
            "load {load:.3} while the UART is saturated, the limit is {LOAD_LIMIT}"
        ));
    }
    for rate in &records.rates {
        let (name, _) = page::rate_name(&rate.what);
        let share = rate.achieved / rate.limit;
        if share < RATE_LIMIT {
            failures.push(format!(
                "{name}: {share:.4} of what the wires allow, it must be {RATE_LIMIT}"
            ));
        }
    }
    match failures[..] {
        [] => Ok(()),
        _ => Err(failures.join("\n").into()),
    }
}

#[cfg(test)]
mod tests {
    use super::records::Latency;
    use super::*;

    #[test]
    fn each_way_has_its_own_limit_and_must_be_measured() {
        let passage = |way: &str, micros: f64| Latency {
            cost: FULL,
            way: way.to_owned(),
            waited: false,
            nanos: (micros * 1e3) as u64,
            count: 1,
        };
        let mut records = Records {
            latencies: WAYS.map(|(way, _, limit)| passage(way, limit)).into(),
            stamps: Vec::new(),
            loads: Vec::new(),
            rates: Vec::new(),
            profiles: Vec::new(),
            code: Vec::new(),
        };
        assert_eq!(too_slow(&records), [""; 0]);
        records.latencies.push(passage("answer-to-usb", 45.1));
        records.latencies.retain(|row| row.way != "request-from-can");
        assert_eq!(
            too_slow(&records),
            [
                "answer to USB: 45.1 µs at worst of 2, the limit is 45",
                "request from CAN: 0 µs at worst of 0, the limit is 52"
            ]
        );
    }
}
