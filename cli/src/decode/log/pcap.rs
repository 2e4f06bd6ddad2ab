//! Captures of Wireshark and tcpdump, pcap and pcapng, with frames of SocketCAN.

use std::io::{BufRead, Read};

use armwire_bridge::Instant;
use armwire_bridge::can::MAX_FD;
use pcap_parser::nom::Err as Nom;
use pcap_parser::traits::PcapNGPacketBlock;
use pcap_parser::{
    Block, InterfaceDescriptionBlock, Linktype, PcapHeader, parse_block_be, parse_block_le, parse_pcap_frame,
    parse_pcap_frame_be, parse_pcap_header,
};

use super::{Doubt, Logged, Place, Record, Take, Time, frame};
use crate::decode::input::Input;
use crate::error::Error;

/// First bytes of files: pcap in either order of bytes, with microseconds or nanoseconds, and pcapng.
pub(in crate::decode) const SIGNATURES: [&[u8]; 5] = [
    b"\xD4\xC3\xB2\xA1",
    b"\xA1\xB2\xC3\xD4",
    b"\x4D\x3C\xB2\xA1",
    b"\xA1\xB2\x3C\x4D",
    b"\x0A\x0D\x0D\x0A",
];

/// The link type of SocketCAN, and the one of `any` interface: "Linux cooked" (<https://www.tcpdump.org/linktypes.html>).
const SOCKETCAN: Linktype = Linktype(227);
const COOKED: Linktype = Linktype(113);
/// Size of the header of a cooked packet, and its protocols for classic frames and FD frames.
const COOKED_HEADER: usize = 16;
const COOKED_CAN: [[u8; 2]; 2] = [[0x00, 0x0C], [0x00, 0x0D]];

/// Maximum size of a block, in bytes: more than that of a packet on any network.
const MAX_BLOCK: usize = 70_000;
/// Size of a packet's header in a pcap file.
const PACKET_HEADER: usize = 16;
/// Number of bytes read at once, at most.
const PIECE: usize = 8 * 1024;

/// Passes each record of a capture to `take`.
pub(in crate::decode) fn read(input: &mut Input<'_>, take: &mut Take<'_>) -> Result<(), Error> {
    let mut buffer = Buffer {
        input,
        bytes: Vec::new(),
        start: 0,
        offset: 0,
    };
    while buffer.rest().len() < SIGNATURES[0].len() && buffer.fill()? {}
    let mut capture = Capture::new(match buffer.rest().starts_with(SIGNATURES[4]) {
        true => Kind::Pcapng,
        false => Kind::Pcap,
    });
    loop {
        let rest = buffer.rest();
        let offset = buffer.offset;
        let place = Place::Byte(offset);
        let parsed = match capture.kind {
            _ if !capture.may_be_block(rest) => Parsed::Damaged,
            Kind::Pcapng => capture.pcapng_block(rest, place, take),
            Kind::Pcap => capture.pcap_packet(rest, place, take),
        };
        match parsed {
            Parsed::Block(len) => buffer.consume(len),
            Parsed::Incomplete if rest.len() < MAX_BLOCK && buffer.fill()? => {}
            Parsed::Incomplete if buffer.rest().is_empty() => return Ok(()),
            Parsed::Incomplete | Parsed::Damaged => {
                let goes_on = capture.skip_to_block(&mut buffer)?;
                let is_cut = matches!(parsed, Parsed::Incomplete) && !goes_on;
                take(place, Err(if is_cut { Doubt::cut() } else { "damaged block".into() }));
                if !goes_on {
                    return Ok(());
                }
            }
        }
    }
}

/// The bytes of a file, as far as they are needed.
struct Buffer<'b, 'i> {
    input: &'b mut Input<'i>,
    bytes: Vec<u8>,
    /// Number of bytes that are consumed.
    start: usize,
    /// The offset in the file of the byte after them.
    offset: u64,
}

impl Buffer<'_, '_> {
    fn rest(&self) -> &[u8] {
        &self.bytes[self.start..]
    }

    fn consume(&mut self, len: usize) {
        self.start += len;
        self.offset += len as u64;
    }

    /// Reads more bytes. Returns false at the end of the file.
    fn fill(&mut self) -> Result<bool, Error> {
        self.bytes.drain(..self.start);
        self.start = 0;
        let piece = self.input.fill_buf().map(|bytes| bytes.len().min(PIECE));
        let piece = piece.map_err(|error| self.input.failed(error))?;
        let read = self.input.take(piece as u64).read_to_end(&mut self.bytes);
        read.map(|read| read > 0).map_err(|error| self.input.failed(error))
    }
}

/// The result of parsing a block.
enum Parsed {
    /// A block of this length.
    Block(usize),
    Incomplete,
    Damaged,
}

impl Parsed {
    fn failed<E>(error: &Nom<E>) -> Self {
        match error {
            Nom::Incomplete(_) => Self::Incomplete,
            Nom::Error(_) | Nom::Failure(_) => Self::Damaged,
        }
    }
}

/// The kind of a capture.
#[derive(Clone, Copy)]
enum Kind {
    Pcap,
    Pcapng,
}

/// The state of a capture's reader.
struct Capture {
    kind: Kind,
    /// The header of a pcap file.
    header: Option<PcapHeader>,
    /// The order of bytes in a pcapng file.
    is_big_endian: bool,
    /// The interfaces of the current section of a pcapng file.
    interfaces: Vec<Interface>,
    /// The time of the last packet of a pcap file, in seconds.
    seconds: Option<u32>,
}

/// An interface of a pcapng file.
struct Interface {
    name: String,
    link: Linktype,
    /// Units of time in a second, and seconds before them.
    resolution: u64,
    offset: i64,
}

impl Interface {
    fn new(block: &InterfaceDescriptionBlock<'_>, index: usize) -> Self {
        let name = block.if_name().and_then(Result::ok).map(str::to_owned);
        Self {
            name: name.unwrap_or_else(|| index.to_string()),
            link: block.linktype,
            resolution: block
                .ts_resolution()
                .filter(|resolution| *resolution > 0)
                .unwrap_or(1_000_000),
            offset: block.ts_offset(),
        }
    }

    /// The time of a packet in nanoseconds.
    fn nanos(&self, time: u64) -> u64 {
        let nanos = i128::from(time) * 1_000_000_000 / i128::from(self.resolution);
        let nanos = nanos + i128::from(self.offset) * 1_000_000_000;
        u64::try_from(nanos).unwrap_or_default()
    }
}

impl Capture {
    fn new(kind: Kind) -> Self {
        Self {
            kind,
            header: None,
            is_big_endian: false,
            interfaces: Vec::new(),
            seconds: None,
        }
    }

    /// Returns false if no block begins with these bytes.
    fn may_be_block(&self, bytes: &[u8]) -> bool {
        let (fraction, len) = (self.word(bytes, 4), self.word(bytes, 8));
        match self.kind {
            Kind::Pcap if self.header.is_some() => {
                fraction.is_none_or(|fraction| fraction < self.max_fraction())
                    && len.is_none_or(|len| len as usize <= MAX_BLOCK)
            }
            Kind::Pcap | Kind::Pcapng => true,
        }
    }

    /// The number of units in a second of a pcap file.
    fn max_fraction(&self) -> u32 {
        match self.header.as_ref().is_some_and(PcapHeader::is_nanosecond_precision) {
            true => 1_000_000_000,
            false => 1_000_000,
        }
    }

    /// Skips bytes up to the next block, at least one. Returns false at the end of the file.
    fn skip_to_block(&self, buffer: &mut Buffer<'_, '_>) -> Result<bool, Error> {
        buffer.consume(1);
        loop {
            let rest = buffer.rest();
            let found = (0..rest.len()).find_map(|at| match self.begins_block(&rest[at..]) {
                Some(false) => None,
                begins => Some((at, begins)),
            });
            let (at, begins) = found.unwrap_or((rest.len(), None));
            buffer.consume(at);
            if begins == Some(true) {
                return Ok(true);
            }
            if !buffer.fill()? {
                // Nothing, or the beginning of a block.
                let ends = matches!(self.kind, Kind::Pcap) && self.ends_in_packet(buffer.rest());
                if ends || buffer.rest().is_empty() {
                    return Ok(ends);
                }
                buffer.consume(1);
            }
        }
    }

    /// Returns true if a block begins with these bytes; `None` if more are needed.
    fn begins_block(&self, bytes: &[u8]) -> Option<bool> {
        match self.kind {
            Kind::Pcapng => self.begins_pcapng_block(bytes),
            Kind::Pcap => {
                let Some(len) = self.packet_len(bytes)? else {
                    return Some(false);
                };
                // Any bytes may be the header of a packet, but not those of the next one, too.
                Some(self.packet_len(bytes.get(len..)?)?.is_some())
            }
        }
    }

    /// Returns true if a known block begins with these bytes, and its length is at its end again.
    fn begins_pcapng_block(&self, bytes: &[u8]) -> Option<bool> {
        const MAX_KIND: u32 = 10;
        const SECTION: u32 = 0x0A0D_0D0A;
        let (kind, len) = (self.word(bytes, 0)?, self.word(bytes, 4)? as usize);
        let is_kind = (1..=MAX_KIND).contains(&kind) || kind == SECTION;
        if !is_kind || !(12..=MAX_BLOCK).contains(&len) || len % 4 != 0 {
            return Some(false);
        }
        Some(self.word(bytes, len - 4)? as usize == len)
    }

    /// The length of the packet of a pcap file that may begin with these bytes, `None` inside if none does; `None` if more
    /// are needed.
    fn packet_len(&self, bytes: &[u8]) -> Option<Option<usize>> {
        /// Maximum time between two packets, in seconds.
        const MAX_PAUSE: u32 = 24 * 60 * 60;
        let word = |at| self.word(bytes, at);
        let [seconds, fraction, len, whole_len] = [word(0)?, word(4)?, word(8)?, word(12)?];
        let is_packet = self.seconds.is_none_or(|before| seconds.abs_diff(before) <= MAX_PAUSE)
            && fraction < self.max_fraction()
            && len as usize <= MAX_BLOCK
            && len <= whole_len;
        Some(is_packet.then_some(PACKET_HEADER + len as usize))
    }

    /// Returns true if these last bytes of a pcap file are one packet.
    fn ends_in_packet(&self, bytes: &[u8]) -> bool {
        self.packet_len(bytes).flatten() == Some(bytes.len())
    }

    /// A number in the file's order of bytes.
    fn word(&self, bytes: &[u8], at: usize) -> Option<u32> {
        let word = *bytes.get(at..)?.first_chunk()?;
        let is_big_endian = match self.kind {
            Kind::Pcapng => self.is_big_endian,
            Kind::Pcap => self.header.as_ref().is_some_and(PcapHeader::is_bigendian),
        };
        Some(match is_big_endian {
            true => u32::from_be_bytes(word),
            false => u32::from_le_bytes(word),
        })
    }

    /// Parses a packet of a pcap file, or its header.
    fn pcap_packet(&mut self, bytes: &[u8], place: Place<'_>, take: &mut Take<'_>) -> Parsed {
        let Some(header) = &self.header else {
            return match parse_pcap_header(bytes) {
                Ok((rest, header)) => {
                    self.header = Some(header);
                    Parsed::Block(bytes.len() - rest.len())
                }
                Err(error) => Parsed::failed(&error),
            };
        };
        let parse = match header.is_bigendian() {
            true => parse_pcap_frame_be,
            false => parse_pcap_frame,
        };
        match parse(bytes) {
            Ok((rest, packet)) => {
                self.seconds = Some(packet.ts_sec);
                let unit = if header.is_nanosecond_precision() { 1 } else { 1_000 };
                let nanos = u64::from(packet.ts_sec) * 1_000_000_000 + u64::from(packet.ts_usec) * unit;
                take_packet(place, header.network, packet.data, nanos, "", take);
                Parsed::Block(bytes.len() - rest.len())
            }
            Err(error) => Parsed::failed(&error),
        }
    }

    /// Parses a block of a pcapng file.
    fn pcapng_block(&mut self, bytes: &[u8], place: Place<'_>, take: &mut Take<'_>) -> Parsed {
        let parse = match self.is_big_endian {
            true => parse_block_be,
            false => parse_block_le,
        };
        let (rest, block) = match parse(bytes) {
            Ok(parsed) => parsed,
            Err(error) => return Parsed::failed(&error),
        };
        match block {
            Block::SectionHeader(section) => {
                self.is_big_endian = section.big_endian();
                self.interfaces.clear();
            }
            Block::InterfaceDescription(block) => {
                let interface = Interface::new(&block, self.interfaces.len());
                self.interfaces.push(interface);
            }
            Block::EnhancedPacket(packet) => match self.interfaces.get(packet.if_id as usize) {
                Some(interface) => {
                    let nanos = interface.nanos(u64::from(packet.ts_high) << 32 | u64::from(packet.ts_low));
                    take_packet(
                        place,
                        interface.link,
                        packet.packet_data(),
                        nanos,
                        &interface.name,
                        take,
                    );
                }
                None => take(place, Err("packet of an unknown interface".into())),
            },
            Block::SimplePacket(packet) => match self.interfaces.first() {
                Some(interface) => take_packet(place, interface.link, packet.packet_data(), 0, &interface.name, take),
                None => take(place, Err("packet of an unknown interface".into())),
            },
            // Statistics and names.
            _ => {}
        }
        Parsed::Block(bytes.len() - rest.len())
    }
}

/// Passes a packet to `take`.
fn take_packet(place: Place<'_>, link: Linktype, packet: &[u8], nanos: u64, bus: &str, take: &mut Take<'_>) {
    let frame = match (link, packet.split_at_checked(COOKED_HEADER)) {
        (SOCKETCAN, _) => socketcan(packet),
        (COOKED, Some((header, frame))) if COOKED_CAN.iter().any(|can| header.ends_with(can)) => socketcan(frame),
        // Of a network, or another bus.
        _ => Ok(None),
    };
    let stamp = format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000);
    let record = frame.map(|frame| match frame {
        Some(frame) => Record::Frame(Logged::whole(
            Time::seconds(Instant::from_micros(nanos / 1_000), &stamp),
            bus,
            frame,
        )),
        None => Record::Other,
    });
    take(place, record);
}

/// The frame in a packet of SocketCAN: `None` for CAN XL, and inside as in [`Logged`].
#[allow(clippy::option_option, reason = "the inner one is that of `Logged`")]
fn socketcan(packet: &[u8]) -> Result<Option<Option<armwire_bridge::can::Frame>>, Doubt> {
    /// Flags in the identifier.
    const EXTENDED: u32 = 1 << 31;
    const REMOTE: u32 = 1 << 30;
    const ERROR: u32 = 1 << 29;
    /// Flags in the byte after the length. In a CAN XL frame that of CAN XL is where the length is.
    const FD: u8 = 4;
    const XL: u8 = 0x80;

    let Some((&[a, b, c, d, len, flags, _, _], data)) = packet.split_first_chunk() else {
        return Err(Doubt::short(8, packet.len()));
    };
    if len & XL != 0 {
        return Ok(None);
    }
    let id = u32::from_be_bytes([a, b, c, d]);
    if id & (REMOTE | ERROR) != 0 {
        return Ok(Some(None));
    }
    let len = usize::from(len);
    let Some(data) = data.get(..len) else {
        return Err(Doubt::short(len, data.len()));
    };
    // Older captures have no flag: a packet of an FD frame has room for its maximum.
    let is_fd = flags & FD != 0 || packet.len() == 8 + MAX_FD;
    frame(id & !EXTENDED, id & EXTENDED != 0, is_fd, data).map(Some)
}
