//! The flash of the configuration: the last two pages, 2 kB each (RM0440 5.3.1).
//!
//! The erase of a page takes some 20 ms, during which the chip cannot fetch code: received bytes may be lost and are
//! counted.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region, Blocking, Error, Flash};
use embassy_stm32::pac;
use embassy_stm32::peripherals::FLASH;

/// The flash.
pub(crate) type ConfigFlash = BlockingAsync<Bank1Region<'static, Blocking>>;

/// The error of an erase or a write.
pub(crate) type FlashError = Error;

/// Always false: the chip erases and programs at any supply voltage at which it runs.
pub(crate) fn is_supply_low(_error: &FlashError) -> bool {
    false
}

/// The range of the configuration. The memory file leaves it free after the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x1F000..0x20000;

/// The flash with the configuration.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    BlockingAsync::new(Flash::new_blocking(flash).into_blocking_regions().bank1_region)
}

/// Tolerates a word of the configuration that was being written at a loss of power. The chip reports its ECC error by
/// this interrupt (RM0440 5.3.2); the store recognises the word as invalid.
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    let error = pac::FLASH.eccr().read();
    if !(error.eccd() && CONFIG_FLASH.contains(&error.addr_ecc())) {
        panic!("the flash is broken");
    }
    // Writing 1 clears.
    pac::FLASH.eccr().modify(|w| w.set_eccd(true));
}
