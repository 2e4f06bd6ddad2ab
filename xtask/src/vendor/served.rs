//! The firmware image on the virtual board, in real time.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::Duration;

use anyhow::Result;

use super::background::Background;
use crate::board::Board;
use crate::demo;
use crate::image;

/// Timeout until the board's ports exist.
pub(crate) const BOOT: Duration = Duration::from_secs(30);
/// Timeout of its end after an interrupt.
pub(crate) const END: Duration = Duration::from_secs(10);

/// A virtual board with the shipped image and a Ling arm, just powered up.
pub(crate) struct ServedBoard {
    process: Background,
    serial: PathBuf,
    can: PathBuf,
    control: PathBuf,
}

impl ServedBoard {
    /// Builds the image for the default board and the virtual board, and creates its ports in this folder: `arm`,
    /// `control`, and `bus` if the board has CAN. The joints of its arm have this plant: `ideal` where poses must be exact.
    ///
    /// # Errors
    ///
    /// If a build fails, or the ports do not appear in time.
    pub(crate) fn start(dir: &Path, plant: &str) -> Result<Self> {
        Self::start_board(dir, plant, Board::default())
    }

    /// The same for another board.
    ///
    /// # Errors
    ///
    /// As [`start`](Self::start).
    pub(crate) fn start_board(dir: &Path, plant: &str, board: Board) -> Result<Self> {
        let image = image::build(image::Options::of(board))?;
        println!("building the virtual board, about 3 minutes the first time");
        let demo = demo::build()?;

        let (serial, can, control) = (dir.join("arm"), dir.join("bus"), dir.join("control"));
        for link in [&serial, &can, &control] {
            // The old link of a killed board may point to another program's terminal.
            let _ = fs::remove_file(link);
        }
        let mut serve = Command::new(demo);
        serve.arg("--image").arg(image.path);
        serve.arg("--plant").arg(plant);
        serve.arg("--serve").arg(&serial).arg("--control").arg(&control);
        let mut ports = vec![&serial, &control];
        if board.has_can() {
            serve.arg("--slcan").arg(&can);
            ports.push(&can);
        }
        let mut process = Background::start(&mut serve)?;
        for port in ports {
            process.wait_for_file(port, BOOT)?;
        }
        Ok(Self {
            process,
            serial,
            can,
            control,
        })
    }

    /// The arm's serial port.
    pub(crate) fn serial(&self) -> &Path {
        &self.serial
    }

    /// The CAN bus, behind an SLCAN adapter, of a board with CAN.
    pub(crate) fn can(&self) -> &Path {
        &self.can
    }

    /// The control port.
    pub(crate) fn control(&self) -> &Path {
        &self.control
    }

    /// Ends the board.
    ///
    /// # Errors
    ///
    /// If it failed before, or does not end in time.
    pub(crate) fn end(mut self) -> Result<()> {
        self.process.interrupt()?;
        self.process.succeed_within(END)
    }
}
