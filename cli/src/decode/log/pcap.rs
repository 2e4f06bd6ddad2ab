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
    let is_pcapng = buffer.rest().starts_with(SIGNATURES[4]);
    let mut capture = Capture::default();
    loop {
        let rest = buffer.rest();
        let place = Place::Byte(buffer.offset);
        let parsed = match is_pcapng {
            true => capture.pcapng_block(rest, place, take),
            false => capture.pcap_packet(rest, place, take),
        };
        match parsed {
            Parsed::Block(len) => buffer.consume(len),
            Parsed::Incomplete if rest.len() < MAX_BLOCK => {
                if !buffer.fill()? {
                    if !buffer.rest().is_empty() {
                        take(place, Err(Doubt::cut()));
                    }
                    return Ok(());
                }
            }
            // Without a length there is no next block.
            Parsed::Incomplete | Parsed::Damaged => {
                take(place, Err("damaged block, the rest is not read".into()));
                return Ok(());
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

/// What was read of a capture.
#[derive(Default)]
struct Capture {
    /// The header of a pcap file.
    header: Option<PcapHeader>,
    /// The order of bytes in a pcapng file.
    is_big_endian: bool,
    /// The interfaces of the current section of a pcapng file.
    interfaces: Vec<Interface>,
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
