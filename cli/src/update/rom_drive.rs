//! The drive of the boot loader in an RP2040's ROM (RP2040 datasheet 2.8.4). `cargo fw` has this file, too.

use std::fs::{self, File};
use std::io::{self, Write};
use std::path::Path;

/// The label of the drive, and the board in the file that describes it.
pub(super) const LABEL: &str = "RPI-RP2";
/// The file that describes the drive.
pub(super) const INFO: &str = "INFO_UF2.TXT";

/// Returns true if the drive of an RP2040's boot loader is at this folder.
pub(super) fn is_at(folder: &Path) -> bool {
    let info = fs::read_to_string(folder.join(INFO)).unwrap_or_default();
    let mut lines = info.lines().filter_map(|line| line.strip_prefix("Board-ID:"));
    lines.any(|board| board.trim() == LABEL)
}

/// Writes an image to the drive at this folder. The boot loader ignores its `name`. The system may write it to the drive
/// later.
pub(super) fn write(folder: &Path, name: &str, image: &[u8]) -> io::Result<File> {
    let mut file = File::create(folder.join(name))?;
    file.write_all(image)?;
    Ok(file)
}
