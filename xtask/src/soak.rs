//! `cargo xtask soak`: checks that take hours, for rare faults. `cargo ci` has the checks of a change.

use anyhow::Result;
use clap::{Args, ValueEnum};

use crate::board::Board;
use crate::cargo::cargo;
use crate::process;
use crate::steps::Steps;
use crate::{campaign, dist, features, fuzz, image, linker_inputs, mutants, packages, pico};

#[derive(Args)]
pub(crate) struct Options {
    /// The parts to run, by default all
    parts: Vec<Part>,
}

/// A part, in the order in which they run.
#[derive(Clone, Copy, ValueEnum)]
enum Part {
    /// Decoders and an independent reference on 2.1 million streams
    Streams,
    /// A million random runs of the adapter, its hosts and an arm
    Adapter,
    /// Stops and arrivals of 10 000 arms with weight
    Plants,
    /// A thousand losses of a port, each in another moment of a call
    Ports,
    /// A change of each file that the linker reads for an image
    Linker,
    /// Clippy and tests with every set of features
    Features,
    /// The crates' tests from their packages, and a release, used without Rust, and built twice
    Release,
    /// Each fuzz target for 30 minutes, with a new seed
    Fuzz,
    /// 10 000 runs of the fault campaign
    Campaign,
    /// Both firmware images: ten million frames, ten minutes of teleoperation, and 24 hours of virtual time
    Endurance,
    /// The image of the Pico: an hour of polls, which takes as long on the emulated chip
    Pico,
    /// Mutants, which tests must detect
    Mutants,
}

/// Runs the parts.
///
/// # Errors
///
/// The first part that fails.
pub(crate) fn run(options: &Options) -> Result<()> {
    let parts = match &*options.parts {
        [] => Part::value_variants(),
        parts => parts,
    };
    let mut steps = Steps::default();
    for part in parts {
        let value = part.to_possible_value().expect("no part is hidden");
        steps.step(value.get_name(), || part.run())?;
    }
    steps.finish();
    Ok(())
}

impl Part {
    fn run(self) -> Result<()> {
        let test = "test --release --package armwire-host-tests --test";
        match self {
            // For each of the seven lines.
            Self::Streams => process::run(cargo(test).arg("reference").env("ARMWIRE_STREAMS", "300000")),
            Self::Adapter => process::run(cargo(test).arg("adapter_runs").env("ARMWIRE_RUNS", "1000000")),
            Self::Plants => process::run(cargo(test).arg("stop_with_weight").env("ARMWIRE_PLANTS", "10000")),
            Self::Ports => process::run(
                cargo("test --release --package armwire-host --test lost_port").env("ARMWIRE_RUNS", "1000"),
            ),
            Self::Linker => linker_inputs::change_each(),
            Self::Features => features::every_set(),
            Self::Release => {
                packages::check(packages::Tests::Run)?;
                dist::run_all(&dist::Options::CHECK)
            }
            Self::Fuzz => fuzz::run(&fuzz::Options::new(1800, 0)),
            Self::Campaign => campaign::run(&campaign::Options::runs(10_000)),
            Self::Endurance => endurance(),
            Self::Pico => pico::test(&pico::Options::HOUR),
            Self::Mutants => mutants::run(&mutants::Options::ALL),
        }
    }
}

fn endurance() -> Result<()> {
    for board in Board::VIRTUAL {
        let image = image::build(image::Options::of(board))?.path;
        let tests = [
            "image busy -- --nocapture",
            "image teleop -- --nocapture",
            "image_endurance -- --nocapture --ignored",
        ];
        for test in tests {
            let mut test = cargo(&format!(
                "test --package armwire-host-tests --features image --test {test}"
            ));
            test.env("ARMWIRE_IMAGE", &image)
                .env("ARMWIRE_FRAMES", "10000000")
                .env("ARMWIRE_SECONDS", "600");
            process::run(&mut test)?;
        }
    }
    Ok(())
}
