//! Firmware images: what is in a file, checked before anything is restarted.

pub(super) mod dfuse;
pub(super) mod uf2;

use thiserror::Error;

/// An image that can be written.
#[derive(Debug, PartialEq, Eq)]
pub(super) struct Image {
    /// The format, and with it the boot loader.
    pub(super) format: Format,
    /// Name of the board that it is for.
    pub(super) board: String,
    /// Number of bytes in flash.
    pub(super) len: usize,
}

/// The format of a file with an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Format {
    /// For ST's boot loader.
    DfuSe,
    /// For the RP2040's boot loader.
    Uf2,
}

/// The reason for a file that is refused.
#[derive(Debug, PartialEq, Eq, Error)]
pub(super) enum Unfit {
    /// No format has this signature.
    #[error("not a DfuSe or UF2 file: is it the .dfu or .uf2 of the firmware, and not the .bin or .elf?")]
    Format,
    #[error(transparent)]
    DfuSe(#[from] dfuse::Unfit),
    #[error(transparent)]
    Uf2(#[from] uf2::Unfit),
}

/// Returns the length of the file that begins with `head`, in bytes. The head of a UF2 file has 32.
pub(super) fn file_len(head: &[u8]) -> Result<usize, Unfit> {
    Ok(match format(head)? {
        Format::DfuSe => dfuse::file_len(head)?,
        Format::Uf2 => uf2::file_len(head)?,
    })
}

/// Takes a file apart.
pub(super) fn parse(file: &[u8]) -> Result<Image, Unfit> {
    let format = format(file)?;
    let (board, len) = match format {
        Format::DfuSe => dfuse::parse(file)?,
        Format::Uf2 => uf2::parse(file)?,
    };
    Ok(Image { format, board, len })
}

fn format(head: &[u8]) -> Result<Format, Unfit> {
    if head.starts_with(&dfuse::SIGNATURE) {
        Ok(Format::DfuSe)
    } else if head.starts_with(&uf2::SIGNATURE) {
        Ok(Format::Uf2)
    } else {
        Err(Unfit::Format)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn file_of_another_format_is_refused() {
        for file in [&b"\x7FELF, and much more than this"[..], b"DfuSe", b"UF2\n", b""] {
            assert_eq!(file_len(file), Err(Unfit::Format));
            assert_eq!(parse(file), Err(Unfit::Format));
        }
    }
}
