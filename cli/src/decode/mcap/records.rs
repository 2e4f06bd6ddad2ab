//! The records of an MCAP file that lead to its messages: <https://mcap.dev/spec>.
//!
//! The library splits the file into records. Their fields and chunks are read here: the library's readers reserve as
//! many bytes as a damaged length says, and panic at a record that extends beyond its chunk (`mcap` 0.26.0).

use std::fmt::Display;
use std::io::BufRead;

use mcap::sans_io::linear_reader::{LinearReadEvent, LinearReader, LinearReaderOptions};
use mcap::{MAGIC, McapError, records::op};

use super::chunk::Chunk;
use super::fields::Fields;
use crate::decode::doubts::Doubt;

/// The longest record, in bytes. Other programs may have written images to the file.
const MAX_RECORD: usize = 64 * 1024 * 1024;
/// The length of a record's code and of its length.
const HEAD: u64 = 9;

/// The kind of records that describe the file: its head, its end, and indexes.
pub(crate) const STRUCTURE: &str = "structure";

/// A record.
pub(crate) enum Record<'a> {
    /// The type of messages.
    Schema { id: u16, name: &'a str },
    /// A topic, and the type of its messages.
    Channel {
        id: u16,
        schema: u16,
        topic: &'a str,
        encoding: &'a str,
    },
    /// A record of this kind that leads to no message.
    Other(&'static str),
    /// A message. The log time is in nanoseconds since 1970.
    Message {
        channel: u16,
        sequence: u32,
        log_time: u64,
        data: &'a [u8],
    },
}

/// A consumer of a file.
pub(crate) trait Visitor {
    /// Takes what a record at this place is, in bytes, or the reason why it is not read. The place of one in a chunk is
    /// that of the chunk. A damaged chunk is not read from the first such record to its end.
    fn unit(&mut self, place: u64, record: Result<Record<'_>, Doubt>);
}

/// Hands the records of a file, also those in its chunks, to `visitor`. Returns true if the file is cut: its program was
/// killed, or is still writing.
///
/// # Errors
///
/// The place in bytes, and the reason, from where on nothing can be read.
pub(crate) fn read(file: &mut dyn BufRead, visitor: &mut dyn Visitor) -> Result<bool, (u64, String)> {
    let mut place = MAGIC.len() as u64;
    let read = split(file, LinearReaderOptions::default(), &mut |opcode, data| {
        let at = place;
        place += HEAD + data.0.len() as u64;
        match opcode {
            op::CHUNK => {
                let chunk = read_chunk(data, at, visitor).map(|()| Record::Other(STRUCTURE));
                visitor.unit(
                    at,
                    chunk.map_err(|reason| Doubt::new("damaged chunks", format!("damaged chunk: {reason}"))),
                );
            }
            _ => visitor.unit(at, parse_file_record(opcode, data)),
        }
    });
    let is_cut = read.map_err(|reason| (place, reason))?;
    let behind = file.fill_buf().map_err(|error| (place, error.to_string()))?;
    if !is_cut && !behind.is_empty() {
        let text = "the file goes on behind its end, as of files that were joined";
        visitor.unit(
            place + MAGIC.len() as u64,
            Err(Doubt::new("bytes behind the end", text)),
        );
    }
    Ok(is_cut)
}

/// Hands the code and the fields of each record to `take`. Returns true if the last one is cut.
fn split(
    source: &mut dyn BufRead,
    options: LinearReaderOptions,
    take: &mut dyn FnMut(u8, Fields<'_>),
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
            Some(Ok(LinearReadEvent::Record { opcode, data })) => take(opcode, Fields(data)),
            Some(Err(McapError::UnexpectedEof)) => return Ok(true),
            Some(Err(error)) => return Err(error.to_string()),
        }
    }
}

/// Hands the records in the chunk at `place` to `visitor`.
fn read_chunk(fields: Fields<'_>, place: u64, visitor: &mut dyn Visitor) -> Result<(), String> {
    let mut records = Chunk::parse(fields)?.records()?;
    let options = LinearReaderOptions::default()
        .with_skip_start_magic(true)
        .with_skip_end_magic(true);
    match split(&mut records, options, &mut |opcode, data| {
        visitor.unit(place, parse_record(opcode, data));
    })? {
        true => Err("a record extends beyond it".to_owned()),
        false if !records.fill_buf().map_err(|error| error.to_string())?.is_empty() => {
            Err("records are behind a footer".to_owned())
        }
        false => Ok(()),
    }
}

pub(crate) fn damaged_record(reason: impl Display) -> Doubt {
    Doubt::new("damaged records", format!("damaged record: {reason}"))
}

/// A record of a file, other than a chunk.
fn parse_file_record(opcode: u8, fields: Fields<'_>) -> Result<Record<'_>, Doubt> {
    match opcode {
        op::HEADER | op::FOOTER | op::DATA_END | op::STATISTICS | op::SUMMARY_OFFSET => Ok(Record::Other(STRUCTURE)),
        op::MESSAGE_INDEX | op::CHUNK_INDEX | op::ATTACHMENT_INDEX | op::METADATA_INDEX => Ok(Record::Other(STRUCTURE)),
        op::ATTACHMENT => Ok(Record::Other("attachments")),
        op::METADATA => Ok(Record::Other("metadata")),
        _ => parse_record(opcode, fields),
    }
}

/// A record that may be in a chunk.
fn parse_record(opcode: u8, fields: Fields<'_>) -> Result<Record<'_>, Doubt> {
    let record = match opcode {
        op::SCHEMA => parse_schema(fields),
        op::CHANNEL => parse_channel(fields),
        op::MESSAGE => parse_message(fields),
        _ => {
            let text = format!("no record with the code {opcode:#04x} belongs here");
            return Err(Doubt::new("unknown records", text));
        }
    };
    record.map_err(damaged_record)
}

fn parse_schema(mut fields: Fields<'_>) -> Result<Record<'_>, String> {
    Ok(Record::Schema {
        id: fields.u16()?,
        name: fields.text()?,
    })
}

fn parse_channel(mut fields: Fields<'_>) -> Result<Record<'_>, String> {
    Ok(Record::Channel {
        id: fields.u16()?,
        schema: fields.u16()?,
        topic: fields.text()?,
        encoding: fields.text()?,
    })
}

fn parse_message(mut fields: Fields<'_>) -> Result<Record<'_>, String> {
    let (channel, sequence, log_time) = (fields.u16()?, fields.u32()?, fields.u64()?);
    let _publish_time = fields.u64()?;
    Ok(Record::Message {
        channel,
        sequence,
        log_time,
        data: fields.0,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The damage in a file.
    #[derive(Default)]
    struct Damage(Vec<String>);

    impl Visitor for Damage {
        fn unit(&mut self, place: u64, record: Result<Record<'_>, Doubt>) {
            self.0
                .extend(record.err().map(|reason| format!("{place}: {}", reason.text)));
        }
    }

    /// The damage of a file that has this chunk, and records behind it.
    fn damage(len: u64, crc: u32, compression: &str, records: &[u8]) -> Vec<String> {
        let mut chunk = vec![0; 16];
        chunk.extend(len.to_le_bytes());
        chunk.extend(crc.to_le_bytes());
        chunk.extend((compression.len() as u32).to_le_bytes());
        chunk.extend(compression.as_bytes());
        chunk.extend((records.len() as u64).to_le_bytes());
        chunk.extend(records);
        let mut file = MAGIC.to_vec();
        file.push(op::CHUNK);
        file.extend((chunk.len() as u64).to_le_bytes());
        file.extend(chunk);
        let behind = file.len();
        file.extend([op::MESSAGE, 1, 0, 0, 0, 0, 0, 0, 0, 1]);
        let mut damage = Damage::default();
        assert_eq!(read(&mut &file[..], &mut damage), Ok(true), "the file has no end");
        assert_eq!(
            damage.0.pop(),
            Some(format!("{behind}: damaged record: it ends within a field"))
        );
        damage.0
    }

    #[test]
    fn damaged_chunk_costs_only_itself() {
        let message = [op::MESSAGE, 1, 0, 0, 0, 0, 0, 0, 0, 1];
        let too_long = [op::MESSAGE, 9, 0, 0, 0, 0, 0, 0, 0, 1];
        let huge_text = [op::SCHEMA, 6, 0, 0, 0, 0, 0, 0, 0, 1, 0, 0xFF, 0xFF, 0xFF, 0xFF];
        for (len, crc, compression, records, reason) in [
            (0, 0, "xz", &[][..], "chunk: compressed with xz, which is not read"),
            (10, 1, "", &message, "chunk: its CRC is wrong"),
            (9, 0, "", &message, "chunk: more bytes of records than its 9"),
            (11, 0, "", &message, "chunk: fewer bytes of records than its 11"),
            (
                1 << 60,
                0,
                "",
                &message,
                "chunk: 1152921504606846976 bytes of records, more than 1073741824",
            ),
            (10, 0, "", &too_long, "chunk: a record extends beyond it"),
            (10, 0, "", &message, "record: it ends within a field"),
            (15, 0, "", &huge_text, "record: it ends within a field"),
        ] {
            assert_eq!(damage(len, crc, compression, records), [format!("8: damaged {reason}")]);
        }
        for compression in ["zstd", "lz4"] {
            assert_eq!(damage(10, 0, compression, &message).len(), 1, "{compression}");
        }
    }
}
