//! Where the configuration is kept: the last two pages of the flash, 2 kB each (RM0440 5.3.1).
//!
//! Erasing a page takes some 20 ms, in which the chip fetches no code and does nothing else: what comes in then may be
//! lost and is counted.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region, Blocking, Error, Flash};
use embassy_stm32::pac;
use embassy_stm32::peripherals::FLASH;

/// The flash.
pub(crate) type ConfigFlash = BlockingAsync<Bank1Region<'static, Blocking>>;

/// Why a page was not erased or a word not programmed.
pub(crate) type FlashError = Error;

/// Whether the supply is too low. It never is: the chip erases and programs at each supply at which it runs.
pub(crate) fn is_supply_low(_error: &FlashError) -> bool {
    false
}

/// Where in it the configuration is kept. The memory file leaves this room behind the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x1F000..0x20000;

/// The flash that has the configuration in it.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    BlockingAsync::new(Flash::new_blocking(flash).into_blocking_regions().bank1_region)
}

/// Passes over a word of the configuration that was being written when the power went. Its ECC does not hold, which the
/// chip reports this way (RM0440 5.3.2); the store finds what is read to be no good.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let error = pac::FLASH.eccr().read();
    if !(error.eccd() && CONFIG_FLASH.contains(&error.addr_ecc())) {
        panic!("the flash is broken");
    }
    // Writing 1 clears.
    pac::FLASH.eccr().modify(|w| w.set_eccd(true));
}
