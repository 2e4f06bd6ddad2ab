//! Vector's binary log, BLF.
//!
//! After a header, the file consists of objects, most of them containers with compressed data. The joined contents of
//! the containers are objects again. Those with CAN frames are read. Bytes that are no object are skipped up to the next
//! one. Sizes in the file do not determine memory: containers are decompressed in pieces, and no more of an object is
//! kept than the size of a CAN frame.
//!
//! No library reads a damaged file to its end: `blf_asc` 0.2.0 ends at the first damaged object, `ablf` 0.2.1 panics at a
//! damaged container.

use std::io::{self, ErrorKind, Read, Write};

use armwire_bridge::Instant;
use armwire_bridge::can::Frame;
use flate2::bufread::ZlibDecoder;

use super::{Doubt, Logged, Place, Take, Time, Unit, frame};
use crate::decode::input::Input;
use crate::error::Error;

/// First bytes of a file.
pub(in crate::decode) const SIGNATURE: &[u8] = b"LOGG";
/// First bytes of an object.
const OBJECT: [u8; 4] = *b"LOBJ";
/// Size of an object's shortest header: signature, header size, header version, object size, type.
const BASE_HEADER: usize = 16;
/// Minimum size of a header with a time.
const TIMED_HEADER: usize = 32;
/// Size of a container's fields before its data: compression method, and uncompressed size.
const CONTAINER_HEADER: usize = 16;
/// Maximum number of padding bytes between two objects, which begin at multiples of 4.
const MAX_PADDING: u64 = 7;
/// Maximum size of the file's header, which usually has 144 bytes.
const MAX_HEADER: u32 = 4096;
/// Maximum size of an object. Containers usually have less than 128 KiB.
const MAX_OBJECT: u32 = 1 << 24;
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
    let mut objects = Objects {
        take,
        at: 0,
        gap: Gap::default(),
        kept: Vec::new(),
        rest: 0,
    };
    let mut header = [0; 8];
    fill(input, &mut header, &mut objects)?;
    let size = u32_at(&header, 4).unwrap_or_default();
    if header.starts_with(SIGNATURE) && (header.len() as u32..=MAX_HEADER).contains(&size) {
        (objects.take)(Place::Byte(0), Ok(Unit::Comment));
        skip(input, u64::from(size) - header.len() as u64, &mut objects)?;
    } else {
        // Objects may follow.
        objects.doubt("no header of a BLF file".into());
    }
    while let Some(object) = next_object(input, &mut objects)? {
        match Base::parse(&object) {
            Ok(Base { size, kind, .. }) => {
                let size = u64::from(size) - BASE_HEADER as u64;
                if kind == object::CONTAINER {
                    read_container(input, size, &mut objects)?;
                } else {
                    objects.push(&object);
                    copy(input, size, &mut objects)?;
                }
            }
            Err(reason) => objects.doubt(reason),
        }
    }
    if objects.rest > 0 || !objects.kept.is_empty() {
        objects.doubt(Doubt::cut());
    }
    Ok(())
}

/// The first bytes of the next object; `None` at the end of the file.
fn next_object(input: &mut Input<'_>, objects: &mut Objects<'_, '_>) -> Result<Option<[u8; BASE_HEADER]>, Error> {
    objects.at = input.offset();
    let mut gap = Gap::default();
    loop {
        let mut byte = [0];
        if input.read(&mut byte).map_err(|error| input.failed(error))? == 0 {
            if gap.found > 0 {
                objects.doubt(Doubt::cut());
            }
            return Ok(None);
        }
        match gap.push(byte[0]) {
            Found::Nothing => {}
            Found::Stray => objects.doubt(Doubt::stray()),
            Found::Object => break,
        }
    }
    objects.at = input.offset() - OBJECT.len() as u64;
    let mut object = [0; BASE_HEADER];
    object[..OBJECT.len()].copy_from_slice(&OBJECT);
    let is_whole = fill(input, &mut object[OBJECT.len()..], objects)?;
    Ok(is_whole.then_some(object))
}

/// Reads the contents of a container with `size` bytes after its base header.
fn read_container(input: &mut Input<'_>, size: u64, objects: &mut Objects<'_, '_>) -> Result<(), Error> {
    let Some(size) = size.checked_sub(CONTAINER_HEADER as u64) else {
        objects.doubt("a container without room for its header".into());
        return skip(input, size, objects);
    };
    let mut header = [0; CONTAINER_HEADER];
    if !fill(input, &mut header, objects)? {
        return Ok(());
    }
    let reason = match u16_at(&header, 0).unwrap_or_default() {
        0 => {
            (objects.take)(Place::Byte(objects.at), Ok(Unit::Comment));
            return copy(input, size, objects);
        }
        2 => {
            let mut data = input.take(size);
            let copied = io::copy(&mut ZlibDecoder::new(&mut data), objects);
            let rest = data.limit();
            // Bytes after the compressed data belong to the container.
            match copied {
                Ok(_) => {
                    (objects.take)(Place::Byte(objects.at), Ok(Unit::Comment));
                    return skip(input, rest, objects);
                }
                // The end of the file, or of the container.
                Err(error) if error.kind() == ErrorKind::UnexpectedEof && rest > 0 => Doubt::cut(),
                Err(error) if is_of_data(&error) => {
                    skip(input, rest, objects)?;
                    let text = format!("this container cannot be decompressed: {error}");
                    Doubt::new("damaged container", text)
                }
                Err(error) => return Err(input.failed(error)),
            }
        }
        method => {
            skip(input, size, objects)?;
            let text = format!("compression method {method}, must be 0 or 2");
            Doubt::new("unknown compression", text)
        }
    };
    objects.doubt(reason);
    if !objects.kept.is_empty() {
        objects.doubt("an object in a damaged container".into());
    }
    objects.lose();
    Ok(())
}

/// Returns true for an error of compressed data.
fn is_of_data(error: &io::Error) -> bool {
    use ErrorKind::{InvalidData, InvalidInput, UnexpectedEof};
    matches!(error.kind(), InvalidData | InvalidInput | UnexpectedEof)
}

/// Reads `size` bytes of objects.
fn copy(input: &mut Input<'_>, size: u64, objects: &mut Objects<'_, '_>) -> Result<(), Error> {
    let copied = io::copy(&mut input.take(size), objects);
    if copied.map_err(|error| input.failed(error))? < size {
        // It ends inside the container, if not inside one of its objects.
        objects.lose();
        objects.doubt(Doubt::cut());
    }
    Ok(())
}

/// Skips bytes.
fn skip(input: &mut Input<'_>, size: u64, objects: &mut Objects<'_, '_>) -> Result<(), Error> {
    let skipped = io::copy(&mut input.take(size), &mut io::sink());
    if skipped.map_err(|error| input.failed(error))? < size {
        objects.doubt(Doubt::cut());
    }
    Ok(())
}

/// Fills `bytes`. Returns false if the file ends before.
fn fill(input: &mut Input<'_>, bytes: &mut [u8], objects: &mut Objects<'_, '_>) -> Result<bool, Error> {
    match input.read_exact(bytes) {
        Ok(()) => Ok(true),
        Err(error) if error.kind() == ErrorKind::UnexpectedEof => {
            objects.doubt(Doubt::cut());
            Ok(false)
        }
        Err(error) => Err(input.failed(error)),
    }
}

/// The bytes since the last object.
#[derive(Default)]
struct Gap {
    /// Number of bytes of a signature at the end.
    found: usize,
    len: u64,
    /// Not only padding.
    is_stray: bool,
}

/// The role of a byte in a gap.
enum Found {
    Nothing,
    /// The gap is no padding.
    Stray,
    /// The byte ends a signature.
    Object,
}

impl Gap {
    fn push(&mut self, byte: u8) -> Found {
        if byte == OBJECT[self.found] {
            self.found += 1;
            if self.found < OBJECT.len() {
                return Found::Nothing;
            }
            *self = Self::default();
            return Found::Object;
        }
        let was_stray = self.is_stray;
        self.len += 1;
        self.is_stray |= byte != 0 || self.found > 0 || self.len > MAX_PADDING;
        self.found = usize::from(byte == OBJECT[0]);
        match self.is_stray && !was_stray {
            true => Found::Stray,
            false => Found::Nothing,
        }
    }
}

/// Objects that arrive in pieces.
struct Objects<'t, 'r> {
    take: &'t mut Take<'r>,
    /// Offset of the current object, or of the container it is in.
    at: u64,
    /// The bytes before the current object.
    gap: Gap,
    /// The front of the current object.
    kept: Vec<u8>,
    /// Number of its missing bytes that are not kept.
    rest: u64,
}

impl Write for Objects<'_, '_> {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.push(bytes);
        Ok(bytes.len())
    }

    fn flush(&mut self) -> io::Result<()> {
        Ok(())
    }
}

impl Objects<'_, '_> {
    /// Reads the next bytes.
    fn push(&mut self, mut bytes: &[u8]) {
        while let Some((&first, others)) = bytes.split_first() {
            if self.rest > 0 {
                let n = bytes.len().min(usize::try_from(self.rest).unwrap_or(usize::MAX));
                self.rest -= n as u64;
                bytes = &bytes[n..];
            } else if self.kept.is_empty() {
                bytes = others;
                match self.gap.push(first) {
                    Found::Nothing => {}
                    Found::Stray => self.doubt(Doubt::stray()),
                    Found::Object => self.kept.extend(OBJECT),
                }
            } else {
                let wanted = match self.kept.get(..BASE_HEADER).map(Base::parse) {
                    Some(Ok(base)) => base.kept_size(),
                    _ => BASE_HEADER,
                };
                let n = bytes.len().min(wanted - self.kept.len());
                self.kept.extend_from_slice(&bytes[..n]);
                bytes = &bytes[n..];
                if self.kept.len() == wanted {
                    self.take_kept();
                }
            }
        }
    }

    /// Takes the object in `kept`, which has a header, if it is complete.
    fn take_kept(&mut self) {
        match Base::parse(&self.kept) {
            Ok(base) if self.kept.len() < base.kept_size() => {}
            Ok(base) => {
                self.rest = u64::from(base.size) - self.kept.len() as u64;
                take_record(&self.kept, Place::Byte(self.at), self.take);
                self.kept.clear();
            }
            Err(reason) => {
                self.doubt(reason);
                self.kept.clear();
            }
        }
    }

    /// Forgets the current object: the bytes after these are lost.
    fn lose(&mut self) {
        self.kept.clear();
        self.rest = 0;
        // The reason was given.
        self.gap.is_stray = true;
    }

    /// Passes on that something at the current place is not understood.
    fn doubt(&mut self, reason: Doubt) {
        (self.take)(Place::Byte(self.at), Err(reason));
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
    /// The header of an object, after its signature.
    fn parse(object: &[u8]) -> Result<Self, Doubt> {
        let header = u16_at(object, 4).zip(u32_at(object, 8)).zip(u32_at(object, 12));
        match header {
            Some(((header, size), kind)) if (BASE_HEADER as u32..=MAX_OBJECT).contains(&size) => {
                Ok(Self { header, size, kind })
            }
            Some(((_, size), _)) if size > MAX_OBJECT => {
                Err(Doubt::new("no size of an object", format!("an object of {size} bytes")))
            }
            _ => Err("an object that is shorter than its header".into()),
        }
    }

    /// Number of bytes to keep of the object.
    fn kept_size(&self) -> usize {
        (self.size as usize).min(MAX_KEPT)
    }
}

/// Passes the record of an object with this front to `take`.
fn take_record(object: &[u8], place: Place<'_>, take: &mut Take<'_>) {
    let record = event(object).and_then(|event| match event {
        Some((at, stamp, event)) => {
            let bus = event.bus.to_string();
            let logged = |frame| Logged::whole(Time::seconds(at, stamp), bus, frame);
            event.frame().map(|frame| Unit::Can(logged(frame)))
        }
        None => Ok(Unit::Other("other events")),
    });
    take(place, record);
}

/// The frame or error frame in an object with this front, and its time, also as text. `None` for any other object.
fn event(object: &[u8]) -> Result<Option<(Instant, String, BusEvent<'_>)>, Doubt> {
    let Base { header, kind, .. } = Base::parse(object)?;
    let parse = match kind {
        object::CAN_MESSAGE | object::CAN_MESSAGE2 => classic,
        object::CAN_FD_MESSAGE => fd,
        object::CAN_FD_MESSAGE_64 => fd_64,
        object::CAN_ERROR | object::CAN_ERROR_EXT | object::CAN_FD_ERROR_64 => error,
        object::CONTAINER => return Err("a container in a container".into()),
        _ => return Ok(None),
    };
    let header = usize::from(header);
    let time = object.get(BASE_HEADER..TIMED_HEADER).and_then(time);
    let data = object.get(header..).filter(|_| header >= TIMED_HEADER);
    let ((at, stamp), event) = time
        .zip(data.and_then(parse))
        .ok_or("a CAN frame that is longer than its object")?;
    Ok((!event.is_request).then_some((at, stamp, event)))
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
    /// The data in the object. Zeros may follow in the frame.
    data: &'a [u8],
    /// Length of the frame's data.
    len: usize,
}

impl BusEvent<'_> {
    /// The frame; `None` as in [`Logged`].
    fn frame(&self) -> Result<Option<Frame>, Doubt> {
        if !self.has_data {
            return Ok(None);
        }
        let mut data = self.data.to_vec();
        data.resize(self.len, 0);
        frame(self.id & !EXTENDED, self.id & EXTENDED != 0, self.is_fd, &data)
    }
}

/// The bit of 29-bit identifiers.
const EXTENDED: u32 = 1 << 31;
/// The direction of a transmit request. Received frames have 0, sent frames 1.
const REQUEST: u8 = 2;

fn classic(object: &[u8]) -> Option<BusEvent<'_>> {
    let (flags, dlc) = (*object.get(2)?, *object.get(3)?);
    // A classic frame has at most 8 bytes, also if its length code is higher.
    let len = usize::from(dlc.min(8));
    Some(BusEvent {
        bus: u16_at(object, 0)?,
        id: u32_at(object, 4)?,
        is_request: flags & 0x0F == REQUEST,
        has_data: flags & 0x80 == 0,
        is_fd: false,
        data: object.get(8..8 + len)?,
        len,
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
        data: up_to(object.get(20..)?, len),
        len: len.into(),
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
        data: up_to(object.get(40..)?, len),
        len: len.into(),
    })
}

/// The first `len` bytes, or as many as are there. Some programs leave out the zeros at the end of an FD frame.
fn up_to(bytes: &[u8], len: u8) -> &[u8] {
    &bytes[..bytes.len().min(len.into())]
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
