//! The boards with firmware.

use std::sync::LazyLock;

use armwire_boards::{BOARDS, Chip};
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// The target of the boards with an STM32.
pub(crate) const TARGET: &str = "thumbv7em-none-eabihf";

/// A board of the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Board(&'static armwire_boards::Board);

/// The format of the file that a boot loader takes.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Update {
    Dfu,
    Uf2,
}

impl Update {
    pub(crate) const fn extension(self) -> &'static str {
        match self {
            Self::Dfu => "dfu",
            Self::Uf2 => "uf2",
        }
    }
}

impl Board {
    pub(crate) const STM32F405: Self = Self::of(Chip::Stm32f405);
    pub(crate) const STM32G431: Self = Self::of(Chip::Stm32g431);
    pub(crate) const PICO: Self = Self::of(Chip::Rp2040);

    /// One board for each chip.
    pub(crate) const CHIPS: [Self; 3] = [Self::STM32F405, Self::STM32G431, Self::PICO];
    /// One board for each chip of the virtual board.
    pub(crate) const VIRTUAL: [Self; 2] = [Self::STM32F405, Self::STM32G431];

    const fn of(chip: Chip) -> Self {
        Self(armwire_boards::Board::find(chip.board()).expect("a board of the list"))
    }

    /// All boards.
    pub(crate) fn all() -> impl Iterator<Item = Self> {
        BOARDS.iter().map(Self)
    }

    /// Name in file names and options.
    pub(crate) const fn name(self) -> &'static str {
        self.0.name
    }

    /// The feature of `armwire-firmware` for the board's chip.
    pub(crate) fn feature(self) -> String {
        format!("board-{}", self.0.chip.name())
    }

    /// The compiler's target.
    pub(crate) const fn target(self) -> &'static str {
        match self.0.chip {
            Chip::Stm32f405 | Chip::Stm32g431 => TARGET,
            Chip::Rp2040 => "thumbv6m-none-eabi",
        }
    }

    /// The file that the chip's boot loader takes.
    pub(crate) const fn update(self) -> Update {
        match self.0.chip {
            Chip::Stm32f405 | Chip::Stm32g431 => Update::Dfu,
            Chip::Rp2040 => Update::Uf2,
        }
    }

    /// True for a board with CAN.
    pub(crate) const fn has_can(self) -> bool {
        self.0.can.is_some()
    }

    /// Address of the vector table: the start of flash, behind the second stage of the RP2040's boot loader.
    pub(crate) const fn vectors(self) -> u32 {
        match self.0.chip {
            Chip::Stm32f405 | Chip::Stm32g431 => 0x0800_0000,
            Chip::Rp2040 => 0x1000_0100,
        }
    }

    /// The size of the stack, in bytes. It grows down to the start of the RAM. An image with another one is of another board.
    pub(crate) const fn stack(self) -> u32 {
        match self.0.chip {
            Chip::Stm32f405 => 24 * 1024,
            Chip::Stm32g431 => 16 * 1024,
            Chip::Rp2040 => 32 * 1024,
        }
    }

    /// Maximum flash usage of the shipped image, in bytes.
    pub(crate) const fn max_flash(self) -> u64 {
        match self.0.chip {
            // The flash that an image must leave is the limit.
            Chip::Stm32f405 | Chip::Stm32g431 => u64::MAX,
            Chip::Rp2040 => 128 * 1024,
        }
    }

    /// Maximum RAM usage of the shipped image without the stack, in bytes.
    pub(crate) const fn max_ram(self) -> u64 {
        match self.0.chip {
            Chip::Stm32f405 | Chip::Stm32g431 => 15 * 1024,
            Chip::Rp2040 => 128 * 1024,
        }
    }

    /// The profile of the shipped image, or of that with a log: see `firmware/.cargo/config.toml`.
    pub(crate) const fn profile(self, log: bool) -> &'static str {
        match (self.0.chip, log) {
            (_, true) => "log",
            (Chip::Stm32f405, false) => "release",
            (Chip::Stm32g431 | Chip::Rp2040, false) => "small",
        }
    }

    /// probe-rs's name of the microcontroller.
    pub(crate) const fn chip(self) -> &'static str {
        self.0.probe_rs
    }
}

impl Default for Board {
    fn default() -> Self {
        Self::STM32F405
    }
}

impl ValueEnum for Board {
    fn value_variants<'a>() -> &'a [Self] {
        static ALL: LazyLock<Vec<Board>> = LazyLock::new(|| Board::all().collect());
        &ALL
    }

    fn to_possible_value(&self) -> Option<PossibleValue> {
        Some(PossibleValue::new(self.0.name).help(self.0.title))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_name_boards_as_files_do() {
        for board in Board::all() {
            assert_eq!(Board::from_str(board.name(), false), Ok(board));
        }
    }
}
