//! The boards with firmware.

use clap::ValueEnum;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, ValueEnum)]
pub(crate) enum Board {
    /// STM32F405RG, with CAN
    #[default]
    Stm32f405,
    /// STM32G431CB, with CAN FD
    Stm32g431,
}

impl Board {
    pub(crate) const ALL: [Self; 2] = [Self::Stm32f405, Self::Stm32g431];

    /// Name in file names and options.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Stm32f405 => "stm32f405",
            Self::Stm32g431 => "stm32g431",
        }
    }

    /// End of the RAM with the stack, which grows down.
    pub(crate) const fn stack_top(self) -> u32 {
        match self {
            Self::Stm32f405 => 0x2000_0000 + 128 * 1024,
            Self::Stm32g431 => 0x2000_0000 + 32 * 1024,
        }
    }

    /// probe-rs's name of the microcontroller.
    pub(crate) const fn chip(self) -> &'static str {
        match self {
            Self::Stm32f405 => "STM32F405RGTx",
            Self::Stm32g431 => "STM32G431CBTx",
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn options_name_boards_as_files_do() {
        for board in Board::ALL {
            assert_eq!(Board::from_str(board.name(), false), Ok(board));
        }
        assert_eq!(Board::value_variants(), Board::ALL);
    }
}
