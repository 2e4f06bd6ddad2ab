//! A vendor-specific interface: a pair of bulk endpoints without a class driver.

use super::Direction;
use super::descriptor::{Configuration, Endpoint, Transfer};

/// Class, subclass and protocol of a vendor-specific interface (USB 2.0, table 9-12).
const CLASS: [u8; 3] = [0xFF, 0, 0];

/// A device's vendor-specific interface, with its endpoints.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Vendor {
    /// The interface.
    pub interface: u8,
    /// The OUT endpoint.
    pub output: Endpoint,
    /// The IN endpoint.
    pub input: Endpoint,
}

impl Vendor {
    /// The device's first one with both endpoints.
    pub fn find(configuration: &Configuration) -> Option<Self> {
        configuration
            .interfaces
            .iter()
            .filter(|interface| interface.class == CLASS)
            .find_map(|interface| {
                Some(Self {
                    interface: interface.number,
                    output: interface.endpoint(Transfer::Bulk, Direction::Out)?,
                    input: interface.endpoint(Transfer::Bulk, Direction::In)?,
                })
            })
    }
}

#[cfg(test)]
mod tests {
    use super::super::cdc::Port;
    use super::*;

    /// A serial port and a vendor-specific interface: USB 2.0, 9.6; CDC 1.2, 5.2.3.
    const BOTH: [u8; 69] = [
        9, 2, 69, 0, 3, 1, 0, 0x80, 50, // configuration
        9, 4, 0, 0, 1, 2, 2, 0, 0, // communications interface
        5, 0x24, 6, 0, 1, // union
        7, 5, 0x81, 3, 8, 0, 255, // notifications
        9, 4, 1, 0, 2, 10, 0, 0, 0, // data interface
        7, 5, 0x02, 2, 64, 0, 0, // out
        7, 5, 0x82, 2, 64, 0, 0, // in
        9, 4, 2, 0, 1, 0xFF, 0, 0, 0, // vendor-specific, without an OUT endpoint
        7, 5, 0x83, 2, 64, 0, 0, // in
    ];

    #[test]
    fn vendor_interface_is_found_beside_serial_port() {
        let one_way = Configuration::parse(&BOTH).unwrap();
        assert_eq!(Vendor::find(&one_way), None);
        let mut bytes = BOTH.to_vec();
        bytes.extend([7, 5, 0x03, 2, 64, 0, 0]);
        bytes[2] += 7;
        bytes[9 + 9 + 5 + 7 + 9 + 14 + 4] = 2;
        let both = Configuration::parse(&bytes).unwrap();
        let vendor = Vendor::find(&both).unwrap();
        assert_eq!((vendor.interface, vendor.output.number, vendor.input.number), (2, 3, 3));
        assert_eq!(Port::find(&both).len(), 1);
    }
}
