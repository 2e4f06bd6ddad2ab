//! The firmware image on the virtual board, in real time.

use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use anyhow::Result;

use super::background::Background;
use crate::board::Board;
use crate::demo;
use crate::image;
use crate::process::run;

/// How long the board may take until its ports are there.
pub(super) const BOOT: Duration = Duration::from_secs(30);
/// How long it may take to end when asked to.
pub(super) const END: Duration = Duration::from_secs(10);

/// A virtual board with the image that ships, just switched on, and a Ling arm.
pub(super) struct ServedBoard {
    process: Background,
    serial: PathBuf,
    can: PathBuf,
}

impl ServedBoard {
    /// Builds the image and the board, and serves its ports in this folder.
    ///
    /// # Errors
    ///
    /// If that fails, or the ports are not there in time.
    pub(super) fn start(dir: &Path) -> Result<Self> {
        let image = image::build(image::Options::of(Board::default()))?;
        println!("building the virtual board, about 3 minutes the first time");
        run(&mut demo::command("build"))?;

        let (serial, can) = (dir.join("arm"), dir.join("bus"));
        for link in [&serial, &can] {
            // A link left behind by a board that was killed may lead to somebody's terminal by now.
            let _ = fs::remove_file(link);
        }
        let mut serve = demo::command("run");
        serve.args(["--quiet", "--", "--image"]).arg(image.path);
        serve.arg("--serve").arg(&serial).arg("--slcan").arg(&can);
        let mut process = Background::start(&mut serve)?;
        process.wait_for_file(&serial, BOOT)?;
        process.wait_for_file(&can, BOOT)?;
        Ok(Self { process, serial, can })
    }

    /// The arm's serial port.
    pub(super) fn serial(&self) -> &Path {
        &self.serial
    }

    /// The CAN bus, behind an SLCAN adapter.
    pub(super) fn can(&self) -> &Path {
        &self.can
    }

    /// Ends it.
    ///
    /// # Errors
    ///
    /// If it failed meanwhile, or does not end.
    pub(super) fn end(mut self) -> Result<()> {
        self.process.interrupt()?;
        self.process.succeed_within(END)
    }
}
