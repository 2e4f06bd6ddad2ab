//! The frames of a recording as packets of a pcapng file, for Wireshark.
//!
//! A packet is a byte of [direction] and then the bytes of a frame, or of a run between frames. The format is
//! that of draft-ietf-opsawg-pcapng. Numbers are little-endian.

use std::cell::RefCell;
use std::fmt::Arguments;
use std::io::{self, BufWriter, Write};
use std::path::Path;

use armwire_host::describe::Protocol;

use super::output::{Console, Item, OnLine, Output, Writer};
use crate::args::Speaker;
use crate::error::Error;
use crate::new_file;
use crate::output::print_error;

const SECTION_HEADER: u32 = 0x0A0D_0D0A;
const INTERFACE_DESCRIPTION: u32 = 1;
const ENHANCED_PACKET: u32 = 6;

const BYTE_ORDER: u32 = 0x1A2B_3C4D;
const VERSION: [u16; 2] = [1, 0];
/// Length of a section that is not known yet.
const UNKNOWN_LENGTH: u64 = u64::MAX;

const INTERFACE_NAME: u16 = 2;
const INTERFACE_RESOLUTION: u16 = 9;
const PACKET_FLAGS: u16 = 2;
/// The resolution of times: 10⁻⁹ s.
const NANOSECONDS: u8 = 9;

/// The interface of each protocol: its link type, from LINKTYPE_USER0 on, and its name. Older files name all of them
/// `arm`.
pub(super) const INTERFACES: [(Protocol, u16, &str); 4] = [
    (Protocol::Ling, 147, "ling"),
    (Protocol::LingLegacy, 147, "ling-legacy"),
    (Protocol::Xarm, 148, "xarm"),
    (Protocol::Alpha1, 149, "alpha1"),
];

/// The first byte of a packet, and its direction in the packet's flags: outbound to the arm, inbound from it.
fn direction(from: Option<Speaker>) -> (u8, u32) {
    match from {
        Some(Speaker::Host) => (0, 2),
        Some(Speaker::Arm) => (1, 1),
        None => (2, 0),
    }
}

/// Writes items as packets, and prints remarks.
pub(super) struct Packets {
    name: String,
    file: RefCell<(Blocks, Writer<Box<dyn Write>>)>,
    /// `None` if the packets go to standard output: remarks go to standard error then.
    console: Option<Console>,
}

impl Packets {
    /// Creates the file at this path, or uses standard output for `-`.
    pub(super) fn create(path: &Path) -> Result<Self, Error> {
        let (name, out, console): (_, Box<dyn Write>, _) = if path.as_os_str() == "-" {
            ("standard output".to_owned(), Box::new(io::stdout()), None)
        } else {
            let file = new_file::create(path)?;
            (path.display().to_string(), Box::new(file), Some(Console::new()))
        };
        let out = Writer::new(BufWriter::with_capacity(64 * 1024, out));
        let packets = Self {
            name,
            file: RefCell::new((Blocks::new(), out)),
            console,
        };
        packets.write();
        Ok(packets)
    }

    /// Writes the blocks that are ended.
    fn write(&self) {
        let (blocks, out) = &mut *self.file.borrow_mut();
        out.write(|out| out.write_all(&blocks.ended));
        blocks.ended.clear();
    }
}

impl Output for Packets {
    fn item(&self, item: &Item<'_>) {
        if let Some(on_line) = item.on_line {
            self.file.borrow_mut().0.packet(on_line, item.bytes);
            self.write();
        }
    }

    fn remark(&self, text: Arguments<'_>) {
        match &self.console {
            Some(console) => console.remark(text),
            None => print_error(&text),
        }
    }

    fn flush(&self) -> bool {
        self.file.borrow_mut().1.flush()
    }

    fn finish(&self) -> io::Result<()> {
        let written = self.file.borrow_mut().1.finish();
        written.map_err(|error| io::Error::new(error.kind(), format!("{}: {error}", self.name)))?;
        self.console.as_ref().map_or(Ok(()), Output::finish)
    }
}

/// The blocks of a pcapng file.
struct Blocks {
    /// The protocols of the interfaces.
    interfaces: Vec<Protocol>,
    /// The block that is being made.
    block: Vec<u8>,
    /// Whole blocks, until they are written.
    ended: Vec<u8>,
}

impl Blocks {
    fn new() -> Self {
        let mut blocks = Self {
            interfaces: Vec::new(),
            block: Vec::new(),
            ended: Vec::new(),
        };
        blocks.block.extend(BYTE_ORDER.to_le_bytes());
        blocks.block.extend(VERSION.map(u16::to_le_bytes).as_flattened());
        blocks.block.extend(UNKNOWN_LENGTH.to_le_bytes());
        blocks.end_block(SECTION_HEADER);
        blocks
    }

    fn packet(&mut self, OnLine { protocol, from, nanos }: OnLine, bytes: &[u8]) {
        let interface = self.interface(protocol);
        let (direction, flags) = direction(from);
        let len = 1 + bytes.len() as u32;
        for word in [interface, (nanos >> 32) as u32, nanos as u32, len, len] {
            self.block.extend(word.to_le_bytes());
        }
        self.block.push(direction);
        self.block.extend(bytes);
        self.pad();
        self.option(PACKET_FLAGS, &flags.to_le_bytes());
        self.end_options();
        self.end_block(ENHANCED_PACKET);
    }

    /// The number of the interface of this protocol, which is described before its first packet.
    fn interface(&mut self, protocol: Protocol) -> u32 {
        if let Some(number) = self.interfaces.iter().position(|there| *there == protocol) {
            return number as u32;
        }
        let described = INTERFACES.iter().filter(|(there, ..)| *there == protocol);
        for (_, link_type, name) in described {
            self.block.extend(link_type.to_le_bytes());
            // Reserved, and no limit to the length of packets.
            self.block.extend([0; 6]);
            self.option(INTERFACE_NAME, name.as_bytes());
            self.option(INTERFACE_RESOLUTION, &[NANOSECONDS]);
            self.end_options();
            self.end_block(INTERFACE_DESCRIPTION);
        }
        self.interfaces.push(protocol);
        self.interfaces.len() as u32 - 1
    }

    fn option(&mut self, code: u16, value: &[u8]) {
        self.block.extend(code.to_le_bytes());
        self.block.extend((value.len() as u16).to_le_bytes());
        self.block.extend(value);
        self.pad();
    }

    fn end_options(&mut self) {
        self.option(0, &[]);
    }

    fn pad(&mut self) {
        self.block.resize(self.block.len().next_multiple_of(4), 0);
    }

    /// Ends the block: between its type and its length, and its length again.
    fn end_block(&mut self, kind: u32) {
        let len = self.block.len() as u32 + 12;
        for word in [kind, len] {
            self.ended.extend(word.to_le_bytes());
        }
        self.ended.append(&mut self.block);
        self.ended.extend(len.to_le_bytes());
    }
}

#[cfg(test)]
mod tests {
    use proptest::collection::vec;
    use proptest::option;
    use proptest::prelude::*;
    use proptest::sample::select;

    use super::*;

    /// A packet as the tests read it: link type and name of its interface, flags, time in ns, data.
    type Packet = ((u16, String), u32, u64, Vec<u8>);

    fn word(bytes: &[u8], at: usize) -> u32 {
        u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap())
    }

    /// The packets of a file, each block of which is checked.
    fn read(mut file: &[u8]) -> Vec<Packet> {
        let (mut interfaces, mut packets) = (Vec::new(), Vec::new());
        while !file.is_empty() {
            let len = word(file, 4) as usize;
            assert_eq!((len % 4, word(file, len - 4) as usize), (0, len));
            let body = &file[8..len - 4];
            match word(file, 0) {
                SECTION_HEADER => assert_eq!(body, b"\x4D\x3C\x2B\x1A\x01\0\0\0\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"),
                INTERFACE_DESCRIPTION => {
                    let name_len = usize::from(body[10]);
                    let (name, rest) = body[12..].split_at(name_len.next_multiple_of(4));
                    assert_eq!((&body[2..10], body[11]), (&b"\0\0\0\0\0\0\x02\0"[..], 0));
                    assert_eq!(rest, b"\x09\0\x01\0\x09\0\0\0\0\0\0\0");
                    let name = String::from_utf8(name[..name_len].to_vec()).unwrap();
                    interfaces.push((u16::from_le_bytes([body[0], body[1]]), name));
                }
                ENHANCED_PACKET => {
                    let data_len = word(body, 12) as usize;
                    assert_eq!(word(body, 16) as usize, data_len);
                    let options = &body[20 + data_len.next_multiple_of(4)..];
                    assert_eq!((&options[..4], &options[8..]), (&b"\x02\0\x04\0"[..], &b"\0\0\0\0"[..]));
                    packets.push((
                        interfaces[word(body, 0) as usize].clone(),
                        word(options, 4),
                        u64::from(word(body, 4)) << 32 | u64::from(word(body, 8)),
                        body[20..20 + data_len].to_vec(),
                    ));
                }
                other => panic!("block type {other:#x}"),
            }
            file = &file[len..];
        }
        packets
    }

    fn on_line() -> impl Strategy<Value = OnLine> {
        const PROTOCOLS: [Protocol; 4] = [Protocol::Ling, Protocol::LingLegacy, Protocol::Xarm, Protocol::Alpha1];
        let from = option::of(select(&[Speaker::Host, Speaker::Arm][..]));
        (select(&PROTOCOLS[..]), from, any::<u64>()).prop_map(|(protocol, from, nanos)| OnLine {
            protocol,
            from,
            nanos,
        })
    }

    proptest! {
        #[test]
        fn packets_are_read_as_written(items in vec((on_line(), vec(any::<u8>(), 0..300)), 0..20)) {
            let mut blocks = Blocks::new();
            for (on_line, bytes) in &items {
                blocks.packet(*on_line, bytes);
            }
            let expected: Vec<Packet> = items.iter().map(|(on_line, bytes)| {
                let (link_type, name) = match on_line.protocol {
                    Protocol::Ling => (147, "ling"),
                    Protocol::LingLegacy => (147, "ling-legacy"),
                    Protocol::Xarm => (148, "xarm"),
                    Protocol::Alpha1 => (149, "alpha1"),
                };
                let (first, flags) = match on_line.from {
                    Some(Speaker::Host) => (0, 0b10),
                    Some(Speaker::Arm) => (1, 0b01),
                    None => (2, 0),
                };
                ((link_type, name.to_owned()), flags, on_line.nanos, [&[first], &bytes[..]].concat())
            }).collect();
            prop_assert_eq!(read(&blocks.ended), expected);
        }
    }
}
