//! `cargo xtask campaign`: the fault campaign, with the image for the STM32F405 on the virtual board.

#[path = "../../host-tests/src/bin/campaign/options.rs"]
mod options;

use std::path::Path;

use anyhow::Result;

pub(crate) use self::options::Options;
use crate::cargo::cargo;
use crate::image;
use crate::process;

impl Options {
    /// The first runs of the default seed.
    pub(crate) fn runs(runs: u32) -> Self {
        Self {
            runs,
            from: None,
            seed: 1,
            only: None,
            write: false,
        }
    }
}

/// Builds the image, or uses that of `ARMWIRE_IMAGE`, and runs the campaign.
///
/// # Errors
///
/// If a run fails.
pub(crate) fn run(options: &Options) -> Result<()> {
    run_on(&image::for_virtual_board()?, options)
}

/// Runs the campaign on this image.
///
/// # Errors
///
/// If a run fails.
pub(crate) fn run_on(image: &Path, options: &Options) -> Result<()> {
    let numbers = [
        ("runs", Some(options.runs.into())),
        ("from", options.from.map(u64::from)),
        ("seed", Some(options.seed)),
        ("only", options.only.map(u64::from)),
    ];
    let mut campaign = cargo("run --package armwire-host-tests --features image --bin campaign --");
    for (name, number) in numbers {
        campaign.args(number.map(|number| format!("--{name}={number}")));
    }
    campaign.args(options.write.then_some("--write"));
    process::run(campaign.env("ARMWIRE_IMAGE", image))
}
