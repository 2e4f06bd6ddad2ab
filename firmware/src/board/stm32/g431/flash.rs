//! The flash of the configuration: the last two pages, 2 kB each (RM0440 5.3.1).
//!
//! The erase of a page takes some 20 ms, during which the chip cannot fetch code: received bytes may be lost and are
//! counted.
//!
//! A double word has an ECC. One whose programming or erase was interrupted by a reset or a loss of power fails it when it
//! is read, which the chip reports by the NMI (RM0440 5.3.2). The store recognises such an item as damaged by its checksum.

use core::ops::Range;
use core::sync::atomic::{AtomicBool, Ordering};

use cortex_m::asm::dsb;
use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region, Blocking, Error, Flash};
use embassy_stm32::pac;
use embassy_stm32::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// The HAL's driver of all pages.
type Pages = BlockingAsync<Bank1Region<'static, Blocking>>;

/// The flash. ECC errors during an access do not count: [`NonMaskableInt`] returns.
pub(crate) struct ConfigFlash(Pages);

/// The error of an erase or a write.
pub(crate) type FlashError = Error;

impl ErrorType for ConfigFlash {
    type Error = FlashError;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = Pages::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        let _access = Access::begin();
        self.0.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = Pages::WRITE_SIZE;
    const ERASE_SIZE: usize = Pages::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        let _access = Access::begin();
        self.0.erase(from, to).await
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        let _access = Access::begin();
        self.0.write(offset, bytes).await
    }
}

/// True during an [`Access`].
static IS_ACCESSED: AtomicBool = AtomicBool::new(false);

/// An access to the configuration, until it is dropped.
struct Access;

impl Access {
    fn begin() -> Self {
        IS_ACCESSED.store(true, Ordering::Relaxed);
        dsb();
        Self
    }
}

impl Drop for Access {
    fn drop(&mut self) {
        // All reads have been made, and their NMI was taken.
        dsb();
        IS_ACCESSED.store(false, Ordering::Relaxed);
    }
}

/// Always false: the chip erases and programs at any supply voltage at which it runs.
pub(crate) fn is_supply_low(_error: &FlashError) -> bool {
    false
}

/// The range of the configuration. The memory file leaves it free after the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x1F000..0x20000;

/// The flash with the configuration.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    ConfigFlash(BlockingAsync::new(
        Flash::new_blocking(flash).into_blocking_regions().bank1_region,
    ))
}

/// Tolerates ECC errors in the configuration; one elsewhere is a panic.
///
/// The access tells the two apart, because FLASH_ECCR does not: a reset or a loss of power during programming or an erase
/// may corrupt it, including the address and the flag (ES0431).
#[cortex_m_rt::exception]
unsafe fn NonMaskableInt() {
    // Writing 1 clears the flags, and 0 the interrupt enable, which may be corrupted, too.
    pac::FLASH.eccr().write(|w| {
        w.set_eccc(true);
        w.set_eccd(true);
    });
    if !IS_ACCESSED.load(Ordering::Relaxed) {
        panic!("the flash has an ECC error outside of the configuration");
    }
}
