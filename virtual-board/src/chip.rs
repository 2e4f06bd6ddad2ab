//! The chips of the board.

use std::fmt;
use std::path::Path;

use crate::error::Error;
use crate::image::Image;

/// The address of the flash of an STM32 (RM0090, 3.4).
const STM32_FLASH: u64 = 0x0800_0000;

/// A chip with a firmware image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Chip {
    /// The STM32F405RG.
    Stm32f405,
    /// The STM32G431CB.
    Stm32g431,
    /// The RP2040 with 2 MB of flash, run by an emulator that needs Node.js.
    Rp2040,
}

/// Number of vectors of the core itself.
const CORE_VECTORS: u64 = 16;

impl Chip {
    /// Size of the flash in bytes.
    pub const fn flash_size(self) -> usize {
        match self {
            Self::Stm32f405 => 1 << 20,
            Self::Stm32g431 => 128 << 10,
            Self::Rp2040 => 2 << 20,
        }
    }

    /// The address of the flash (RM0090, 3.4; RM0440, 3.3.1; RP2040 datasheet, 2.2).
    pub(crate) const fn flash_base(self) -> u64 {
        match self {
            Self::Stm32f405 | Self::Stm32g431 => STM32_FLASH,
            Self::Rp2040 => 0x1000_0000,
        }
    }

    /// Number of interrupts in the vector table (RM0090, table 62; RM0440, table 97; RP2040 datasheet, 2.3.2).
    const fn interrupts(self) -> u64 {
        match self {
            Self::Stm32f405 => 82,
            Self::Stm32g431 => 102,
            Self::Rp2040 => 32,
        }
    }

    /// The chip of an image, an ELF file.
    ///
    /// # Errors
    ///
    /// As [`VirtualBoard::start`](crate::VirtualBoard::start).
    pub fn of_image(path: &Path) -> Result<Self, Error> {
        Self::of(&Image::read(path)?)
    }

    /// The chip of an image, by the number of interrupts in its vector table. The STM32F405 if the image has no such
    /// section.
    ///
    /// # Errors
    ///
    /// [`Error::UnknownChip`] for any other number.
    pub(crate) fn of(image: &Image) -> Result<Self, Error> {
        let vectors = image.vector_table().map(|bytes| bytes / 4);
        let Some(interrupts) = vectors.map(|vectors| vectors.saturating_sub(CORE_VECTORS)) else {
            return Ok(Self::Stm32f405);
        };
        [Self::Stm32f405, Self::Stm32g431, Self::Rp2040]
            .into_iter()
            .find(|chip| chip.interrupts() == interrupts)
            .ok_or(Error::UnknownChip { interrupts })
    }
}

/// The firmware's names of its boards.
impl fmt::Display for Chip {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Stm32f405 => "stm32f405",
            Self::Stm32g431 => "stm32g431",
            Self::Rp2040 => "pico",
        })
    }
}
