//! Measures the figures of `docs/performance.md`. `cargo xtask performance` builds the images and programs for it, and runs it.
//!
//! `performance TARGET ANSWERS [DOCS]`: the target directory with the images and programs, the number of the arm's
//! answers in the measurement of latency, and the folder of the page, to write it.

mod board;
mod counts;
mod elf;
mod latency;
mod measured;
mod page;
mod plots;
mod result;
mod scenes;

use std::path::Path;
use std::process::ExitCode;
use std::{env, thread};

use armwire_host_tests::image::{MEGABAUD, quiet};
use armwire_sim::ling::{Config, LingArm};
use armwire_virtual_board::Nanos;

use crate::board::Board;
use crate::latency::WAYS;
use crate::measured::Measured;
use crate::result::Result;
use crate::scenes::{Figures, Scene};

/// Number of calls on a quiet adapter.
const CALLS: u64 = 101;
/// The limit of the worst latency, by that of 99.9 %.
const WORST: f64 = 1.5;
/// Maximum percentage of used stack.
const STACK_LIMIT: f64 = 85.0;

fn main() -> ExitCode {
    let args: Vec<String> = env::args().skip(1).collect();
    let measured = match &args[..] {
        [target, answers] => measure(target.as_ref(), answers, None),
        [target, answers, docs] => measure(target.as_ref(), answers, Some(docs.as_ref())),
        _ => Err("usage: performance TARGET ANSWERS [DOCS]".into()),
    };
    match measured {
        Ok(()) => ExitCode::SUCCESS,
        Err(error) => {
            eprintln!("error: {error}");
            ExitCode::FAILURE
        }
    }
}

fn measure(target: &Path, answers: &str, docs: Option<&Path>) -> Result<()> {
    let protocols = counts::measure(&target.join("performance"))?;
    let boards = boards(target, answers.parse()?)?;
    let mut tables = page::tables(&boards, &protocols);
    if let Some(docs) = docs {
        tables.push(("crates", page::crates(target)?));
        page::write(&docs.join("performance.md"), &tables)?;
        plots::write(&docs.join("performance"), &boards)?;
    }
    for (_, table) in &tables {
        println!("{table}");
    }
    let mut failures = counts::failures(&protocols);
    failures.extend(boards.iter().flat_map(Measured::failures));
    match failures[..] {
        [] => Ok(()),
        _ => Err(failures.join("\n").into()),
    }
}

/// Measures all boards: first the scenes, one after another because of their speed in real time, then the latencies of
/// all boards in parallel.
fn boards(target: &Path, answers: u32) -> Result<Vec<Measured>> {
    let boards = Board::all(target)?;
    let scenes = |board: &Board| Scene::ALL.map(|scene| scenes::measure(board, scene)).into();
    let scenes: Vec<Vec<Option<Figures>>> = boards.iter().map(scenes).collect();
    let measure = |(board, scenes): (Board, _)| Measured {
        latency: latency::measure(&board, answers),
        quiet: calls(&board),
        board,
        scenes,
    };
    thread::scope(|scope| {
        let spawn = |board| scope.spawn(move || measure(board));
        let runs: Vec<_> = boards.into_iter().zip(scenes).map(spawn).collect();
        let run = |run: thread::ScopedJoinHandle<'_, _>| run.join().map_err(|_| "a run of the latency failed".into());
        runs.into_iter().map(run).collect()
    })
}

/// See [`Measured::quiet`].
fn calls(board: &Board) -> [Nanos; 2] {
    let added = board.run(LingArm::new(Config::follower()), MEGABAUD, |board| {
        quiet::call(board, CALLS)
    });
    [added.to_usb.median(), added.to_uart.median()]
}

impl Measured {
    /// The percentage of used stack.
    fn stack_percent(&self) -> f64 {
        let [low, high] = self.board.image.stack();
        100.0 * f64::from(self.latency.stack) / f64::from(high - low)
    }

    /// The figures that exceed their limits.
    fn failures(&self) -> Vec<String> {
        let limits = &self.board.limits;
        let mut figures = vec![
            (
                "percentage of wrong stamps".to_owned(),
                self.latency.wrong_stamps(),
                limits.wrong_stamps,
            ),
            ("percentage of the stack".to_owned(), self.stack_percent(), STACK_LIMIT),
        ];
        for ((way, spans), limit) in WAYS.iter().zip(&self.latency.ways).zip(limits.latency) {
            figures.push((format!("99.9 % of {way}"), spans.quantile(0.999), limit));
            figures.push((format!("worst {way}"), spans.quantile(1.0), WORST * limit));
        }
        for (scene, measured) in Scene::ALL.iter().zip(&self.scenes) {
            let Some(Figures { rate, load, .. }) = measured else {
                continue;
            };
            if *scene == Scene::SATURATED {
                figures.push((format!("load, {}", scene.name()), *load, limits.load));
            }
            if let Some(rate) = rate {
                figures.push((
                    format!("percentage lost, {}", scene.name()),
                    100.0 - rate.percent,
                    limits.lost,
                ));
            }
        }
        // A figure that was not measured is not a number.
        figures.retain(|(_, value, limit)| value.is_nan() || value > limit);
        let failure = |(name, value, limit)| format!("{}: {name}: {value:.2}, the limit is {limit}", self.board.name());
        figures.into_iter().map(failure).collect()
    }
}
