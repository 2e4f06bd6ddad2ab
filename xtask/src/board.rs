//! The boards with firmware.

use std::sync::LazyLock;

use armwire_boards::{BOARDS, Chip};
use clap::ValueEnum;
use clap::builder::PossibleValue;

/// A board of the list.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Board(&'static armwire_boards::Board);

impl Board {
    pub(crate) const STM32F405: Self = Self::named("stm32f405");
    pub(crate) const STM32G431: Self = Self::named("stm32g431");

    /// One board for each chip.
    pub(crate) const CHIPS: [Self; 2] = [Self::STM32F405, Self::STM32G431];

    const fn named(name: &str) -> Self {
        Self(armwire_boards::Board::find(name).expect("a board of the list"))
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

    /// End of the RAM with the stack, which grows down.
    pub(crate) const fn stack_top(self) -> u32 {
        match self.0.chip {
            Chip::Stm32f405 => 0x2000_0000 + 128 * 1024,
            Chip::Stm32g431 => 0x2000_0000 + 32 * 1024,
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
