//! Where the configuration is kept: sectors 1 and 2 of the flash, 16 kB each (RM0090 table 5).
//!
//! Erasing a sector takes 250 ms, and 500 ms at worst (DS8626, 5.3.12). Meanwhile the chip fetches no code and does nothing
//! else: what comes in then may be lost and is counted.
//!
//! Erasing and programming 32 bits at once needs 2.7 V (RM0090 3.6.2). The supply is looked at before each sector and each
//! word; a supply that falls while a sector is erased is not seen.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region1, Blocking, Error as HalError, Flash};
use embassy_stm32::pac;
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// The HAL's driver of the first four sectors, which are of one size.
type Sectors = BlockingAsync<Bank1Region1<'static, Blocking>>;

/// What unlocks FLASH_CR (RM0090 3.6.1).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// PLS of PWR_CR: the supply is low below 2.87 V to 2.99 V, and not low any more above 2.97 V to 3.09 V (DS8626, 5.3.2).
const SUPPLY_LEVEL: u8 = 0b110;

/// The first four sectors, read as they are and not as the data cache has them from before.
pub(crate) struct ConfigFlash(Sectors);

/// Why a sector was not erased or a word not programmed.
#[derive(Debug)]
pub(crate) enum FlashError {
    /// The chip refused it.
    Hal(HalError),
    /// The supply is too low for it.
    SupplyLow,
}

/// Whether the supply is too low.
pub(crate) fn is_supply_low(error: &FlashError) -> bool {
    matches!(error, FlashError::SupplyLow)
}

impl NorFlashError for FlashError {
    fn kind(&self) -> NorFlashErrorKind {
        match self {
            Self::Hal(error) => error.kind(),
            Self::SupplyLow => NorFlashErrorKind::Other,
        }
    }
}

impl ErrorType for ConfigFlash {
    type Error = FlashError;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = Sectors::READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.0.read(offset, bytes).await.map_err(FlashError::Hal)
    }

    fn capacity(&self) -> usize {
        self.0.capacity()
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = Sectors::WRITE_SIZE;
    const ERASE_SIZE: usize = Sectors::ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        for sector in (from..to).step_by(Self::ERASE_SIZE) {
            check_supply()?;
            erase_words();
            let result = self.0.erase(sector, sector + Self::ERASE_SIZE as u32).await;
            forget_cached();
            result.map_err(FlashError::Hal)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        for (offset, word) in (offset..).step_by(Self::WRITE_SIZE).zip(bytes.chunks(Self::WRITE_SIZE)) {
            check_supply()?;
            let result = self.0.write(offset, word).await;
            forget_cached();
            result.map_err(FlashError::Hal)?;
        }
        Ok(())
    }
}

/// Whether the supply is high enough to erase and to program.
fn check_supply() -> Result<(), FlashError> {
    match pac::PWR.csr1().read().pvdo() {
        true => Err(FlashError::SupplyLow),
        false => Ok(()),
    }
}

/// Lets the next erase go by words of 32 bits (RM0090 3.6.2). The HAL leaves PSIZE as a reset does, at bytes, which takes
/// 400 ms, and 800 ms at worst.
fn erase_words() {
    let control = pac::FLASH.cr();
    if control.read().lock() {
        for key in KEYS {
            pac::FLASH.keyr().write_value(key);
        }
    }
    control.modify(|w| w.set_psize(Psize::PSIZE32));
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

/// The flash that has the configuration in it. The supply is watched from here on.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    pac::PWR.cr1().modify(|w| {
        w.set_pls(SUPPLY_LEVEL);
        w.set_pvde(true);
    });
    ConfigFlash(BlockingAsync::new(
        Flash::new_blocking(flash).into_blocking_regions().bank1_region1,
    ))
}
