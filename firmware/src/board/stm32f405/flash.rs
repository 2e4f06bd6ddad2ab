//! Where the configuration is kept: sectors 1 and 2 of the flash, 16 kB each (RM0090 table 5).
//!
//! Erasing a sector takes up to half a second, in which the chip fetches no code and does nothing else: what comes in
//! then may be lost and is counted.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region1, Blocking, Flash};
use embassy_stm32::peripherals::FLASH;

/// The first four sectors, which are of one size.
pub(crate) type ConfigFlash = BlockingAsync<Bank1Region1<'static, Blocking>>;

/// Where in it the configuration is kept. The memory file leaves this room between the vector table and the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x4000..0xC000;

/// The flash that has the configuration in it.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    BlockingAsync::new(Flash::new_blocking(flash).into_blocking_regions().bank1_region1)
}
