//! `cargo xtask boards`: the images of the boards that share a chip, on the virtual board.

use anyhow::Result;

use crate::board::Board;
use crate::image;
use crate::process::run;

/// Builds the image of each board that is not the first of its chip, and runs the tests of what differs between them.
///
/// # Errors
///
/// If a build fails, a size exceeds its limit, or a test fails.
pub(crate) fn test() -> Result<()> {
    Board::all()
        .filter(|board| !Board::CHIPS.contains(board))
        .try_for_each(|board| run(image::release(board)?.tests().arg("boards::")))
}
