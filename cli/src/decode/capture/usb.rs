//! Transfers of USB, as usbmon of Linux and USBPcap of Windows capture them.
//!
//! A transfer has two packets: its submission, and its completion. The bytes to the device are in the first one, those
//! from it in the second one.

use std::borrow::Cow;

use crate::args::Speaker;
use crate::decode::doubts::Doubt;
use crate::decode::unit::{Bytes, Hint, Read, Transfer, Unit};

/// The form of a packet's header.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Form {
    /// usbmon: numbers in the order of bytes of the file, and a header of this size.
    Linux {
        header: usize,
    },
    UsbPcap,
}

/// Types of transfers, the same in both forms.
const ISOCHRONOUS: u8 = 0;
const INTERRUPT: u8 = 1;
const CONTROL: u8 = 2;
const BULK: u8 = 3;
/// The bit of an endpoint that sends to the computer.
const IN: u8 = 0x80;

/// The fields of a packet that are read.
struct Header<'a> {
    device: (u16, u16),
    endpoint: u8,
    kind: u8,
    /// Number of bytes of the transfer that the packet should have.
    len: usize,
    data: &'a [u8],
}

/// The unit of a packet. The time is in nanoseconds.
pub(super) fn packet(form: Form, packet: &[u8], is_big_endian: bool, nanos: u64) -> Read<'_> {
    let header = match form {
        Form::Linux { header } => usbmon(packet, header, is_big_endian),
        Form::UsbPcap => usbpcap(packet),
    };
    let Header {
        device,
        endpoint,
        kind,
        len,
        data,
    } = header.ok_or_else(|| Doubt::from("a packet that is shorter than its header"))?;
    match kind {
        BULK | INTERRUPT => {}
        CONTROL => return Ok(Unit::Other("USB control transfers")),
        ISOCHRONOUS => return Ok(Unit::Other("USB isochronous transfers")),
        _ => return Ok(Unit::Other("other USB packets")),
    }
    let Some(bytes) = data.get(..len) else {
        return Err(Doubt::short(len, data.len()));
    };
    if bytes.is_empty() {
        return Ok(Unit::Other("USB packets without data"));
    }
    let (from, direction) = match endpoint & IN {
        0 => (Speaker::Host, "out"),
        _ => (Speaker::Arm, "in"),
    };
    let place = format!(
        "{}  {}.{}.{} {direction:3}",
        seconds(nanos),
        device.0,
        device.1,
        endpoint & !IN
    );
    Ok(Unit::Bytes(Bytes {
        hint: Hint::From(from),
        bytes: Cow::Borrowed(bytes),
        nanos,
        transfer: Some(Transfer {
            device,
            endpoint,
            place,
        }),
        gap: None,
    }))
}

/// `struct usbmon_packet`.
fn usbmon(packet: &[u8], header: usize, is_big_endian: bool) -> Option<Header<'_>> {
    let (header, data) = packet.split_at_checked(header)?;
    let [event, kind, endpoint, device] = *header.get(8..)?.first_chunk()?;
    let bus = *header.get(12..)?.first_chunk()?;
    let len = *header.get(32..)?.first_chunk()?;
    let (bus, len) = match is_big_endian {
        true => (u16::from_be_bytes(bus), u32::from_be_bytes(len)),
        false => (u16::from_le_bytes(bus), u32::from_le_bytes(len)),
    };
    // A completion to the device has the length of what was sent, a submission from it that of its buffer.
    let has_data = event == if endpoint & IN == 0 { b'S' } else { b'C' };
    Some(Header {
        device: (bus, device.into()),
        endpoint,
        kind,
        len: if has_data { len as usize } else { 0 },
        data,
    })
}

/// `USBPCAP_BUFFER_PACKET_HEADER`, little-endian.
fn usbpcap(packet: &[u8]) -> Option<Header<'_>> {
    let size = u16::from_le_bytes(*packet.first_chunk()?);
    let (header, data) = packet.split_at_checked(size.into())?;
    let bus = u16::from_le_bytes(*header.get(17..)?.first_chunk()?);
    let device = u16::from_le_bytes(*header.get(19..)?.first_chunk()?);
    let [endpoint, kind] = *header.get(21..)?.first_chunk()?;
    let len = u32::from_le_bytes(*header.get(23..)?.first_chunk()?);
    Some(Header {
        device: (bus, device),
        endpoint,
        kind,
        len: len as usize,
        data,
    })
}

/// The text of a time in ns, in seconds.
pub(super) fn seconds(nanos: u64) -> String {
    format!("{}.{:09}", nanos / 1_000_000_000, nanos % 1_000_000_000)
}
