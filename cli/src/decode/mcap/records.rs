//! The records of an MCAP file that lead to its messages: <https://mcap.dev/spec>.
//!
//! The library splits the file into records. Their fields and chunks are read here: the library's readers reserve as
//! many bytes as a damaged length says, and panic at a record that extends beyond its chunk (`mcap` 0.26.0).

use std::io::BufRead;

use crc::{CRC_32_ISO_HDLC, Crc, Table};
use mcap::McapError;
use mcap::records::op;
use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};

use crate::printable::cut;

/// The longest record, in bytes. Other programs may have written images to the file.
const MAX_RECORD: usize = 64 * 1024 * 1024;
/// The CRC of a chunk.
const CRC: Crc<u32, Table<16>> = Crc::<u32, Table<16>>::new(&CRC_32_ISO_HDLC);

/// A record.
pub(super) enum Record<'a> {
    /// The type of messages.
    Schema { id: u16, name: &'a str },
    /// A topic, and the type of its messages.
    Channel { id: u16, schema: u16, encoding: &'a str },
    /// A message. The log time is in nanoseconds since 1970.
    Message {
        channel: u16,
        sequence: u32,
        log_time: u64,
        data: &'a [u8],
    },
}

/// A consumer of records.
pub(super) type Take<'a> = dyn FnMut(Record<'_>) -> Result<(), String> + 'a;

/// Hands the records of a file, also those in its chunks, to `take`. Returns true if the file is cut: its program was
/// killed, or is still writing.
pub(super) fn read(file: &mut dyn BufRead, take: &mut Take<'_>) -> Result<bool, String> {
    split(file, LinearReaderOptions::default(), &mut |opcode, data| match opcode {
        op::CHUNK => read_chunk(data, take),
        _ => read_record(opcode, data, take),
    })
}

/// Hands the code and the fields of each record to `take`. Returns true if the last one is cut.
fn split(
    source: &mut dyn BufRead,
    options: LinearReaderOptions,
    take: &mut dyn FnMut(u8, Fields<'_>) -> Result<(), String>,
) -> Result<bool, String> {
    let options = options.with_emit_chunks(true).with_record_length_limit(MAX_RECORD);
    let mut reader = LinearReader::new_with_options(options);
    loop {
        match reader.next_event() {
            None => return Ok(false),
            Some(Ok(LinearReadEvent::ReadRequest(len))) => {
                let piece = source.fill_buf().map_err(|error| error.to_string())?;
                // No more than is there: the length of a record may be wrong. Nothing is the end.
                let len = len.min(piece.len());
                reader.insert(len).copy_from_slice(&piece[..len]);
                reader.notify_read(len);
                source.consume(len);
            }
            Some(Ok(LinearReadEvent::Record { opcode, data })) => take(opcode, Fields(data))?,
            Some(Err(McapError::UnexpectedEof)) => return Ok(true),
            Some(Err(error)) => return Err(error.to_string()),
        }
    }
}

/// Hands the records in a chunk to `take`.
fn read_chunk(mut chunk: Fields<'_>, take: &mut Take<'_>) -> Result<(), String> {
    let _start_time = chunk.u64()?;
    let _end_time = chunk.u64()?;
    let _size = chunk.u64()?;
    let crc = chunk.u32()?;
    let compression = chunk.text()?;
    if !compression.is_empty() {
        return Err(format!(
            "a chunk is compressed with {}, which is not read",
            cut(compression)
        ));
    }
    let len = chunk.u64()?;
    let mut records = chunk.bytes(len)?;
    if crc != 0 && crc != CRC.checksum(records) {
        return Err("a chunk is damaged: its CRC is wrong".to_owned());
    }
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true);
    match split(&mut records, options, &mut |opcode, data| {
        read_record(opcode, data, take)
    })? {
        true => Err("a record extends beyond its chunk".to_owned()),
        false => Ok(()),
    }
}

/// Hands a record to `take` unless it does not lead to messages.
fn read_record(opcode: u8, mut fields: Fields<'_>, take: &mut Take<'_>) -> Result<(), String> {
    take(match opcode {
        op::SCHEMA => Record::Schema {
            id: fields.u16()?,
            name: fields.text()?,
        },
        op::CHANNEL => {
            let (id, schema, _topic) = (fields.u16()?, fields.u16()?, fields.text()?);
            let encoding = fields.text()?;
            Record::Channel { id, schema, encoding }
        }
        op::MESSAGE => {
            let (channel, sequence, log_time) = (fields.u16()?, fields.u32()?, fields.u64()?);
            let _publish_time = fields.u64()?;
            Record::Message {
                channel,
                sequence,
                log_time,
                data: fields.0,
            }
        }
        _ => return Ok(()),
    })
}

/// The fields of a record that are not read yet. Numbers are little-endian.
struct Fields<'a>(&'a [u8]);

impl<'a> Fields<'a> {
    fn u16(&mut self) -> Result<u16, String> {
        self.array().map(u16::from_le_bytes)
    }

    fn u32(&mut self) -> Result<u32, String> {
        self.array().map(u32::from_le_bytes)
    }

    fn u64(&mut self) -> Result<u64, String> {
        self.array().map(u64::from_le_bytes)
    }

    fn text(&mut self) -> Result<&'a str, String> {
        let len = self.u32()?;
        let bytes = self.bytes(len.into())?;
        str::from_utf8(bytes).map_err(|error| format!("a record is damaged: {error}"))
    }

    fn bytes(&mut self, len: u64) -> Result<&'a [u8], String> {
        let split = usize::try_from(len).ok().and_then(|len| self.0.split_at_checked(len));
        let (bytes, rest) = split.ok_or_else(Self::cut)?;
        self.0 = rest;
        Ok(bytes)
    }

    fn array<const N: usize>(&mut self) -> Result<[u8; N], String> {
        let (array, rest) = self.0.split_first_chunk().ok_or_else(Self::cut)?;
        self.0 = rest;
        Ok(*array)
    }

    fn cut() -> String {
        "a record is damaged: it ends within a field".to_owned()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The reason why a file with this chunk is refused.
    fn refused(crc: u32, compression: &str, records: &[u8]) -> String {
        let mut chunk = vec![0; 24];
        chunk.extend(crc.to_le_bytes());
        chunk.extend((compression.len() as u32).to_le_bytes());
        chunk.extend(compression.as_bytes());
        chunk.extend((records.len() as u64).to_le_bytes());
        chunk.extend(records);
        let mut file = mcap::MAGIC.to_vec();
        file.push(op::CHUNK);
        file.extend((chunk.len() as u64).to_le_bytes());
        file.extend(chunk);
        match read(&mut &file[..], &mut |_| Ok(())) {
            Err(reason) => reason,
            Ok(_) => panic!("it is read"),
        }
    }

    #[test]
    fn chunk_that_cannot_be_read_is_refused() {
        assert_eq!(
            refused(0, "zstd", &[]),
            "a chunk is compressed with zstd, which is not read"
        );
        assert_eq!(refused(1, "", &[]), "a chunk is damaged: its CRC is wrong");
        let too_long = [op::MESSAGE, 9, 0, 0, 0, 0, 0, 0, 0, 1];
        assert_eq!(refused(0, "", &too_long), "a record extends beyond its chunk");
        let too_short = [op::MESSAGE, 1, 0, 0, 0, 0, 0, 0, 0, 1];
        assert_eq!(
            refused(0, "", &too_short),
            "a record is damaged: it ends within a field"
        );
        let huge_text = [op::SCHEMA, 6, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0xFF, 0xFF, 0xFF, 0xFF];
        assert_eq!(
            refused(0, "", &huge_text),
            "a record is damaged: it ends within a field"
        );
    }
}
