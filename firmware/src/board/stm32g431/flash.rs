//! Where the configuration is kept: the last two pages of the flash, 2 kB each (RM0440 5.3.1).
//!
//! Erasing a page takes some 20 ms, in which the chip fetches no code and does nothing else: what comes in then may be
//! lost and is counted.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region, Blocking, Flash};
use embassy_stm32::peripherals::FLASH;

/// The flash.
pub(crate) type ConfigFlash = BlockingAsync<Bank1Region<'static, Blocking>>;

/// Where in it the configuration is kept. The memory file leaves this room behind the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x1F000..0x20000;

/// The flash that has the configuration in it.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    BlockingAsync::new(Flash::new_blocking(flash).into_blocking_regions().bank1_region)
}
