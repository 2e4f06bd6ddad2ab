//! Updates of a Pico: a firmware image, and the drive of the boot loader.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Output;

use crc::{CRC_32_ISO_HDLC, Crc};

use super::dfu::update_command;
use super::{finish, free_path, retry_while_busy, start};

/// The file that describes the drive, and its text in revision B2 of the chip.
pub(crate) const INFO: &str = "INFO_UF2.TXT";
pub(crate) const DESCRIPTION: &str = "UF2 Bootloader v3.0\nModel: Raspberry Pi RP2\nBoard-ID: RPI-RP2\n";
/// The file on the drive after the boot loader has taken it.
const TAKEN: &str = "taken";

/// Family of the RP2040.
pub(crate) const RP2040: u32 = 0xE48B_FF56;

/// A firmware of one sector for a board of this name, as a UF2 file.
pub(crate) fn image(board: &str, family: u32) -> Vec<u8> {
    let mut sector = [0; 4096];
    sector[256..264].copy_from_slice(&[0, 0, 4, 0x20, 1, 2, 0, 0x10]);
    let mut tags = vec![4 + board.len() as u8, 0x9D, 0x0D, 0x65];
    tags.extend(board.as_bytes());
    tags.resize(tags.len().next_multiple_of(4), 0);
    tags.extend(*b"\x08\x71\x3C\x5A");
    tags.extend(Crc::<u32>::new(&CRC_32_ISO_HDLC).checksum(&sector).to_le_bytes());
    let mut file = Vec::new();
    for (number, page) in sector.chunks(256).enumerate() {
        let flags = if number == 0 { 0xA000 } else { 0x2000 };
        let address = 0x1000_0000 + 256 * number as u32;
        for word in [0x0A32_4655, 0x9E5D_5157, flags, address, 256, number as u32, 16, family] {
            file.extend(word.to_le_bytes());
        }
        file.extend(page);
        file.extend(if number == 0 { &tags[..] } else { &[] });
        file.resize(512 * number + 508, 0);
        file.extend(0x0AB1_6F30_u32.to_le_bytes());
    }
    file
}

/// The boot loader, if its drive is described by the file `info`: takes a whole file from the drive, and starts it.
pub(crate) fn take_file(info: &Path) {
    let Some(drive) = info.parent().filter(|_| info.ends_with(INFO) && info.exists()) else {
        return;
    };
    let file = drive.join("armwire.uf2");
    if fs::read(&file).is_ok_and(|bytes| bytes.len() == 16 * 512) {
        fs::rename(file, drive.join(TAKEN)).unwrap();
        fs::remove_file(info).unwrap();
    }
}

/// The folder of a drive, and a file with an image. Both are removed on drop.
pub(crate) struct Folders {
    pub(crate) drive: PathBuf,
    pub(crate) file: PathBuf,
}

impl Folders {
    pub(crate) fn new() -> Self {
        let drive = free_path("drive");
        let _ = fs::remove_dir_all(&drive);
        fs::create_dir(&drive).unwrap();
        let file = free_path("image").with_extension("uf2");
        Self { drive, file }
    }

    /// Updates the adapter on the port with these bytes in the file.
    pub(crate) fn update(&self, port: &str, image: &[u8]) -> Output {
        fs::write(&self.file, image).unwrap();
        let mut update = update_command(port, &self.file, &self.drive);
        update.arg("--drive").arg(&self.drive);
        retry_while_busy(|| finish(start(&mut update)))
    }

    /// The file that the boot loader has taken.
    pub(crate) fn taken(&self) -> Option<Vec<u8>> {
        fs::read(self.drive.join(TAKEN)).ok()
    }
}

impl Drop for Folders {
    fn drop(&mut self) {
        let _ = fs::remove_dir_all(&self.drive);
        let _ = fs::remove_file(&self.file);
    }
}
