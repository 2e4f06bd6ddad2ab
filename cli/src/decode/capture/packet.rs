//! The packets of a capture, by their link type: <https://www.tcpdump.org/linktypes.html>.

use armwire_bridge::Instant;
use armwire_bridge::can::MAX_FD;
use armwire_host::describe::Protocol;
use pcap_parser::Linktype;

use super::usb::{self, seconds};
use crate::args::Speaker;
use crate::decode::doubts::Doubt;
use crate::decode::framed::Recorded;
use crate::decode::log::{Logged, Time, frame};
use crate::decode::pcapng::INTERFACES;
use crate::decode::unit::{Read, Unit};

/// The link type of SocketCAN, and the one of `any` interface: "Linux cooked".
const SOCKETCAN: Linktype = Linktype(227);
const COOKED: Linktype = Linktype(113);
/// Size of the header of a cooked packet, and its protocols for classic frames and FD frames.
const COOKED_HEADER: usize = 16;
const COOKED_CAN: [[u8; 2]; 2] = [[0x00, 0x0C], [0x00, 0x0D]];
/// The link types of networks, which carry an xArm's frames on TCP: BSD loopback, Ethernet, PPP, raw IP, Wi-Fi, IPv4,
/// IPv6, and the second form of "Linux cooked".
const NETWORKS: [Linktype; 12] = [
    Linktype(0),
    Linktype(1),
    Linktype(9),
    Linktype(12),
    Linktype(101),
    Linktype(105),
    Linktype(108),
    Linktype(127),
    Linktype(163),
    Linktype(228),
    Linktype(229),
    Linktype(276),
];
/// The kinds of packets that are not read.
pub(super) const NETWORK: &str = "packets of a network";
pub(super) const UNKNOWN: &str = "packets of unknown links";
/// USB of macOS.
const USB_DARWIN: Linktype = Linktype(266);

/// The contents of the packets of a link type.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Link {
    Can,
    /// SocketCAN, or a network.
    Cooked,
    Usb(usb::Form),
    /// The frames of `armwire decode --pcapng`.
    Frames(Protocol),
    Network,
    Unknown,
}

impl Link {
    /// The contents of the packets of an interface with this name; empty if it has none.
    pub(super) fn of(link: Linktype, name: &str) -> Self {
        let is_type = |(_, there, _): &&(Protocol, u16, &str)| i32::from(*there) == link.0;
        let named = INTERFACES.iter().filter(is_type).find(|(.., there)| *there == name);
        if let Some((protocol, ..)) = named.or_else(|| INTERFACES.iter().find(is_type)) {
            return Self::Frames(*protocol);
        }
        match link {
            SOCKETCAN => Self::Can,
            COOKED => Self::Cooked,
            Linktype(189) => Self::Usb(usb::Form::Linux { header: 48 }),
            Linktype(220) => Self::Usb(usb::Form::Linux { header: 64 }),
            Linktype(249) => Self::Usb(usb::Form::UsbPcap),
            _ if NETWORKS.contains(&link) => Self::Network,
            _ => Self::Unknown,
        }
    }
}

/// The reason why no packet of this link type is read, with the way to read them; `None` if some are.
pub(super) fn refusal(link: Linktype) -> Option<String> {
    match Link::of(link, "") {
        Link::Network => Some(NO_NETWORK.to_owned()),
        Link::Unknown if link == USB_DARWIN => Some(
            "a capture of USB by macOS (link type 266), which is not read: capture it on Linux or Windows".to_owned(),
        ),
        Link::Unknown => Some(format!(
            "a capture of link type {}: those of CAN (227) and USB (189, 220, 249), and of 'armwire decode --pcapng', are read",
            link.0
        )),
        Link::Can | Link::Cooked | Link::Usb(_) | Link::Frames(_) => None,
    }
}

/// The reason why packets of a network are not read.
pub(super) const NO_NETWORK: &str = "a capture of a network, such as Ethernet: 'tshark -X lua_script:tools/wireshark/armwire.lua \
                                  -r FILE' shows an xArm's frames in it";

/// The unit of a packet. The time is in nanoseconds.
pub(super) fn packet<'a>(link: Link, packet: &'a [u8], is_big_endian: bool, nanos: u64, bus: &'a str) -> Read<'a> {
    match (link, packet.split_at_checked(COOKED_HEADER)) {
        (Link::Can, _) => socketcan(packet, nanos, bus),
        (Link::Cooked, Some((header, frame))) if COOKED_CAN.iter().any(|can| header.ends_with(can)) => {
            socketcan(frame, nanos, bus)
        }
        (Link::Usb(form), _) => usb::packet(form, packet, is_big_endian, nanos),
        (Link::Frames(protocol), _) => recorded(protocol, packet, nanos),
        (Link::Network | Link::Cooked, _) => Ok(Unit::Other(NETWORK)),
        (Link::Unknown, _) => Ok(Unit::Other(UNKNOWN)),
    }
}

/// A frame behind the byte of its direction.
fn recorded(protocol: Protocol, packet: &[u8], nanos: u64) -> Read<'_> {
    let Some((direction, bytes)) = packet.split_first() else {
        return Err(Doubt::short(1, 0));
    };
    let from = match direction {
        0 => Some(Speaker::Host),
        1 => Some(Speaker::Arm),
        2 => None,
        _ => {
            return Err(Doubt::new(
                "no direction",
                format!("{direction} is no direction: 0, 1 or 2"),
            ));
        }
    };
    Ok(Unit::Frame(Recorded {
        stamp: nanos.cast_signed(),
        protocol,
        from,
        bytes: bytes.into(),
    }))
}

/// The frame in a packet of SocketCAN.
fn socketcan<'a>(packet: &[u8], nanos: u64, bus: &'a str) -> Read<'a> {
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
        return Ok(Unit::Other("CAN XL frames"));
    }
    let id = u32::from_be_bytes([a, b, c, d]);
    let len = usize::from(len);
    let frame = match data.get(..len) {
        _ if id & (REMOTE | ERROR) != 0 => None,
        None => return Err(Doubt::short(len, data.len())),
        // Older captures have no flag: a packet of an FD frame has room for its maximum.
        Some(data) => {
            let is_fd = flags & FD != 0 || packet.len() == 8 + MAX_FD;
            frame(id & !EXTENDED, id & EXTENDED != 0, is_fd, data)?
        }
    };
    let time = Time::seconds(Instant::from_micros(nanos / 1_000), seconds(nanos));
    Ok(Unit::Can(Logged::whole(time, bus, frame)))
}
