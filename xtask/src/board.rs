//! The boards that there is firmware for.

use crate::Result;

/// One of them.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(crate) enum Board {
    /// STM32F405RG, with CAN.
    #[default]
    Stm32f405,
    /// STM32G431CB, with CAN FD.
    Stm32g431,
}

impl Board {
    pub(crate) const ALL: [Self; 2] = [Self::Stm32f405, Self::Stm32g431];

    /// The board of that name.
    ///
    /// # Errors
    ///
    /// If there is none: with the names there are.
    pub(crate) fn parse(name: &str) -> Result<Self> {
        let found = Self::ALL.into_iter().find(|board| board.name() == name);
        found.ok_or_else(|| {
            let names = Self::ALL.map(Self::name).join(", ");
            format!("there is no board `{name}`, there are {names}").into()
        })
    }

    /// What it is called in file names and options.
    pub(crate) const fn name(self) -> &'static str {
        match self {
            Self::Stm32f405 => "stm32f405",
            Self::Stm32g431 => "stm32g431",
        }
    }

    /// The feature of `armwire-firmware` for it.
    pub(crate) const fn feature(self) -> &'static str {
        match self {
            Self::Stm32f405 => "board-stm32f405",
            Self::Stm32g431 => "board-stm32g431",
        }
    }

    /// Where its RAM ends that the stack is in: the stack's first address, which grows down from there.
    pub(crate) const fn stack_top(self) -> u32 {
        match self {
            Self::Stm32f405 => 0x2000_0000 + 128 * 1024,
            Self::Stm32g431 => 0x2000_0000 + 32 * 1024,
        }
    }

    /// As probe-rs calls its microcontroller.
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
    fn boards_are_found_by_name() {
        for board in Board::ALL {
            assert_eq!(Board::parse(board.name()).unwrap(), board);
        }
        assert_eq!(
            Board::parse("stm32").unwrap_err().to_string(),
            "there is no board `stm32`, there are stm32f405, stm32g431"
        );
    }
}
