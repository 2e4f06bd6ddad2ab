//! The system memory: the boot loader in ROM (AN2606), the unique id and the size of the flash.

use crate::core::{Access, Purpose};

/// The boot loader, and the first instruction of its stub.
const BOOT_LOADER: u32 = 0x1FFF_0000;
const BOOT_LOADER_START: u32 = BOOT_LOADER + 8;

/// The stub: a stack, a reset vector, and an endless loop.
const BOOT_LOADER_STUB: [u8; 12] = [
    0x00, 0x20, 0x00, 0x20, // stack: 0x2000_2000
    0x09, 0x00, 0xFF, 0x1F, // reset: BOOT_LOADER_START, Thumb
    0x00, 0xBF, // nop
    0xFE, 0xE7, // b .
];

/// The chip-specific addresses.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SystemMemory {
    /// The address of the 96-bit unique id.
    pub(crate) unique_id: u32,
    /// The address of the flash size, 16 bits.
    pub(crate) flash_size: u32,
    /// The flash size, in KiB.
    pub(crate) flash_kib: u16,
}

impl SystemMemory {
    /// The value of an access, if the content is known.
    pub(crate) fn read(&self, access: Access, unique_id: &[u8; 12]) -> Option<u32> {
        let byte = |offset| self.byte(access.address + offset, unique_id);
        (0..access.width.bytes()).try_fold(0, |value, at| Some(value | u32::from(byte(at)?) << (8 * at)))
    }

    fn byte(&self, address: u32, unique_id: &[u8; 12]) -> Option<u8> {
        let flash_kib = self.flash_kib.to_le_bytes();
        let contents = [
            (BOOT_LOADER, &BOOT_LOADER_STUB[..]),
            (self.unique_id, unique_id),
            (self.flash_size, &flash_kib),
        ];
        contents
            .into_iter()
            .find_map(|(start, bytes)| bytes.get(address.checked_sub(start)? as usize).copied())
    }
}

/// Returns true if the core starts the boot loader.
pub(crate) fn starts_boot_loader(access: Access) -> bool {
    access.purpose == Purpose::Fetch && access.address == BOOT_LOADER_START
}
