//! `cargo xtask boards`: the images of the boards that share a chip, on the virtual board.

use anyhow::Result;

use crate::board::Board;
use crate::cargo::cargo;
use crate::image::{self, Image};
use crate::process::run;

/// Builds the image of each board that is not the first of its chip, and runs the tests of what differs between them.
///
/// # Errors
///
/// If a build fails, a size exceeds its limit, or a test fails.
pub(crate) fn test() -> Result<()> {
    Board::all()
        .filter(|board| !Board::CHIPS.contains(board))
        .try_for_each(|board| run_tests(&image::release(board)?))
}

fn run_tests(image: &Image) -> Result<()> {
    let mut test = cargo("test --package armwire-host-tests --features image --test image boards::");
    run(test.env("ARMWIRE_IMAGE", &image.path))
}
