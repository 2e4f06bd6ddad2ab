//! The flash of the configuration: the last two sectors, 4 kB each.
//!
//! The erase of a sector takes 45 ms, and 400 ms at worst (W25Q16JV, 9.6). Meanwhile the chip cannot fetch code. The
//! DMA receives bytes from the arm, as many as the ring holds.

use core::ops::Range;

use embassy_rp::Peri;
use embassy_rp::flash::{Blocking, ERASE_SIZE, Error, Flash, READ_SIZE, WRITE_SIZE};
use embassy_rp::peripherals::FLASH;
use embassy_sync::once_lock::OnceLock;
use embedded_storage_async::nor_flash::{ErrorType, NorFlash, ReadNorFlash};
use heapless::String;

use super::frame;
use crate::uart::stall;

/// Size of the flash in bytes.
const SIZE: usize = 2 * 1024 * 1024;

/// The range of the configuration. The memory file leaves it free after the code.
pub(crate) const CONFIG_FLASH: Range<u32> = 0x1F_E000..0x20_0000;

/// The HAL's driver.
type Sectors = Flash<'static, FLASH, Blocking, SIZE>;

/// The flash.
pub(crate) struct ConfigFlash(Sectors);

/// The error of an erase or a write.
pub(crate) type FlashError = Error;

/// The unique id of the flash, in hexadecimal.
static ID: OnceLock<String<16, u8>> = OnceLock::new();

/// The adapter's serial number: the unique id of the flash, since the chip has none.
pub(crate) fn serial_number() -> &'static str {
    ID.try_get().map_or("", |id| id.as_str())
}

/// Always false: the chip does not measure its supply.
pub(crate) fn is_supply_low(_error: &FlashError) -> bool {
    false
}

/// The flash with the configuration. This reads its unique id.
pub(super) fn new(flash: Peri<'static, FLASH>) -> ConfigFlash {
    let mut flash = Flash::new_blocking(flash);
    let mut id = [0; 8];
    // It fails only on the second core.
    if flash.blocking_unique_id(&mut id).is_ok() {
        let digit = |value: u8| char::from_digit(value.into(), 16).unwrap_or('0').to_ascii_uppercase();
        let digits = id.iter().flat_map(|byte| [byte >> 4, byte & 0xF]);
        let _ = ID.init(digits.map(digit).collect());
    }
    ConfigFlash(flash)
}

impl ErrorType for ConfigFlash {
    type Error = FlashError;
}

impl ReadNorFlash for ConfigFlash {
    const READ_SIZE: usize = READ_SIZE;

    async fn read(&mut self, offset: u32, bytes: &mut [u8]) -> Result<(), FlashError> {
        self.0.blocking_read(offset, bytes)
    }

    fn capacity(&self) -> usize {
        SIZE
    }
}

impl NorFlash for ConfigFlash {
    const WRITE_SIZE: usize = WRITE_SIZE;
    const ERASE_SIZE: usize = ERASE_SIZE;

    async fn erase(&mut self, from: u32, to: u32) -> Result<(), FlashError> {
        pause(|| self.0.blocking_erase(from, to))
    }

    async fn write(&mut self, offset: u32, bytes: &[u8]) -> Result<(), FlashError> {
        pause(|| self.0.blocking_write(offset, bytes))
    }
}

/// Calls an operation of the flash, during which no interrupt is handled.
fn pause<R>(operation: impl FnOnce() -> R) -> R {
    stall(|| {
        let result = operation();
        frame::lose_start();
        result
    })
}
