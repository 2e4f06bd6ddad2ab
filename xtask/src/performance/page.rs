//! What was measured, as tables and plots for the page.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::fmt::{Display, Write as _};

use super::plot::{Axis, Goal, Series, bars, lines};
use super::records::{Load, Records};
use super::{FULL, LATENCY_GOAL, LOAD_GOAL, RATE_GOAL, SPEED_GOAL, WAYS};

/// A crate that has less of the instructions or of the code, in percent, is not shown by itself.
const SHOWN: f64 = 1.0;

/// How latency is distributed where an instruction takes one cycle.
pub(super) fn latency(records: &Records) -> String {
    let mut table = "| Way | Passages | Had to wait before | Median | 99 % | 99.9 % | Worst | Goal |\n".to_owned();
    table += "|---|---:|---:|---:|---:|---:|---:|---:|\n";
    for (way, name, _) in WAYS {
        let spans = records.spans(FULL, way);
        let waited = 100.0 * spans.waited as f64 / spans.count.max(1) as f64;
        let at = |share| spans.quantile(share);
        let _ = writeln!(
            table,
            "| {name} | {} | {waited:.0} % | {:.1} µs | {:.1} µs | {:.1} µs | {:.1} µs | {LATENCY_GOAL} µs |",
            spans.count,
            at(0.5),
            at(0.99),
            at(0.999),
            spans.worst()
        );
    }
    table
}

/// The first two lines of a table with a column for each cost.
fn head_of_costs(costs: &[u32]) -> String {
    head("Cycles per instruction", costs.iter().map(|cost| factor(*cost)))
}

/// The first two lines of a table: what its rows are, and a column of numbers for each of these.
fn head(rows: &str, columns: impl Iterator<Item = impl Display>) -> String {
    let (mut head, mut rule) = (format!("| {rows} |"), "|---|".to_owned());
    for column in columns {
        let _ = write!(head, " {column} |");
        rule += "---:|";
    }
    format!("{head}\n{rule}\n")
}

/// How latency depends on what an instruction takes: the median and the worst.
pub(super) fn sweep(records: &Records) -> String {
    let costs = costs(records);
    let mut table = head_of_costs(&costs);
    for (way, name, _) in WAYS {
        let _ = write!(table, "| {name}: median / worst |");
        for cost in &costs {
            let spans = records.spans(*cost, way);
            let _ = write!(table, " {:.0} / {:.0} µs |", spans.quantile(0.5), spans.worst());
        }
        table.push('\n');
    }
    table
}

/// How late stamps are.
pub(super) fn stamps(records: &Records) -> String {
    let costs = costs(records);
    let (mut right, mut latest) = ("| a microsecond late at most |".to_owned(), "| the latest |".to_owned());
    for cost in &costs {
        let (exact, worst) = records.stamps(*cost);
        let _ = write!(right, " {:.3} % |", 100.0 * exact);
        let _ = write!(latest, " {worst} µs |");
    }
    format!("{}{right}\n{latest}\n", head_of_costs(&costs))
}

/// How much of its time the core works.
pub(super) fn load(records: &Records) -> String {
    let costs = costs(records);
    let mut table = head_of_costs(&costs);
    for scene in records.loads.iter().filter(|load| load.cost == FULL) {
        let _ = write!(table, "| {} |", scene_name(&scene.scene));
        for cost in &costs {
            let same = |load: &&Load| load.cost == *cost && load.scene == scene.scene;
            let share = records.loads.iter().find(same).map_or(0.0, share);
            let _ = write!(table, " {:.1} % |", 100.0 * share);
        }
        table.push('\n');
    }
    table
}

/// Which crates the instructions belong to, from the one with the most in the first scene on.
pub(super) fn profile(records: &Records) -> String {
    let mut scenes: Vec<&str> = records.profiles.iter().map(|row| row.scene.as_str()).collect();
    scenes.dedup();
    let share = |scene: &str, package: &str| {
        let of_scene = records.profiles.iter().filter(|row| row.scene == scene);
        let (ours, all) = of_scene.fold((0, 0), |(ours, all), row| {
            (
                ours + if row.package == package { row.count } else { 0 },
                all + row.count,
            )
        });
        100.0 * ours as f64 / all.max(1) as f64
    };
    let first = scenes.first().copied().unwrap_or_default();
    let packages: BTreeSet<&str> = records.profiles.iter().map(|row| row.package.as_str()).collect();
    let mut packages: Vec<&str> = packages.into_iter().collect();
    packages.sort_by(|a, b| share(first, b).total_cmp(&share(first, a)));
    let mut table = head("Crate", scenes.iter().map(|scene| scene_name(scene)));
    let (shown, others): (Vec<&str>, _) = packages
        .into_iter()
        .partition(|package| scenes.iter().any(|scene| share(scene, package) >= SHOWN));
    for package in shown {
        let _ = write!(table, "| {package} |");
        for scene in &scenes {
            let _ = write!(table, " {:.1} % |", share(scene, package));
        }
        table.push('\n');
    }
    table += "| all others |";
    for scene in &scenes {
        let rest: f64 = others.iter().map(|package| share(scene, package)).sum();
        let _ = write!(table, " {rest:.1} % |");
    }
    table + "\n"
}

/// How much of the image's code is whose, from the crate with the most on.
pub(super) fn code(records: &Records) -> String {
    let mut crates: Vec<_> = records.code.iter().collect();
    crates.sort_by_key(|code| Reverse(code.bytes));
    let all: u64 = crates.iter().map(|code| code.bytes).sum();
    let share = |bytes: u64| 100.0 * bytes as f64 / all.max(1) as f64;
    let (shown, others): (Vec<_>, Vec<_>) = crates.into_iter().partition(|code| share(code.bytes) >= SHOWN);
    let mut table = head("Crate", ["Code", "Share"].iter());
    for code in shown {
        let _ = writeln!(
            table,
            "| {} | {} B | {:.1} % |",
            code.package,
            code.bytes,
            share(code.bytes)
        );
    }
    let others = others.iter().map(|code| code.bytes).sum();
    let _ = writeln!(table, "| all others | {others} B | {:.1} % |", share(others));
    let _ = writeln!(table, "| **all** | {all} B | |");
    table
}

/// What passes, beside what the wires allow.
pub(super) fn rates(records: &Records) -> String {
    let mut table = "| What | Achieved | The wires allow | Share | Goal |\n|---|---:|---:|---:|---:|\n".to_owned();
    for rate in &records.rates {
        let (name, unit) = rate_name(&rate.what);
        let _ = writeln!(
            table,
            "| {name} | {:.0} {unit} | {:.0} {unit} | {:.1} % | {:.0} % |",
            rate.achieved,
            rate.limit,
            100.0 * rate.achieved / rate.limit,
            100.0 * RATE_GOAL
        );
    }
    table
}

/// How fast the virtual board is.
pub(super) fn speed(records: &Records) -> String {
    let mut table = "| Scene | Virtual time ÷ ours | Goal |\n|---|---:|---:|\n".to_owned();
    for load in records.loads.iter().filter(|load| load.cost == FULL) {
        let goal = SPEED_GOAL.iter().find(|(scene, _)| *scene == load.scene);
        let goal = goal.map_or("none".to_owned(), |(_, goal)| format!("{goal} ×"));
        let _ = writeln!(
            table,
            "| {} | {:.2} × | {goal} |",
            scene_name(&load.scene),
            load.time / load.real
        );
    }
    table
}

/// The plots, each with the name of its file.
pub(super) fn plots(records: &Records) -> [(&'static str, String); 4] {
    [
        ("latency.svg", latency_plot(records)),
        ("sweep.svg", sweep_plot(records)),
        ("load.svg", load_plot(records)),
        ("rates.svg", rates_plot(records)),
    ]
}

fn goal(name: String, at: f64, upright: bool) -> Goal {
    Goal { name, at, upright }
}

/// Which share takes longer, over how long, with a logarithm: the rare ones count.
fn latency_plot(records: &Records) -> String {
    let series = WAYS.map(|(way, name, _)| {
        let spans = records.spans(FULL, way);
        let mut points = Vec::new();
        let mut left = spans.count;
        for (nanos, count) in spans.spans {
            let micros = nanos as f64 / 1e3;
            points.push((micros, (left as f64 / spans.count as f64).log10()));
            left -= count;
            // Steps: a tenth of a microsecond more is not seen.
            if left > 0 {
                points.push((micros, (left as f64 / spans.count as f64).log10()));
            }
        }
        Series {
            name,
            points: thinned(points),
            marked: false,
        }
    });
    let worst = WAYS
        .iter()
        .map(|(way, ..)| records.spans(FULL, way).worst())
        .fold(LATENCY_GOAL, f64::max);
    let x = steps(
        "Time that the adapter adds, in µs",
        (worst / 10.0).ceil() * 10.0,
        10.0,
        "",
    );
    let percents = ["100 %", "10 %", "1 %", "0.1 %", "0.01 %", "0.001 %"];
    let ticks = percents
        .iter()
        .enumerate()
        .map(|(nth, label)| (-(nth as f64), (*label).to_owned()));
    let y = Axis {
        name: "Passages that take at least so long",
        from: -5.0,
        to: 0.0,
        ticks: ticks.collect(),
    };
    let goal = goal(format!("goal {LATENCY_GOAL} µs"), LATENCY_GOAL, true);
    lines(
        "What the adapter adds, everything busy, a cycle per instruction",
        &x,
        &y,
        &goal,
        &series,
    )
}

/// The points but those that lie within a tenth of a microsecond and a hundredth of a decade of the last that is kept.
fn thinned(points: Vec<(f64, f64)>) -> Vec<(f64, f64)> {
    let mut kept: Vec<(f64, f64)> = Vec::new();
    let last = points.last().copied();
    for point in points {
        let near = kept
            .last()
            .is_some_and(|kept| point.0 - kept.0 < 0.1 && kept.1 - point.1 < 0.01);
        if !near {
            kept.push(point);
        }
    }
    kept.extend(last.filter(|last| kept.last() != Some(last)));
    kept
}

fn sweep_plot(records: &Records) -> String {
    let costs = costs(records);
    let at = |way: &str, cost: u32| records.spans(cost, way).worst();
    let series = WAYS.map(|(way, name, _)| Series {
        name,
        points: costs
            .iter()
            .map(|&cost| (f64::from(cost) / 100.0, at(way, cost)))
            .collect(),
        marked: true,
    });
    let worst = series
        .iter()
        .flat_map(|series| &series.points)
        .map(|point| point.1)
        .fold(0.0, f64::max);
    let x = Axis {
        name: "Cycles per instruction",
        from: 0.9,
        to: costs.iter().max().map_or(1.0, |&cost| f64::from(cost) / 100.0) + 0.1,
        ticks: costs
            .iter()
            .map(|&cost| (f64::from(cost) / 100.0, factor(cost)))
            .collect(),
    };
    let y = steps("Worst time added, in µs", (worst / 100.0).ceil() * 100.0, 100.0, "");
    let goal = goal(format!("goal {LATENCY_GOAL} µs"), LATENCY_GOAL, false);
    lines("The worst case, if an instruction takes longer", &x, &y, &goal, &series)
}

fn load_plot(records: &Records) -> String {
    let ours = records.loads.iter().filter(|load| load.cost == FULL);
    let rows: Vec<_> = ours
        .map(|load| {
            let percent = 100.0 * share(load);
            (scene_name(&load.scene), percent, format!("{percent:.1} %"))
        })
        .collect();
    let axis = steps(
        "Time in which the core works, a cycle per instruction",
        100.0,
        20.0,
        " %",
    );
    let goal = goal(format!("goal {:.0} %", 100.0 * LOAD_GOAL), 100.0 * LOAD_GOAL, true);
    bars("Load of the processor", &axis, &goal, &rows)
}

fn rates_plot(records: &Records) -> String {
    let rows: Vec<_> = records
        .rates
        .iter()
        .map(|rate| {
            let percent = 100.0 * rate.achieved / rate.limit;
            (rate_name(&rate.what).0, percent, format!("{percent:.1} %"))
        })
        .collect();
    let axis = steps("Share of what the wires allow", 100.0, 20.0, " %");
    let goal = goal(format!("goal {:.0} %", 100.0 * RATE_GOAL), 100.0 * RATE_GOAL, true);
    bars("Rates, beside what the wires allow", &axis, &goal, &rows)
}

/// An axis from 0, labelled every `step`.
fn steps<'a>(name: &'a str, to: f64, step: f64, unit: &str) -> Axis<'a> {
    let count = (to / step).round() as u32;
    let ticks = (0..=count).map(|nth| {
        let value = f64::from(nth) * step;
        (value, format!("{value:.0}{unit}"))
    });
    Axis {
        name,
        from: 0.0,
        to,
        ticks: ticks.collect(),
    }
}

/// What an instruction took in the runs, in percent of a cycle.
fn costs(records: &Records) -> Vec<u32> {
    let mut costs: Vec<u32> = records.loads.iter().map(|load| load.cost).collect();
    costs.sort_unstable();
    costs.dedup();
    costs
}

fn factor(cost: u32) -> String {
    format!("{}", f64::from(cost) / 100.0)
}

/// The part of its time in which the core works.
pub(super) fn share(load: &Load) -> f64 {
    load.busy / load.time
}

fn scene_name(scene: &str) -> String {
    match scene {
        "idle" => "nobody says anything".to_owned(),
        "polled-200" => "poll and telemetry at 200 Hz".to_owned(),
        "polled-fastest" => "poll as fast as the wire allows".to_owned(),
        "saturated-with-can" => "1 Mbaud both ways, CAN full".to_owned(),
        other => match other.strip_prefix("saturated-") {
            Some(baud) => format!("{} both ways", baud_name(baud)),
            None => other.to_owned(),
        },
    }
}

/// The name of a rate, and its unit.
pub(super) fn rate_name(what: &str) -> (String, &'static str) {
    let polls = what
        .strip_prefix("polls-after-")
        .and_then(|rest| rest.strip_suffix("-us"));
    match (polls, what.strip_prefix("usb-")) {
        (Some(micros), _) => (format!("polls, arm thinks for {micros} µs"), "/s"),
        (_, Some(baud)) => (format!("USB, each way, at {}", baud_name(baud)), "B/s"),
        _ if what == "can-classic" => ("frames by ISO-TP, classic CAN".to_owned(), "B/s"),
        _ if what == "can-fd" => ("all of a 1 Mbaud line by CAN FD".to_owned(), "B/s"),
        _ => (what.to_owned(), "/s"),
    }
}

fn baud_name(baud: &str) -> String {
    match baud.strip_suffix("000000") {
        Some(mega) => format!("{mega} Mbaud"),
        None => format!("{baud} baud"),
    }
}
