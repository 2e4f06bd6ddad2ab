//! Descriptors of a device (USB 2.0, 9.6).

use super::Direction;

/// The types of the parsed descriptors (table 9-5).
pub const DEVICE: u8 = 1;
/// A configuration, including its interfaces and endpoints.
pub const CONFIGURATION: u8 = 2;
/// A string.
pub const STRING: u8 = 3;
/// An interface.
pub const INTERFACE: u8 = 4;
/// An endpoint.
pub const ENDPOINT: u8 = 5;

/// A device descriptor (9.6.1), without the strings.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Device {
    /// The USB version, binary-coded decimal: 0x0200 is 2.0.
    pub usb: u16,
    /// Class, subclass and protocol.
    pub class: [u8; 3],
    /// The maximum packet size of endpoint 0, in bytes: 8, 16, 32 or 64.
    pub packet: u8,
    /// The vendor id.
    pub vendor: u16,
    /// The product id.
    pub product: u16,
    /// The device version, binary-coded decimal.
    pub version: u16,
    /// The string indices of manufacturer, product and serial number. 0 is none.
    pub strings: [u8; 3],
    /// Number of configurations.
    pub configurations: u8,
}

/// A configuration descriptor with its interfaces (9.6.3).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Configuration {
    /// The value for SET_CONFIGURATION.
    pub value: u8,
    /// The maximum current from the bus, in milliamperes.
    pub milliamps: u16,
    /// Its interfaces, including alternate settings, in order.
    pub interfaces: Vec<Interface>,
}

/// An interface (9.6.5).
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Interface {
    /// Its number.
    pub number: u8,
    /// The number of this alternate setting.
    pub alternate: u8,
    /// Class, subclass and protocol.
    pub class: [u8; 3],
    /// Its endpoints, except endpoint 0.
    pub endpoints: Vec<Endpoint>,
    /// Class-specific descriptors, each complete with its length and type.
    pub extra: Vec<Vec<u8>>,
}

/// The transfer type of an endpoint (table 9-13).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Transfer {
    /// Requests to the device.
    Control,
    /// A fixed part of every frame, without retries.
    Isochronous,
    /// The rest of the bandwidth, with retries.
    Bulk,
    /// Polled at an interval, with retries.
    Interrupt,
}

/// An endpoint (9.6.6).
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Endpoint {
    /// Its number, 1 to 15.
    pub number: u8,
    /// Its direction.
    pub direction: Direction,
    /// Its transfer type.
    pub transfer: Transfer,
    /// Its maximum packet size, in bytes.
    pub packet: u16,
    /// The polling interval of an interrupt endpoint, in frames of a millisecond.
    pub interval: u8,
}

/// A malformed descriptor.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error("bad {what} descriptor at byte {offset}: {bytes:02x?}")]
pub struct Malformed {
    /// Its name.
    pub what: &'static str,
    /// Its offset in the device's data.
    pub offset: usize,
    /// The device's data.
    pub bytes: Vec<u8>,
}

impl Device {
    /// Parses a device descriptor.
    ///
    /// # Errors
    ///
    /// If it is too short, or another descriptor.
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let &[
            _,
            DEVICE,
            usb0,
            usb1,
            class,
            subclass,
            protocol,
            packet,
            vendor0,
            vendor1,
            product0,
            product1,
            version0,
            version1,
            manufacturer,
            product,
            serial,
            configurations,
        ] = bytes
        else {
            return Err(malformed("device", 0, bytes));
        };
        Ok(Self {
            usb: u16::from_le_bytes([usb0, usb1]),
            class: [class, subclass, protocol],
            packet,
            vendor: u16::from_le_bytes([vendor0, vendor1]),
            product: u16::from_le_bytes([product0, product1]),
            version: u16::from_le_bytes([version0, version1]),
            strings: [manufacturer, product, serial],
            configurations,
        })
    }
}

impl Configuration {
    /// Parses a configuration descriptor with its interfaces and endpoints.
    ///
    /// # Errors
    ///
    /// If a descriptor is truncated, or an endpoint belongs to no interface.
    pub fn parse(bytes: &[u8]) -> Result<Self, Malformed> {
        let &[9, CONFIGURATION, total0, total1, _, value, _, _, current, ..] = bytes else {
            return Err(malformed("configuration", 0, bytes));
        };
        let total = usize::from(u16::from_le_bytes([total0, total1]));
        let mut configuration = Self {
            value,
            milliamps: 2 * u16::from(current),
            interfaces: Vec::new(),
        };
        if bytes.len() < total {
            return Err(malformed("configuration", bytes.len(), bytes));
        }
        let mut at = 9;
        while at < total {
            let length = usize::from(bytes[at]);
            let descriptor = (length >= 2)
                .then(|| bytes.get(at..at + length))
                .flatten()
                .ok_or_else(|| malformed("nested", at, bytes))?;
            let current = configuration.interfaces.last_mut();
            match (descriptor[1], current) {
                (INTERFACE, _) => configuration
                    .interfaces
                    .push(Interface::parse(descriptor).ok_or_else(|| malformed("interface", at, bytes))?),
                (ENDPOINT, Some(interface)) => interface
                    .endpoints
                    .push(Endpoint::parse(descriptor).ok_or_else(|| malformed("endpoint", at, bytes))?),
                (ENDPOINT, None) => return Err(malformed("endpoint", at, bytes)),
                (_, Some(interface)) => interface.extra.push(descriptor.to_vec()),
                // An interface association or a vendor-specific descriptor may precede the first interface.
                (_, None) => {}
            }
            at += length;
        }
        Ok(configuration)
    }
}

impl Interface {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let &[_, INTERFACE, number, alternate, _, class, subclass, protocol, ..] = bytes else {
            return None;
        };
        Some(Self {
            number,
            alternate,
            class: [class, subclass, protocol],
            endpoints: Vec::new(),
            extra: Vec::new(),
        })
    }

    /// Its first endpoint with this transfer type and direction.
    pub fn endpoint(&self, transfer: Transfer, direction: Direction) -> Option<Endpoint> {
        self.endpoints
            .iter()
            .copied()
            .find(|endpoint| endpoint.transfer == transfer && endpoint.direction == direction)
    }
}

impl Endpoint {
    fn parse(bytes: &[u8]) -> Option<Self> {
        let &[_, ENDPOINT, address, attributes, packet0, packet1, interval, ..] = bytes else {
            return None;
        };
        Some(Self {
            number: address & 0x0F,
            direction: if address & 0x80 == 0 {
                Direction::Out
            } else {
                Direction::In
            },
            transfer: match attributes & 3 {
                0 => Transfer::Control,
                1 => Transfer::Isochronous,
                2 => Transfer::Bulk,
                _ => Transfer::Interrupt,
            },
            packet: u16::from_le_bytes([packet0, packet1]) & 0x7FF,
            interval,
        })
    }
}

/// The text of a string descriptor (9.6.7).
///
/// # Errors
///
/// If it is another descriptor. Invalid UTF-16 is replaced by replacement characters.
pub fn string(bytes: &[u8]) -> Result<String, Malformed> {
    match bytes {
        [length, STRING, text @ ..] if usize::from(*length) == bytes.len() => {
            let units: Vec<u16> = text
                .chunks_exact(2)
                .map(|pair| u16::from_le_bytes([pair[0], pair[1]]))
                .collect();
            Ok(String::from_utf16_lossy(&units))
        }
        _ => Err(malformed("string", 0, bytes)),
    }
}

fn malformed(what: &'static str, offset: usize, bytes: &[u8]) -> Malformed {
    Malformed {
        what,
        offset,
        bytes: bytes.to_vec(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A CDC-ACM configuration as in the class specification, preceded by an interface association.
    const CDC: [u8; 75] = [
        9, 2, 75, 0, 2, 1, 0, 0x80, 50, // configuration
        8, 11, 0, 2, 2, 2, 0, 0, // association
        9, 4, 0, 0, 1, 2, 2, 0, 0, // communications interface
        5, 0x24, 0, 0x10, 1, // header
        4, 0x24, 2, 2, // abstract control management
        5, 0x24, 6, 0, 1, // union
        5, 0x24, 1, 0, 1, // call management
        7, 5, 0x81, 3, 8, 0, 255, // notifications
        9, 4, 1, 0, 2, 10, 0, 0, 0, // data interface
        7, 5, 0x02, 2, 64, 0, 0, // out
        7, 5, 0x82, 2, 64, 0, 0, // in
    ];

    #[test]
    fn configuration_parses_into_interfaces_and_endpoints() {
        let configuration = Configuration::parse(&CDC).unwrap();
        assert_eq!(configuration.value, 1);
        assert_eq!(configuration.milliamps, 100);
        let [control, data] = &configuration.interfaces[..] else {
            panic!("two interfaces: {configuration:?}");
        };
        assert_eq!(control.class, [2, 2, 0]);
        assert_eq!(control.extra.len(), 4);
        let notify = control.endpoint(Transfer::Interrupt, Direction::In).unwrap();
        assert_eq!((notify.number, notify.packet, notify.interval), (1, 8, 255));
        assert_eq!(data.endpoint(Transfer::Bulk, Direction::Out).unwrap().number, 2);
        assert_eq!(data.endpoint(Transfer::Bulk, Direction::In).unwrap().packet, 64);
    }

    #[test]
    fn configuration_cut_anywhere_is_refused_without_panic() {
        for length in 0..CDC.len() {
            assert!(Configuration::parse(&CDC[..length]).is_err(), "{length} bytes");
        }
    }

    #[test]
    fn zero_length_descriptor_does_not_hang_parser() {
        let mut bytes = CDC;
        bytes[9] = 0;
        assert_eq!(Configuration::parse(&bytes).unwrap_err().offset, 9);
    }

    #[test]
    fn strings_are_utf_16() {
        assert_eq!(string(&[6, 3, b'a', 0, 0xB5, 0]).unwrap(), "aµ");
        assert!(string(&[6, 3, b'a', 0]).is_err());
    }
}
