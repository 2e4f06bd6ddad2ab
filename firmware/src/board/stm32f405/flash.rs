//! Where the configuration is kept: sectors 1 and 2 of the flash, 16 kB each (RM0090 table 5).
//!
//! Erasing a sector takes up to half a second, in which the chip fetches no code and does nothing else: what comes in
//! then may be lost and is counted.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region1, Blocking, Error, Flash};
use embassy_stm32::pac;
use embassy_stm32::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};

/// The HAL's driver of the first four sectors, which are of one size.
type Sectors = BlockingAsync<Bank1Region1<'static, Blocking>>;

/// The first four sectors, read as they are and not as the data cache has them from before.
pub(crate) struct ConfigFlash(Sectors);

impl ErrorType for ConfigFlash {
    type Error = Error;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = Sectors::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), Error> {
        self.0.read(offset, bytes).await
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = Sectors::WRITE_SIZE;
    const ERASE_SIZE: usize = Sectors::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), Error> {
        let result = self.0.erase(from, to).await;
        forget_cached();
        result
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), Error> {
        let result = self.0.write(offset, bytes).await;
        forget_cached();
        result
    }
}

/// Empties the data cache, which nobody tells what was erased or written (RM0090 3.6). The HAL does so only on chips
/// with two banks.
fn forget_cached() {
    let control = pac::FLASH.acr();
    // It can only be emptied while it is off (3.9.2, DCRST).
    control.modify(|w| w.set_dcen(false));
    control.modify(|w| w.set_dcrst(true));
    control.modify(|w| w.set_dcrst(false));
    control.modify(|w| w.set_dcen(true));
}

/// Where in it the configuration is kept. The memory file leaves this room between the vector table and the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x4000..0xC000;

/// The flash that has the configuration in it.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    ConfigFlash(BlockingAsync::new(
        Flash::new_blocking(flash).into_blocking_regions().bank1_region1,
    ))
}
