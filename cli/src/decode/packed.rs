//! Compressed recordings and text in UTF-16, unpacked while they are read.

use std::io::{self, BufRead, BufReader, Chain, Cursor, Error, ErrorKind, Read};

use flate2::bufread::MultiGzDecoder;
use ruzstd::decoding::errors::{FrameDecoderError, ReadFrameHeaderError};
use ruzstd::decoding::{BlockDecodingStrategy, FrameDecoder};

/// Size of the buffer before a decoder, in bytes.
const CAPACITY: usize = 32 * 1024;
/// Maximum window of a zstd frame, in bytes: levels up to 19 need a quarter of it.
const MAX_WINDOW: u64 = 32 * 1024 * 1024;

/// The first bytes of a packed recording. `None` is the byte of an ASCII character. A raw recording may begin with a byte
/// order mark by chance, but hardly with the first character, too.
const MARKS: [(&[Option<u8>], Packing); 6] = [
    (&[Some(0x1F), Some(0x8B), Some(8)], Packing::Gzip),
    (&[Some(0x28), Some(0xB5), Some(0x2F), Some(0xFD)], Packing::Zstd),
    (
        &[Some(0xFF), Some(0xFE), None, Some(0)],
        Packing::Utf16(u16::from_le_bytes),
    ),
    (
        &[Some(0xFE), Some(0xFF), Some(0), None],
        Packing::Utf16(u16::from_be_bytes),
    ),
    // Without a byte order mark.
    (
        &[None, Some(0), None, Some(0), None, Some(0), None, Some(0)],
        Packing::Utf16(u16::from_le_bytes),
    ),
    (
        &[Some(0), None, Some(0), None, Some(0), None, Some(0), None],
        Packing::Utf16(u16::from_be_bytes),
    ),
];

#[derive(Clone, Copy)]
enum Packing {
    Gzip,
    Zstd,
    /// The order of the bytes in a unit.
    Utf16(fn([u8; 2]) -> u16),
}

/// A source with the bytes that were read to detect its packing.
type Detected<'a> = BufReader<Chain<Cursor<Vec<u8>>, Box<dyn Read + 'a>>>;

/// A recording, unpacked by its first bytes.
pub(super) enum Unpacked<'a> {
    /// Nothing was read yet.
    New(Box<dyn Read + 'a>),
    Open(Box<dyn Read + 'a>),
}

impl<'a> Unpacked<'a> {
    pub(super) fn new(source: Box<dyn Read + 'a>) -> Self {
        Self::New(source)
    }
}

impl Read for Unpacked<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        if let Self::New(source) = self {
            let source = std::mem::replace(source, Box::new(io::empty()));
            *self = Self::Open(open(source)?);
        }
        match self {
            Self::New(source) | Self::Open(source) => source.read(bytes),
        }
    }
}

/// Detects the packing. Reads no further than the first byte that decides.
fn open<'a>(mut source: Box<dyn Read + 'a>) -> io::Result<Box<dyn Read + 'a>> {
    let mut front = Vec::new();
    let mut byte = [0];
    while may_be_packed(&front) && packing(&front).is_none() && read_some(&mut source, &mut byte)? > 0 {
        front.push(byte[0]);
    }
    let packing = packing(&front);
    let source = Cursor::new(front).chain(source);
    let buffered = |source| Detected::with_capacity(CAPACITY, source);
    Ok(match packing {
        None => Box::new(source),
        Some(Packing::Gzip) => Box::new(MultiGzDecoder::new(buffered(source))),
        Some(Packing::Zstd) => Box::new(Zstd::new(buffered(source))),
        Some(Packing::Utf16(unit)) => Box::new(Utf16::new(buffered(source), unit)),
    })
}

fn read_some(source: &mut dyn Read, bytes: &mut [u8]) -> io::Result<usize> {
    loop {
        match source.read(bytes) {
            Err(error) if error.kind() == ErrorKind::Interrupted => {}
            read => return read,
        }
    }
}

/// Returns true if a mark begins with these bytes.
fn may_be_packed(front: &[u8]) -> bool {
    MARKS.iter().any(|(mark, _)| is_front(front, mark))
}

fn packing(front: &[u8]) -> Option<Packing> {
    let found = MARKS
        .iter()
        .find(|(mark, _)| front.len() == mark.len() && is_front(front, mark));
    found.map(|(_, packing)| *packing)
}

fn is_front(front: &[u8], mark: &[Option<u8>]) -> bool {
    let is_text = |byte: u8| byte.is_ascii_graphic() || byte.is_ascii_whitespace();
    front
        .iter()
        .zip(mark)
        .all(|(&byte, mark)| mark.map_or(is_text(byte), |mark| byte == mark))
}

/// The frames of a zstd file.
struct Zstd<'a> {
    source: Detected<'a>,
    frame: FrameDecoder,
    is_begun: bool,
    /// The error that ended the frame, returned behind what was decoded before.
    error: Option<Error>,
}

/// An empty block that ends a frame, and a checksum.
const LAST_BLOCK: &[u8] = &[1, 0, 0, 0, 0, 0, 0];

impl<'a> Zstd<'a> {
    fn new(source: Detected<'a>) -> Self {
        let mut frame = FrameDecoder::new();
        frame.set_max_window_size(MAX_WINDOW);
        Self {
            source,
            frame,
            is_begun: false,
            error: None,
        }
    }

    /// Begins the next frame. Returns false at the end.
    fn begin(&mut self) -> io::Result<bool> {
        while !self.source.fill_buf()?.is_empty() {
            match self.frame.reset(&mut self.source) {
                Ok(()) => return Ok(true),
                Err(FrameDecoderError::ReadFrameHeaderError(ReadFrameHeaderError::SkipFrame { length, .. })) => {
                    io::copy(&mut self.source.by_ref().take(length.into()), &mut io::sink())?;
                }
                Err(FrameDecoderError::WindowSizeTooBig { requested, max }) => {
                    let text = format!("the zstd data needs a window of {requested} bytes, the maximum is {max}");
                    return Err(Error::new(ErrorKind::Unsupported, text));
                }
                Err(error) => return Err(damaged(error)),
            }
        }
        Ok(false)
    }

    /// Decodes a block. The decoder gives the last bytes of a frame once it has ended: a damaged one is ended.
    fn decode_block(&mut self) {
        let one = || BlockDecodingStrategy::UptoBlocks(1);
        if let Err(error) = self.frame.decode_blocks(&mut self.source, one()) {
            self.error = Some(damaged(error));
            // Without its end, what is in the window is lost.
            let _ = self.frame.decode_blocks(LAST_BLOCK, one());
        }
    }

    /// Checks the checksum of a frame that has ended.
    fn check(&self) -> io::Result<()> {
        match (
            self.frame.get_checksum_from_data(),
            self.frame.get_calculated_checksum(),
        ) {
            (Some(expected), Some(got)) if expected != got => Err(damaged("wrong checksum")),
            _ => Ok(()),
        }
    }
}

fn damaged(reason: impl std::fmt::Display) -> Error {
    Error::new(ErrorKind::InvalidData, format!("the zstd data is damaged: {reason}"))
}

impl Read for Zstd<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        loop {
            if !self.is_begun {
                self.is_begun = self.begin()?;
            }
            if !self.is_begun || bytes.is_empty() {
                return Ok(0);
            }
            let n = self.frame.read(bytes)?;
            if n > 0 {
                return Ok(n);
            }
            match self.error.take() {
                Some(error) => return Err(error),
                None if self.frame.is_finished() => {
                    self.check()?;
                    self.is_begun = false;
                }
                None => self.decode_block(),
            }
        }
    }
}

/// Text in UTF-16, read as UTF-8.
struct Utf16<'a> {
    source: Detected<'a>,
    unit: fn([u8; 2]) -> u16,
    /// The first unit of a pair.
    high: Option<u16>,
    text: Cursor<Vec<u8>>,
}

impl<'a> Utf16<'a> {
    fn new(source: Detected<'a>, unit: fn([u8; 2]) -> u16) -> Self {
        Self {
            source,
            unit,
            high: None,
            text: Cursor::new(Vec::new()),
        }
    }

    /// Reads one unit, or none at the end.
    fn unit(&mut self) -> io::Result<Option<u16>> {
        let [mut first, mut second] = [[0]; 2];
        if read_some(&mut self.source, &mut first)? == 0 {
            return Ok(None);
        }
        if read_some(&mut self.source, &mut second)? == 0 {
            let text = "the text in UTF-16 ends within a character";
            return Err(Error::new(ErrorKind::UnexpectedEof, text));
        }
        Ok(Some((self.unit)([first[0], second[0]])))
    }
}

impl Read for Utf16<'_> {
    fn read(&mut self, bytes: &mut [u8]) -> io::Result<usize> {
        let n = self.text.read(bytes)?;
        if n > 0 || bytes.is_empty() {
            return Ok(n);
        }
        let mut text = String::new();
        // Bytes are decoded as they come: a program may still write the rest.
        while text.is_empty() || self.source.buffer().len() > 1 {
            let Some(unit) = self.unit()? else { break };
            let units = self.high.take().into_iter().chain([unit]);
            if (0xD800..0xDC00).contains(&unit) && units.clone().count() == 1 {
                self.high = Some(unit);
                continue;
            }
            text.extend(char::decode_utf16(units).map(|character| character.unwrap_or(char::REPLACEMENT_CHARACTER)));
        }
        // The rest of a pair that is cut.
        if text.is_empty() && self.high.take().is_some() {
            text.push(char::REPLACEMENT_CHARACTER);
        }
        self.text = Cursor::new(text.into_bytes());
        self.text.read(bytes)
    }
}
