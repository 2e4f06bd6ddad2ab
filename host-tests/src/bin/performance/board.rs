//! The measured boards.

use std::path::{Path, PathBuf};

use armwire_host_tests::image::{on_board_with, plug_in};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Chip, Config, VirtualBoard};

use crate::Result;
use crate::elf::{Elf, PAINT, used, words};

/// A chip with its image, and the timing of its core.
pub(crate) struct Board {
    pub(crate) chip: Chip,
    /// True for the cycles of a Cortex-M4 with the chip's flash, false for one cycle per instruction.
    pub(crate) exact: bool,
    pub(crate) limits: Limits,
    path: PathBuf,
    pub(crate) image: Elf,
}

/// Maximum figures of a board, 10 to 25 % above the longest measurement.
#[derive(Clone, Copy)]
pub(crate) struct Limits {
    /// The latency of each of the [`WAYS`](crate::latency::WAYS) that 99.9 % of the measurements do not exceed, in
    /// microseconds.
    pub(crate) latency: [f64; 4],
    /// The percentage of stamps that are wrong by more than a microsecond.
    pub(crate) wrong_stamps: f64,
    /// The load of the core in percent, while the UART transfers 1 Mbaud in both directions.
    pub(crate) load: f64,
    /// The percentage of the wire limit that is not reached.
    pub(crate) lost: f64,
}

const BOARDS: [(Chip, bool, Limits); 4] = [
    (Chip::Stm32f405, false, limits([28.0, 35.0, 55.0, 40.0], 0.1, 24.0, 5.0)),
    (Chip::Stm32f405, true, limits([56.0, 82.0, 125.0, 85.0], 0.2, 43.0, 8.0)),
    (Chip::Stm32g431, false, limits([32.0, 41.0, 66.0, 48.0], 0.1, 24.0, 5.5)),
    (
        Chip::Stm32g431,
        true,
        limits([82.0, 150.0, 195.0, 160.0], 0.4, 46.0, 9.0),
    ),
];

const fn limits(latency: [f64; 4], wrong_stamps: f64, load: f64, lost: f64) -> Limits {
    Limits {
        latency,
        wrong_stamps,
        load,
        lost,
    }
}

impl Board {
    /// All boards. Their images are in `folder`.
    pub(crate) fn all(folder: &Path) -> Result<Vec<Self>> {
        let board = |(chip, exact, limits)| {
            let path = folder.join(format!("armwire-{chip}.elf"));
            let image = Elf::read(&path)?;
            Ok(Self {
                chip,
                exact,
                limits,
                path,
                image,
            })
        };
        BOARDS.into_iter().map(board).collect()
    }

    pub(crate) fn name(&self) -> String {
        let timing = if self.exact { "own timing" } else { "one cycle" };
        format!("{}, {timing}", self.chip.to_string().to_uppercase())
    }

    /// Runs a scene on the board, with `arm` on its UART and its serial port open, both at `baud`.
    pub(crate) fn run<A: Arm, R>(&self, arm: A, baud: u32, scene: impl FnOnce(&mut VirtualBoard<A>) -> R) -> R {
        let mut config = Config::new(&self.path, arm);
        (config.arm_baud, config.exact_cycles) = (baud, self.exact);
        on_board_with(config, |board| {
            for address in words(self.image.stack()) {
                board.write_word(address.into(), PAINT).expect("the chip has RAM there");
            }
            plug_in(board, baud);
            scene(board)
        })
    }

    /// Bytes of stack used since the start of the board.
    pub(crate) fn stack<A: Arm>(&self, board: &mut VirtualBoard<A>) -> u32 {
        used(self.image.stack(), |address| {
            board.read_word(address.into()).expect("the chip has RAM there")
        })
    }
}
