//! Measures what `cargo xtask performance` shows.

use std::collections::BTreeMap;
use std::fmt::Write as _;
use std::num::NonZeroU32;
use std::path::PathBuf;
use std::process::ExitCode;
use std::{env, fs, thread};

use armwire::Micros;
use armwire_host_tests::image::performance::latency::{self, Run};
use armwire_host_tests::image::performance::load::{self, SCENES, Scene};
use armwire_host_tests::image::performance::profile::{by_owner, by_package, code};
use armwire_host_tests::image::performance::rates::{self, Rate};
use armwire_host_tests::image::{MEGABAUD, path};
use armwire_virtual_board::Nanos;

const USAGE: &str = "\
performance --out FOLDER [--frames N] [--costs PERCENT,...]

--out FOLDER           where the records go
--frames N             answers of the arm in which latency is measured, 100000 without this option; a tenth of it where
                       an instruction takes more than a cycle
--costs PERCENT,...    what an instruction takes, in percent of a cycle, 100,150,200,300 without this option";

/// How long each scene is played.
const SPAN: Nanos = Nanos::from_millis(1_000);

/// How long a scene is played for its profile.
const PROFILED: Nanos = Nanos::from_millis(100);

struct Options {
    out: PathBuf,
    frames: usize,
    costs: Vec<NonZeroU32>,
}

fn options() -> Result<Options, String> {
    let mut out = None;
    let mut frames = 100_000;
    let mut costs = "100,150,200,300".to_owned();
    let mut args = env::args().skip(1);
    while let Some(arg) = args.next() {
        let value = args.next().ok_or_else(|| format!("`{arg}` needs a value\n\n{USAGE}"))?;
        match &*arg {
            "--out" => out = Some(value.into()),
            "--frames" => frames = value.parse().map_err(|error| format!("`{arg} {value}`: {error}"))?,
            "--costs" => costs = value,
            _ => return Err(format!("unknown option `{arg}`\n\n{USAGE}")),
        }
    }
    let costs: Result<_, _> = costs.split(',').map(str::parse).collect();
    Ok(Options {
        out: out.ok_or(USAGE)?,
        frames,
        costs: costs.map_err(|error| format!("`--costs`: {error}"))?,
    })
}

fn main() -> ExitCode {
    match options().and_then(|options| measure(&options)) {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(options: &Options) -> Result<(), String> {
    let full = NonZeroU32::new(100);
    let write = |name: &str, text: String| {
        let file = options.out.join(name);
        fs::write(&file, text).map_err(|error| format!("{}: {error}", file.display()))
    };
    fs::create_dir_all(&options.out).map_err(|error| format!("{}: {error}", options.out.display()))?;

    // First what takes our time to measure, while nothing else runs.
    write("load.csv", loads(&options.costs))?;
    write("rates.csv", rates())?;
    write("profile.csv", profiles()?)?;
    write("code.csv", sizes()?)?;
    let runs: Vec<Run> = thread::scope(|scope| {
        let frames = |cost: NonZeroU32| match Some(cost) == full {
            true => options.frames,
            false => options.frames / 10,
        };
        let runs: Vec<_> = options
            .costs
            .iter()
            .map(|&cost| scope.spawn(move || latency::measure(cost, frames(cost))))
            .collect();
        runs.into_iter()
            .map(|run| run.join().map_err(|_| "a run of the latency failed".to_owned()))
            .collect::<Result<_, _>>()
    })?;
    write("latency.csv", latencies(&options.costs, &runs))?;
    write("stamps.csv", stamps(&options.costs, &runs))
}

/// How often each span was measured.
fn latencies(costs: &[NonZeroU32], runs: &[Run]) -> String {
    let mut counts: BTreeMap<_, u32> = BTreeMap::new();
    for (cost, run) in costs.iter().zip(runs) {
        for passage in &run.passages {
            let waited = passage.waited > Nanos(0);
            *counts.entry((*cost, passage.way, waited, passage.added)).or_default() += 1;
        }
    }
    let mut text = "cost_percent,way,waited,added_ns,count\n".to_owned();
    for ((cost, way, waited, added), count) in counts {
        let _ = writeln!(text, "{cost},{},{},{},{count}", way.name(), u8::from(waited), added.0);
    }
    text
}

/// How often stamps were how late.
fn stamps(costs: &[NonZeroU32], runs: &[Run]) -> String {
    let mut counts: BTreeMap<_, u32> = BTreeMap::new();
    for (cost, run) in costs.iter().zip(runs) {
        for late in &run.stamps {
            *counts.entry((*cost, *late)).or_default() += 1;
        }
    }
    let mut text = "cost_percent,late_us,count\n".to_owned();
    for ((cost, late), count) in counts {
        let _ = writeln!(text, "{cost},{},{count}", late.0);
    }
    text
}

/// What each scene took.
fn loads(costs: &[NonZeroU32]) -> String {
    let mut text = "cost_percent,scene,virtual_ns,busy_ns,real_ns\n".to_owned();
    for &cost in costs {
        for scene in SCENES {
            let run = load::measure(cost, scene, SPAN);
            let real = run.took.as_nanos();
            let _ = writeln!(text, "{cost},{},{},{},{real}", scene.name(), run.time.0, run.busy.0);
        }
    }
    text
}

/// How many bytes of code each crate has.
fn sizes() -> Result<String, String> {
    let image = path();
    let owners = code(&image).and_then(|code| by_owner(&image, &code));
    let owners = owners.map_err(|error| format!("the image's code: {error}"))?;
    let mut text = "package,bytes\n".to_owned();
    for (package, bytes) in by_package(&owners) {
        let _ = writeln!(text, "{package},{bytes}");
    }
    Ok(text)
}

/// How many instructions of each crate ran, by scene.
fn profiles() -> Result<String, String> {
    let mut text = "scene,package,instructions\n".to_owned();
    for scene in [Scene::Saturated(MEGABAUD), Scene::SaturatedWithCan, Scene::Polled(200)] {
        let profile = load::profile(scene, PROFILED);
        let owners = by_owner(&path(), &profile).map_err(|error| format!("the profile: {error}"))?;
        for (package, count) in by_package(&owners) {
            let _ = writeln!(text, "{},{package},{count}", scene.name());
        }
    }
    Ok(text)
}

/// What passed.
fn rates() -> String {
    let mut text = "what,achieved_per_second,limit_per_second\n".to_owned();
    let mut row = |what: &str, rate: Rate| {
        let _ = writeln!(text, "{what},{:.3},{:.3}", rate.achieved, rate.limit);
    };
    for turnaround in [0, 100, 500] {
        row(
            &format!("polls-after-{turnaround}-us"),
            rates::polls(Micros(turnaround)),
        );
    }
    for baud in [115_200, MEGABAUD, 2 * MEGABAUD] {
        row(&format!("usb-{baud}"), rates::usb(baud, baud as usize / 10));
    }
    row("can-classic", rates::classic_can(SPAN));
    row("can-fd", rates::can_fd(SPAN));
    text
}
