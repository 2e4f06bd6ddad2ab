//! The class driver of a USB serial port: CDC-ACM (USB CDC 1.2, PSTN 1.2).

use super::Direction;
use super::descriptor::{Configuration, Endpoint, Transfer};
use super::host::Request;

/// Communications interface class, abstract control model (CDC 1.2, tables 4.2 and 4.3).
const CONTROL_CLASS: [u8; 2] = [0x02, 0x02];
/// Data interface class.
const DATA_CLASS: u8 = 0x0A;
/// A class-specific interface descriptor, and the subtype of a union descriptor (tables 5.12 and 5.13).
const CS_INTERFACE: u8 = 0x24;
const UNION: u8 = 0x06;

/// Class requests (PSTN 1.2, table 13).
const SET_LINE_CODING: u8 = 0x20;
const GET_LINE_CODING: u8 = 0x21;
const SET_CONTROL_LINE_STATE: u8 = 0x22;

/// Request types: to or from an interface, class-specific (USB 2.0, table 9-2).
const TO_INTERFACE: u8 = 0x21;
const FROM_INTERFACE: u8 = 0xA1;

/// The interfaces and endpoints of a device's serial port.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Port {
    /// The interface for class requests.
    pub interface: u8,
    /// The data interface.
    pub data: u8,
    /// The endpoint for line state notifications, if there is one.
    pub notify: Option<Endpoint>,
    /// The OUT endpoint.
    pub output: Endpoint,
    /// The IN endpoint.
    pub input: Endpoint,
}

impl Port {
    /// The serial ports of a device, in the order of their control interfaces.
    pub fn find(configuration: &Configuration) -> Vec<Self> {
        configuration
            .interfaces
            .iter()
            .filter(|interface| interface.class[..2] == CONTROL_CLASS)
            .filter_map(|control| {
                let data = control.extra.iter().find_map(|extra| match extra[..] {
                    [_, CS_INTERFACE, UNION, _, data, ..] => Some(data),
                    _ => None,
                })?;
                let data = configuration
                    .interfaces
                    .iter()
                    .find(|interface| interface.number == data && interface.class[0] == DATA_CLASS)?;
                Some(Self {
                    interface: control.number,
                    data: data.number,
                    notify: control.endpoint(Transfer::Interrupt, Direction::In),
                    output: data.endpoint(Transfer::Bulk, Direction::Out)?,
                    input: data.endpoint(Transfer::Bulk, Direction::In)?,
                })
            })
            .collect()
    }

    /// The request that sets the line coding.
    pub fn set_line_coding(&self, coding: LineCoding) -> Request {
        Request::write(
            TO_INTERFACE,
            SET_LINE_CODING,
            0,
            self.interface.into(),
            coding.encode().to_vec(),
        )
    }

    /// The request that reads the line coding.
    pub fn get_line_coding(&self) -> Request {
        Request::read(
            FROM_INTERFACE,
            GET_LINE_CODING,
            0,
            self.interface.into(),
            LineCoding::LENGTH,
        )
    }

    /// The request that drives DTR and RTS.
    pub fn set_control_lines(&self, dtr: bool, rts: bool) -> Request {
        let state = u16::from(dtr) | u16::from(rts) << 1;
        Request::write(
            TO_INTERFACE,
            SET_CONTROL_LINE_STATE,
            state,
            self.interface.into(),
            Vec::new(),
        )
    }
}

/// A line coding (PSTN 1.2, 6.3.11), as the seven bytes of the request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LineCoding {
    /// Bits per second.
    pub baud: u32,
    /// 0 is one stop bit, 1 is one and a half, 2 is two.
    pub stop: u8,
    /// 0 is none, 1 odd, 2 even, 3 mark, 4 space.
    pub parity: u8,
    /// Number of data bits: 5, 6, 7, 8 or 16.
    pub bits: u8,
}

impl LineCoding {
    const LENGTH: u16 = 7;

    /// Eight data bits, no parity, one stop bit.
    pub const fn new(baud: u32) -> Self {
        Self {
            baud,
            stop: 0,
            parity: 0,
            bits: 8,
        }
    }

    fn encode(self) -> [u8; 7] {
        let [a, b, c, d] = self.baud.to_le_bytes();
        [a, b, c, d, self.stop, self.parity, self.bits]
    }

    /// Decodes a device's answer. `None` if it is no line coding.
    pub fn decode(bytes: &[u8]) -> Option<Self> {
        let &[a, b, c, d, stop, parity, bits] = bytes else {
            return None;
        };
        Some(Self {
            baud: u32::from_le_bytes([a, b, c, d]),
            stop,
            parity,
            bits,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn line_coding_is_seven_little_endian_bytes() {
        let coding = LineCoding::new(1_000_000);
        assert_eq!(coding.encode(), [0x40, 0x42, 0x0F, 0, 0, 0, 8]);
        assert_eq!(LineCoding::decode(&coding.encode()), Some(coding));
        assert_eq!(LineCoding::decode(&[1, 2, 3]), None);
    }
}
