//! The records in a chunk, which may be compressed.

use std::io::{BufRead, BufReader};

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use lz4_flex::frame::FrameDecoder as Lz4;
use ruzstd::decoding::StreamingDecoder as Zstd;

use super::fields::Fields;
use crate::printable::cut;

/// The CRC of a chunk's records.
const CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);
/// The maximum length of a chunk's records, in bytes: a compressed chunk may expand to thousands of times its length.
const MAX_LEN: u64 = 1024 * 1024 * 1024;
/// The maximum window of zstd, in bytes, which is kept in memory.
const MAX_WINDOW: u64 = 32 * 1024 * 1024;
/// The buffer for decompressed bytes.
const BUFFER: usize = 8 * 1024;

/// A chunk.
pub(super) struct Chunk<'a> {
    compression: &'a str,
    bytes: &'a [u8],
}

impl<'a> Chunk<'a> {
    /// The chunk with these fields. Its records have their length and their CRC.
    pub(super) fn parse(mut fields: Fields<'a>) -> Result<Self, String> {
        let _start_time = fields.u64()?;
        let _end_time = fields.u64()?;
        let len = fields.u64()?;
        let crc = fields.u32()?;
        let compression = fields.text()?;
        let compressed = fields.u64()?;
        let bytes = fields.bytes(compressed)?;
        let chunk = Self { compression, bytes };
        chunk.check(len, crc)?;
        Ok(chunk)
    }

    /// The records.
    pub(super) fn records(&self) -> Result<Box<dyn BufRead + 'a>, String> {
        let bytes = self.bytes;
        Ok(match self.compression {
            "" => Box::new(bytes),
            "lz4" => Box::new(BufReader::with_capacity(BUFFER, Lz4::new(bytes))),
            "zstd" => {
                let zstd = Zstd::new_with_max_window_size(bytes, MAX_WINDOW).map_err(|error| error.to_string())?;
                Box::new(BufReader::with_capacity(BUFFER, zstd))
            }
            other => return Err(format!("compressed with {}, which is not read", cut(other))),
        })
    }

    /// Checks the length and the CRC of the records. A CRC of 0 is none.
    fn check(&self, len: u64, crc: u32) -> Result<(), String> {
        if len > MAX_LEN {
            return Err(format!("{len} bytes of records, more than {MAX_LEN}"));
        }
        let mut records = self.records()?;
        let mut digest = CRC.digest();
        let mut got = 0;
        loop {
            let piece = records.fill_buf().map_err(|error| error.to_string())?;
            if piece.is_empty() {
                break;
            }
            digest.update(piece);
            let n = piece.len();
            got += n as u64;
            if got > len {
                break;
            }
            records.consume(n);
        }
        if got != len {
            let more = if got > len { "more" } else { "fewer" };
            return Err(format!("{more} bytes of records than its {len}"));
        }
        match digest.finalize() == crc || crc == 0 {
            true => Ok(()),
            false => Err("its CRC is wrong".to_owned()),
        }
    }
}
