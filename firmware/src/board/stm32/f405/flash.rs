//! The flash of the configuration: sectors 1 and 2, 16 kB each (RM0090 table 5).
//!
//! The erase of a sector takes 250 ms, and 500 ms at worst (DS8626, 5.3.12). Meanwhile the chip cannot fetch code:
//! received bytes may be lost and are counted.
//!
//! Erasing and programming by 32 bits needs 2.7 V (RM0090 3.6.2). The supply is checked before each sector and each
//! word; a drop during the erase of a sector goes undetected.

use core::ops::Range;

use embassy_embedded_hal::adapter::BlockingAsync;
use embassy_stm32::Peri;
use embassy_stm32::flash::{Bank1Region1, Blocking, Error as HalError, Flash};
use embassy_stm32::pac;
use embassy_stm32::pac::flash::vals::Psize;
use embassy_stm32::peripherals::FLASH;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, NorFlashError, NorFlashErrorKind, ReadNorFlash};

/// The HAL's driver of the first four sectors, which have the same size.
type Sectors = BlockingAsync<Bank1Region1<'static, Blocking>>;

/// Unlock keys of FLASH_CR (RM0090 3.6.1).
const KEYS: [u32; 2] = [0x4567_0123, 0xCDEF_89AB];

/// PLS of PWR_CR: the supply typically counts as low below 2.84 V, and as good above 2.93 V (DS8626, 5.3.2). Words need 2.7 V
/// (RM0090 3.6.2), and some boards run at 3.0 V.
const SUPPLY_LEVEL: u8 = 0b101;

/// The first four sectors, read past the data cache.
pub(crate) struct ConfigFlash(Sectors);

/// The error of an erase or a write.
#[derive(Debug)]
pub(crate) enum FlashError {
    /// The HAL's error.
    Hal(HalError),
    /// The supply voltage is too low.
    SupplyLow,
}

/// Returns true if the supply voltage was too low.
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
            invalidate_cache();
            result.map_err(FlashError::Hal)?;
        }
        Ok(())
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        for (offset, word) in (offset..).step_by(Self::WRITE_SIZE).zip(bytes.chunks(Self::WRITE_SIZE)) {
            check_supply()?;
            let result = self.0.write(offset, word).await;
            invalidate_cache();
            result.map_err(FlashError::Hal)?;
        }
        Ok(())
    }
}

/// Checks that the supply voltage allows erasing and programming.
fn check_supply() -> Result<(), FlashError> {
    match pac::PWR.csr1().read().pvdo() {
        true => Err(FlashError::SupplyLow),
        false => Ok(()),
    }
}

/// Sets 32 bits for the next erase (RM0090 3.6.2). The HAL keeps PSIZE at its reset value, 8 bits, with which an erase
/// takes 400 ms, and 800 ms at worst.
fn erase_words() {
    let control = pac::FLASH.cr();
    if control.read().lock() {
        for key in KEYS {
            pac::FLASH.keyr().write_value(key);
        }
    }
    control.modify(|w| w.set_psize(Psize::PSIZE32));
}

/// Invalidates the data cache, which does not follow erases (RM0090 3.6.4). The HAL does so only on chips with two banks,
/// behind erases and writes. By the manual the cache follows a write, and ST's HAL relies on it.
fn invalidate_cache() {
    let control = pac::FLASH.acr();
    // It can be invalidated only while it is disabled (3.9.2, DCRST).
    control.modify(|w| w.set_dcen(false));
    control.modify(|w| w.set_dcrst(true));
    control.modify(|w| w.set_dcrst(false));
    control.modify(|w| w.set_dcen(true));
}

/// The range of the configuration. The memory file leaves it free between the vector table and the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x4000..0xC000;

/// The flash with the configuration. This starts the monitoring of the supply voltage.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    pac::PWR.cr1().modify(|w| {
        w.set_pls(SUPPLY_LEVEL);
        w.set_pvde(true);
    });
    ConfigFlash(BlockingAsync::new(
        Flash::new_blocking(flash).into_blocking_regions().bank1_region1,
    ))
}
