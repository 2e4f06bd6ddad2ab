//! Vector's binary log, BLF.
//!
//! After a header, the file consists of objects, most of them containers with compressed data. The joined contents of
//! the containers are objects again. Those with CAN frames are read. Sizes in the file do not determine memory:
//! containers are decompressed in pieces, and no more of an object is kept than the size of a CAN frame.

use std::io::{self, BufRead, ErrorKind, Read, Write};

use armwire_bridge::Instant;
use flate2::bufread::ZlibDecoder;

use super::{Logged, Record, Take, Time, frame};
use crate::decode::input::Input;
use crate::error::Error;

/// First bytes of a file.
pub(in crate::decode) const SIGNATURE: &[u8] = b"LOGG";
/// First bytes of an object.
const OBJECT: &[u8] = b"LOBJ";
/// Size of an object's shortest header: signature, header size, header version, object size, type.
const BASE_HEADER: usize = 16;
/// Minimum size of a header with a time.
const TIMED_HEADER: usize = 32;
/// Size of a container's fields before its data: compression method, and uncompressed size.
const CONTAINER_HEADER: usize = 16;
/// Maximum number of padding bytes between two objects, which begin at multiples of 4.
const MAX_PADDING: usize = 7;
/// Maximum number of bytes kept of an object. A frame of 64 bytes with the longest header has 144.
const MAX_KEPT: usize = 256;

/// Types of objects.
mod object {
    pub(super) const CAN_MESSAGE: u32 = 1;
    pub(super) const CAN_ERROR: u32 = 2;
    pub(super) const CONTAINER: u32 = 10;
    pub(super) const CAN_ERROR_EXT: u32 = 73;
    pub(super) const CAN_MESSAGE2: u32 = 86;
    pub(super) const CAN_FD_MESSAGE: u32 = 100;
    pub(super) const CAN_FD_MESSAGE_64: u32 = 101;
    pub(super) const CAN_FD_ERROR_64: u32 = 104;
}

/// Passes each record of a file to `take`.
pub(in crate::decode) fn read(input: &mut Input<'_>, take: &mut Take<'_>) -> Result<(), Error> {
    let header = read_exactly::<8>(input, "the header")?;
    let size = u32_at(&header, 4).unwrap_or_default();
    if !header.starts_with(SIGNATURE) {
        return Err(input.refused_at(0, "this is not a BLF file"));
    }
    let rest = u64::from(size).checked_sub(header.len() as u64);
    let rest = rest.ok_or_else(|| input.refused_at(4, "the header is shorter than its beginning"))?;
    skip(input, rest, "the header")?;

    let mut objects = Objects {
        take,
        kept: Vec::new(),
        rest: 0,
        padding: 0,
    };
    while let Some((at, base)) = next_object(input)? {
        let Base { size, kind, .. } = Base::parse(&base).map_err(|reason| input.refused_at(at, &reason))?;
        let size = u64::from(size) - BASE_HEADER as u64;
        if kind == object::CONTAINER {
            read_container(input, at, size, &mut objects)?;
        } else {
            objects.push(&base).map_err(|reason| input.refused_at(at, &reason))?;
            copy(input, at, size, &mut objects)?;
        }
    }
    match objects.rest == 0 && objects.kept.is_empty() {
        true => Ok(()),
        false => Err(input.refused_at(input.offset(), "the log ends within an object")),
    }
}

/// The offset and the first bytes of the next object; `None` at the end of the file.
fn next_object(input: &mut Input<'_>) -> Result<Option<(u64, [u8; BASE_HEADER])>, Error> {
    for _ in 0..=MAX_PADDING {
        match input.fill_buf().map(|bytes| bytes.first().copied()) {
            Ok(None) => return Ok(None),
            Ok(Some(0)) => input.consume(1),
            Ok(Some(_)) => {
                let at = input.offset();
                return Ok(Some((at, read_exactly(input, "an object")?)));
            }
            Err(error) => return Err(input.failed(error)),
        }
    }
    Err(input.refused_at(input.offset(), "no object starts here"))
}

/// Reads the contents of the container at offset `at`, with `size` bytes after its base header.
fn read_container(input: &mut Input<'_>, at: u64, size: u64, objects: &mut Objects<'_, '_>) -> Result<(), Error> {
    let size = size.checked_sub(CONTAINER_HEADER as u64);
    let size = size.ok_or_else(|| input.refused_at(at, "a container without room for its header"))?;
    let header = read_exactly::<CONTAINER_HEADER>(input, "a container")?;
    match u16_at(&header, 0).unwrap_or_default() {
        0 => copy(input, at, size, objects),
        2 => {
            let mut data = input.take(size);
            let copied = io::copy(&mut ZlibDecoder::new(&mut data), objects);
            let rest = data.limit();
            copied.map_err(|error| match error.kind() {
                ErrorKind::UnexpectedEof => input.refused_at(at, "the log ends within this container"),
                ErrorKind::InvalidInput | ErrorKind::InvalidData => {
                    input.refused_at(at, &format!("this container cannot be decompressed: {error}"))
                }
                _ => not_copied(input, at, error),
            })?;
            // Bytes after the compressed data belong to the container.
            skip(input, rest, "a container")
        }
        method => {
            let reason = format!("compression method {method}, must be 0 or 2");
            Err(input.refused_at(at, &reason))
        }
    }
}

/// Reads `size` bytes of objects, in an object at offset `at`.
fn copy(input: &mut Input<'_>, at: u64, size: u64, objects: &mut Objects<'_, '_>) -> Result<(), Error> {
    match io::copy(&mut input.take(size), objects) {
        Ok(copied) if copied == size => Ok(()),
        Ok(_) => Err(input.refused_at(at, "the log ends within this object")),
        Err(error) => Err(not_copied(input, at, error)),
    }
}

/// The error of a copy that failed to read, or whose objects were refused.
fn not_copied(input: &Input<'_>, at: u64, error: io::Error) -> Error {
    match error.downcast() {
        Ok(Refused(reason)) => input.refused_at(at, &reason),
        Err(error) => input.failed(error),
    }
}

/// The reason for refused objects.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
struct Refused(String);

/// Objects that arrive in pieces.
struct Objects<'t, 'r> {
    take: &'t mut Take<'r>,
    /// The front of the current object.
    kept: Vec<u8>,
    /// Number of its missing bytes that are not kept.
    rest: u64,
    /// Number of bytes since the last object.
    padding: usize,
}

impl Write for Objects<'_, '_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.push(bytes).map_err(|reason| io::Error::other(Refused(reason)))?;
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Objects<'_, '_> {
    /// Reads the next bytes.
    fn push(&mut self, mut bytes: &[u8]) -> Result<(), String> {
        while !bytes.is_empty() {
            if self.rest > 0 {
                let n = bytes.len().min(usize::try_from(self.rest).unwrap_or(usize::MAX));
                self.rest -= n as u64;
                bytes = &bytes[n..];
                continue;
            }
            if self.kept.is_empty() && bytes[0] == 0 && self.padding < MAX_PADDING {
                self.padding += 1;
                bytes = &bytes[1..];
                continue;
            }
            let mut wanted = BASE_HEADER;
            if self.kept.len() >= BASE_HEADER {
                wanted = Base::parse(&self.kept)?.kept_size();
            }
            let n = bytes.len().min(wanted - self.kept.len());
            self.kept.extend_from_slice(&bytes[..n]);
            bytes = &bytes[n..];
            if self.kept.len() < BASE_HEADER {
                continue;
            }
            let base = Base::parse(&self.kept)?;
            if self.kept.len() == base.kept_size() {
                self.padding = 0;
                self.rest = u64::from(base.size) - self.kept.len() as u64;
                take_record(&self.kept, self.take)?;
                self.kept.clear();
            }
        }
        Ok(())
    }
}

/// The header of every object.
struct Base {
    /// Size of all headers.
    header: u16,
    /// Size of headers and data, at least that of this header.
    size: u32,
    kind: u32,
}

impl Base {
    fn parse(object: &[u8]) -> Result<Self, String> {
        if !object.starts_with(OBJECT) {
            return Err("no object starts here".to_owned());
        }
        let (header, size, kind) = (u16_at(object, 4), u32_at(object, 8), u32_at(object, 12));
        match (header, size, kind) {
            (Some(header), Some(size), Some(kind)) if size >= BASE_HEADER as u32 => Ok(Self { header, size, kind }),
            _ => Err("an object that is shorter than its header".to_owned()),
        }
    }

    /// Number of bytes to keep of the object.
    fn kept_size(&self) -> usize {
        (self.size as usize).min(MAX_KEPT)
    }
}

/// Passes the record of an object with this front to `take`.
fn take_record(object: &[u8], take: &mut Take<'_>) -> Result<(), String> {
    let Base { header, kind, .. } = Base::parse(object)?;
    let parse = match kind {
        object::CAN_MESSAGE | object::CAN_MESSAGE2 => classic,
        object::CAN_FD_MESSAGE => fd,
        object::CAN_FD_MESSAGE_64 => fd_64,
        object::CAN_ERROR | object::CAN_ERROR_EXT | object::CAN_FD_ERROR_64 => error,
        object::CONTAINER => return Err("a container in a container".to_owned()),
        _ => return take(Record::Other),
    };
    let too_short = || "a CAN frame that is longer than its object".to_owned();
    let header = usize::from(header);
    let (at, stamp) = object
        .get(BASE_HEADER..TIMED_HEADER)
        .and_then(time)
        .ok_or_else(too_short)?;
    let data = object.get(header..).filter(|_| header >= TIMED_HEADER);
    let event = data.and_then(parse).ok_or_else(too_short)?;
    if event.is_request {
        return take(Record::Other);
    }
    let frame = match event.has_data {
        true => {
            let (id, is_extended) = (event.id & !EXTENDED, event.id & EXTENDED != 0);
            frame(id, is_extended, event.is_fd, event.data.ok_or_else(too_short)?)?
        }
        false => None,
    };
    take(Record::Frame(Logged {
        time: Time::seconds(at, &stamp),
        bus: &event.bus.to_string(),
        frame,
    }))
}

/// The time in a header, after its first 16 bytes, and its text in seconds.
fn time(header: &[u8]) -> Option<(Instant, String)> {
    /// The unit of time is 10 µs instead of 1 ns.
    const TEN_MICROS: u32 = 1;
    let (flags, time) = (u32_at(header, 0)?, u64_at(header, 8)?);
    let nanos = match flags {
        TEN_MICROS => u128::from(time) * 10_000,
        _ => u128::from(time),
    };
    let (seconds, fraction) = (nanos / 1_000_000_000, nanos % 1_000_000_000);
    let micros = u64::try_from(nanos / 1_000).ok()?;
    Some((Instant::from_micros(micros), format!("{seconds}.{fraction:09}")))
}

/// An object of a bus.
#[derive(Default)]
struct BusEvent<'a> {
    bus: u16,
    /// The identifier; bit 31 is set for 29 bits.
    id: u32,
    /// A transmit request: the frame was not on the bus.
    is_request: bool,
    /// False for remote frames and error frames.
    has_data: bool,
    is_fd: bool,
    /// `None` if the object is too short.
    data: Option<&'a [u8]>,
}

/// The bit of 29-bit identifiers.
const EXTENDED: u32 = 1 << 31;
/// The direction of a transmit request. Received frames have 0, sent frames 1.
const REQUEST: u8 = 2;

fn classic(object: &[u8]) -> Option<BusEvent<'_>> {
    let (flags, dlc) = (*object.get(2)?, *object.get(3)?);
    Some(BusEvent {
        bus: u16_at(object, 0)?,
        id: u32_at(object, 4)?,
        is_request: flags & 0x0F == REQUEST,
        has_data: flags & 0x80 == 0,
        is_fd: false,
        // A classic frame has at most 8 bytes, also if its length code is higher.
        data: object.get(8..8 + usize::from(dlc.min(8))),
    })
}

fn fd(object: &[u8]) -> Option<BusEvent<'_>> {
    let (flags, fd_flags, len) = (*object.get(2)?, *object.get(13)?, *object.get(14)?);
    Some(BusEvent {
        bus: u16_at(object, 0)?,
        id: u32_at(object, 4)?,
        is_request: flags & 0x0F == REQUEST,
        has_data: flags & 0x80 == 0,
        is_fd: fd_flags & 1 != 0,
        data: object.get(20..20 + usize::from(len)),
    })
}

fn fd_64(object: &[u8]) -> Option<BusEvent<'_>> {
    let (len, flags, direction) = (*object.get(2)?, u32_at(object, 12)?, *object.get(34)?);
    Some(BusEvent {
        bus: u16::from(*object.first()?),
        id: u32_at(object, 4)?,
        is_request: direction == REQUEST,
        has_data: flags & 0x10 == 0,
        is_fd: flags & 0x1000 != 0,
        data: object.get(40..40 + usize::from(len)),
    })
}

fn error(object: &[u8]) -> Option<BusEvent<'_>> {
    Some(BusEvent {
        bus: u16_at(object, 0)?,
        ..BusEvent::default()
    })
}

fn u16_at(bytes: &[u8], at: usize) -> Option<u16> {
    Some(u16::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u32_at(bytes: &[u8], at: usize) -> Option<u32> {
    Some(u32::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

fn u64_at(bytes: &[u8], at: usize) -> Option<u64> {
    Some(u64::from_le_bytes(*bytes.get(at..)?.first_chunk()?))
}

/// Reads the next bytes. If the file ends before, the error names `what`.
fn read_exactly<const N: usize>(input: &mut Input<'_>, what: &str) -> Result<[u8; N], Error> {
    let mut bytes = [0; N];
    let at = input.offset();
    match input.read_exact(&mut bytes) {
        Ok(()) => Ok(bytes),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
            Err(input.refused_at(at, &format!("the log ends within {what}")))
        }
        Err(error) => Err(input.failed(error)),
    }
}

/// Skips bytes. If the file ends before, the error names `what`.
fn skip(input: &mut Input<'_>, bytes: u64, what: &str) -> Result<(), Error> {
    let at = input.offset();
    match io::copy(&mut input.take(bytes), &mut io::sink()) {
        Ok(skipped) if skipped == bytes => Ok(()),
        Ok(_) => Err(input.refused_at(at, &format!("the log ends within {what}"))),
        Err(error) => Err(input.failed(error)),
    }
}
