//! Captures of Wireshark and tcpdump, pcap and pcapng.

mod packet;
#[cfg(test)]
mod tests;
mod usb;

use std::io::{BufRead, Read};

use pcap_parser::nom::Err as Nom;
use pcap_parser::{
    Block, InterfaceDescriptionBlock, Linktype, PcapHeader, parse_block_be, parse_block_le, parse_pcap_frame,
    parse_pcap_frame_be, parse_pcap_header,
};

use super::doubts::{Doubt, Place};
use super::input::Input;
use super::unit::{Read as ReadUnit, Take, Unit};
use crate::error::Error;
use crate::printable::cut;
use packet::{Link, NETWORK, UNKNOWN, packet, refusal};

/// First bytes of files: pcap in either order of bytes, with microseconds or nanoseconds, and pcapng.
pub(in crate::decode) const SIGNATURES: [&[u8]; 5] = [
    b"\xD4\xC3\xB2\xA1",
    b"\xA1\xB2\xC3\xD4",
    b"\x4D\x3C\xB2\xA1",
    b"\xA1\xB2\x3C\x4D",
    b"\x0A\x0D\x0D\x0A",
];

/// Maximum size of a block, in bytes: more than that of a packet on any network.
const MAX_BLOCK: usize = 70_000;
/// Maximum number of interfaces in a section of a pcapng file. Each is kept.
const MAX_INTERFACES: usize = 256;
/// Size of a packet's header in a pcap file.
const PACKET_HEADER: usize = 16;
/// Blocks of a pcapng file without a packet, other than its structure.
const OTHER_BLOCKS: &str = "other blocks";
/// Blocks of a pcapng file that may have a packet.
const UNKNOWN_BLOCKS: &str = "unknown blocks";
/// Number of bytes read at once, at most.
const PIECE: usize = 8 * 1024;

/// Passes each packet and block of a capture to `take`. A capture that has nothing to read is an error.
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
    let mut is_read = false;
    loop {
        let rest = buffer.rest();
        let place = Place::Byte(buffer.offset);
        let parsed = match capture.kind {
            _ if !capture.may_be_block(rest) => Parsed::Damaged,
            Kind::Pcapng => capture.pcapng_block(rest),
            Kind::Pcap => capture.pcap_packet(rest),
        };
        let is_full = rest.len() >= MAX_BLOCK;
        let is_damaged = match parsed {
            Parsed::Block(len, unit) => {
                let is_structure = matches!(unit, Ok(Unit::Comment));
                let is_network = matches!(unit, Ok(Unit::Other(NETWORK)));
                is_read |= match &unit {
                    Ok(unit) => !matches!(unit, Unit::Comment | Unit::Other(NETWORK | UNKNOWN | OTHER_BLOCKS)),
                    Err(doubt) => doubt.kind != UNKNOWN_BLOCKS,
                };
                take(place, unit);
                buffer.consume(len);
                if is_network {
                    capture.refuse(packet::NO_NETWORK.to_owned());
                }
                // The header of a pcap file has the link type of all packets.
                if is_structure && matches!(capture.kind, Kind::Pcap) && capture.refused.is_some() {
                    break;
                }
                continue;
            }
            Parsed::Incomplete => false,
            Parsed::Damaged => true,
        };
        if !is_damaged && !is_full && buffer.fill()? {
            continue;
        }
        if !is_damaged && buffer.rest().is_empty() {
            break;
        }
        let goes_on = capture.skip_to_block(&mut buffer)?;
        let is_cut = !is_damaged && !goes_on;
        take(place, Err(if is_cut { Doubt::cut() } else { "damaged block".into() }));
        if !goes_on {
            break;
        }
    }
    match capture.refused.filter(|_| !is_read) {
        Some(reason) => Err(buffer.input.refused(&reason)),
        None => Ok(()),
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
enum Parsed<'a> {
    /// A block of this length, and what it is.
    Block(usize, ReadUnit<'a>),
    Incomplete,
    Damaged,
}

impl Parsed<'_> {
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
    /// The reason why the packets of another link are not read.
    refused: Option<String>,
}

/// An interface of a pcapng file.
struct Interface {
    name: String,
    link: Link,
    /// Units of time in a second, and seconds before them.
    resolution: u64,
    offset: i64,
}

impl Interface {
    fn new(block: &InterfaceDescriptionBlock<'_>, index: usize) -> Self {
        let name = block.if_name().and_then(Result::ok).map(cut);
        Self {
            link: Link::of(block.linktype, name.as_deref().unwrap_or_default()),
            name: name.unwrap_or_else(|| index.to_string()),
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
            refused: None,
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

    /// Keeps the reason why packets of this link are not read.
    fn open(&mut self, link: Linktype) {
        if let Some(reason) = refusal(link) {
            self.refuse(reason);
        }
    }

    /// Keeps the first reason why packets are not read.
    fn refuse(&mut self, reason: String) {
        self.refused.get_or_insert(reason);
    }

    /// Parses a packet of a pcap file, or its header.
    fn pcap_packet<'a>(&mut self, bytes: &'a [u8]) -> Parsed<'a> {
        let Some(header) = &self.header else {
            return match parse_pcap_header(bytes) {
                Ok((rest, header)) => {
                    self.open(header.network);
                    self.header = Some(header);
                    Parsed::Block(bytes.len() - rest.len(), Ok(Unit::Comment))
                }
                Err(error) => Parsed::failed(&error),
            };
        };
        let parse = match header.is_bigendian() {
            true => parse_pcap_frame_be,
            false => parse_pcap_frame,
        };
        match parse(bytes) {
            Ok((rest, block)) => {
                self.seconds = Some(block.ts_sec);
                let scale = if header.is_nanosecond_precision() { 1 } else { 1_000 };
                let nanos = u64::from(block.ts_sec) * 1_000_000_000 + u64::from(block.ts_usec) * scale;
                let unit = packet(
                    Link::of(header.network, ""),
                    block.data,
                    header.is_bigendian(),
                    nanos,
                    "",
                );
                Parsed::Block(bytes.len() - rest.len(), unit)
            }
            Err(error) => Parsed::failed(&error),
        }
    }

    /// Parses a block of a pcapng file.
    fn pcapng_block<'a>(&'a mut self, bytes: &'a [u8]) -> Parsed<'a> {
        let parse = match self.is_big_endian {
            true => parse_block_be,
            false => parse_block_le,
        };
        let (rest, block) = match parse(bytes) {
            Ok(parsed) => parsed,
            Err(error) => return Parsed::failed(&error),
        };
        let unit = match block {
            Block::SectionHeader(section) => {
                self.is_big_endian = section.big_endian();
                self.interfaces.clear();
                Ok(Unit::Comment)
            }
            Block::InterfaceDescription(block) => {
                self.open(block.linktype);
                match self.interfaces.len() {
                    MAX_INTERFACES => Err("more than 256 interfaces".into()),
                    index => {
                        self.interfaces.push(Interface::new(&block, index));
                        Ok(Unit::Comment)
                    }
                }
            }
            Block::EnhancedPacket(block) => {
                let time = u64::from(block.ts_high) << 32 | u64::from(block.ts_low);
                self.packet(block.if_id, Some(time), block.data, block.caplen)
            }
            Block::SimplePacket(block) => self.packet(0, None, block.data, block.origlen),
            Block::InterfaceStatistics(_) | Block::NameResolution(_) => Ok(Unit::Comment),
            Block::SystemdJournalExport(_)
            | Block::DecryptionSecrets(_)
            | Block::ProcessInformation(_)
            | Block::Custom(_) => Ok(Unit::Other(OTHER_BLOCKS)),
            // One of them is the obsolete Packet Block.
            Block::Unknown(block) => {
                let text = format!("a block of the unknown type {}", block.block_type);
                Err(Doubt::new(UNKNOWN_BLOCKS, text))
            }
        };
        Parsed::Block(bytes.len() - rest.len(), unit)
    }

    /// A packet of a pcapng file, whose data may have padding behind them.
    fn packet<'a>(&'a self, interface: u32, time: Option<u64>, data: &'a [u8], len: u32) -> ReadUnit<'a> {
        let interface = self
            .interfaces
            .get(interface as usize)
            .ok_or("packet of an unknown interface")?;
        let nanos = time.map_or(0, |time| interface.nanos(time));
        let data = &data[..data.len().min(len as usize)];
        packet(interface.link, data, self.is_big_endian, nanos, &interface.name)
    }
}
