//! The tables of the page.

use std::fs;
use std::path::Path;

use armwire_host_tests::image::facts;
use armwire_host_tests::page::filled;
use serde_json::Value;

use crate::counts::{CASES, PROTOCOLS, Protocol};
use crate::latency::WAYS;
use crate::scenes::{Figures, Scene};
use crate::{Measured, Result};

/// Crates of `host-tests/benches`, the timed operations of each, and the number of frames per operation.
const CRATES: [&str; 7] = ["Ling", "xArm", "Alpha1", "mavlink", "ublox", "rmodbus", "postcard"];
const TIMED: [&str; 3] = ["chunks", "bytes", "encode"];
const FRAMES: f64 = 1000.0;

/// A row: its name, and its cells.
type Row = (String, Vec<String>);

/// Tables by their names on the page.
pub(crate) type Tables = Vec<(&'static str, String)>;

/// Tables of the measurements on boards, and on the core alone.
pub(crate) fn tables(boards: &[Measured], protocols: &[Protocol]) -> Tables {
    let row = |name: &str, cell: &dyn Fn(&Measured) -> String| (name.to_owned(), boards.iter().map(cell).collect());
    let names: Vec<String> = boards.iter().map(|measured| measured.board.name()).collect();
    let way = |nth: usize| {
        row(WAYS[nth], &|measured| {
            let [median, rare, worst] = [0.5, 0.999, 1.0].map(|share| measured.latency.ways[nth].quantile(share));
            format!("{median:.1} / {rare:.1} / {worst:.1} µs")
        })
    };
    let quiet = |nth: usize| {
        row(&format!("{}, adapter quiet", WAYS[nth]), &|measured| {
            let (time, board) = (measured.quiet[nth].0, &measured.board);
            let instructions = time * (facts(board.chip).core_hz / 1_000_000) / 1_000;
            let micros = format!("{:.1} µs", time as f64 / 1e3);
            if board.exact {
                micros
            } else {
                format!("{micros}, {instructions} instructions")
            }
        })
    };
    let stamps = row("stamps off by more than 1 µs / known to be late / worst", &|measured| {
        let latency = &measured.latency;
        let (wrong, known_late, worst) = (
            latency.wrong_stamps(),
            latency.known_late(),
            latency.stamps.iter().max(),
        );
        format!(
            "{wrong:.2} % / {known_late:.2} % / {} µs",
            worst.copied().unwrap_or_default()
        )
    });
    let latency = (0..4).map(way).chain((0..2).map(quiet)).chain([stamps]).collect();

    let scenes = |cell: &dyn Fn(&Figures) -> String| -> Vec<Row> {
        let of = |nth: usize| move |measured: &Measured| measured.scenes[nth].as_ref().map_or("-".to_owned(), cell);
        Scene::ALL
            .iter()
            .enumerate()
            .map(|(nth, scene)| row(&scene.name(), &of(nth)))
            .collect()
    };
    let load = scenes(&|figures| format!("{:.1} %", figures.load));
    let mut rates = scenes(&|figures| match &figures.rate {
        Some(rate) => format!("{:.0} /s, {:.1} %", rate.achieved, rate.percent),
        None => "-".to_owned(),
    });
    rates.retain(|(_, cells)| cells.iter().any(|cell| cell != "-"));

    let images = vec![
        row("flash", &|measured| format!("{} B", measured.board.image.flash_bytes)),
        row("flash left", &|measured| {
            let left = measured.board.image.flash_left();
            left.map_or("-".to_owned(), |left| format!("{left} B"))
        }),
        row("RAM for variables", &|measured| {
            format!("{} B", measured.board.image.ram_bytes)
        }),
        row("stack used", &|measured| {
            format!("{} B, {:.0} %", measured.latency.stack, measured.stack_percent())
        }),
        row("virtual board, by real time", &|measured| {
            let speeds = measured.scenes.iter().flatten().map(|figures| figures.speed);
            let least = speeds.clone().fold(f64::MAX, f64::min);
            format!("{least:.1} to {:.0} ×", speeds.fold(0.0, f64::max))
        }),
    ];
    vec![
        ("latency", table("median / 99.9 % / worst", &names, latency)),
        ("load", table("load of the core", &names, load)),
        (
            "rates",
            table("throughput per second, share of the wire limit", &names, rates),
        ),
        ("images", table("image", &names, images)),
        ("protocols", self::protocols(protocols)),
    ]
}

fn protocols(protocols: &[Protocol]) -> String {
    let row = |name: &str, cell: &dyn Fn(&Protocol) -> String| (name.to_owned(), protocols.iter().map(cell).collect());
    let case = |(nth, name): (usize, &&str)| row(name, &|protocol| protocol.cases[nth].instructions.to_string());
    let mut rows: Vec<Row> = CASES.iter().enumerate().map(case).collect();
    let most = |protocol: &Protocol| protocol.cases.iter().map(|case| case.stack).max();
    rows.push(row("stack at most", &|protocol| {
        format!("{} B", most(protocol).unwrap_or_default())
    }));
    rows.push(row("RAM of a decoder / a client", &|protocol| {
        format!("{} / {} B", protocol.cases[0].state, protocol.cases[3].state)
    }));
    rows.push(row("flash of decoder and client", &|protocol| {
        format!("{} B", protocol.flash)
    }));
    table("instructions", &PROTOCOLS.map(|(name, ..)| name.to_owned()), rows)
}

/// The times of the crates, from criterion's results in the target directory.
pub(crate) fn crates(target: &Path) -> Result<String> {
    let time = |operation: &str, name: &str| -> Result<f64> {
        let file = target.join(format!("criterion/{operation}_{name}/new/estimates.json"));
        let text = fs::read_to_string(&file).map_err(|error| format!("{}: {error}", file.display()))?;
        let estimates: Value = serde_json::from_str(&text)?;
        Ok(estimates["median"]["point_estimate"].as_f64().ok_or("no median")? / FRAMES)
    };
    let row = |name: &&str| {
        let cell = |operation: &&str| {
            let (time, ling) = (time(operation, name)?, time(operation, CRATES[0])?);
            Ok(format!("{time:.1} ns, {:.2} ×", time / ling))
        };
        Ok(((*name).to_owned(), TIMED.iter().map(cell).collect::<Result<_>>()?))
    };
    let columns = ["decoded, chunks of 64 bytes", "decoded byte by byte", "encoded"].map(str::to_owned);
    Ok(table(
        "a frame",
        &columns,
        CRATES.iter().map(row).collect::<Result<_>>()?,
    ))
}

fn table(head: &str, columns: &[String], rows: Vec<Row>) -> String {
    let mut text = format!(
        "| {head} | {} |\n|---{}|\n",
        columns.join(" | "),
        "|---:".repeat(columns.len())
    );
    for (name, cells) in rows {
        text += &format!("| {name} | {} |\n", cells.join(" | "));
    }
    text
}

/// Puts the tables between their marks on the page.
pub(crate) fn write(page: &Path, tables: &Tables) -> Result<()> {
    let mut text = fs::read_to_string(page).map_err(|error| format!("{}: {error}", page.display()))?;
    for (name, table) in tables {
        text = filled(&text, name, table).ok_or_else(|| format!("{} has no marks for {name}", page.display()))?;
    }
    Ok(fs::write(page, text)?)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn numbers_are_aligned_to_the_right() {
        let table = table("", &["x".to_owned()], vec![("a".to_owned(), vec!["1".to_owned()])]);
        assert_eq!(table, "|  | x |\n|---|---:|\n| a | 1 |\n");
    }
}
