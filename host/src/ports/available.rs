//! The ports of this computer, by the names that a user types for them.

use std::fmt::{self, Display, Formatter};

use armwire_bridge::can::Node;

use crate::ports::control::usb;
use crate::ports::hid::{self, Selector};
use crate::ports::port::Port;
use crate::ports::system::{can_interfaces, serial_ports_on_usb};
use crate::ports::usb_name::unique_name;

/// A port of this computer. It is displayed as the text of its port.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PortInfo {
    /// The port.
    pub port: Port,
    /// The serial number of the adapter on USB whose port it is. `None` for other ports, and on other systems than Linux.
    pub adapter: Option<String>,
    /// The same port by its USB serial number, as `usb:SERIAL`. `None` if it has none or shares it, for other ports, and on
    /// other systems than Linux.
    pub usb: Option<Port>,
}

impl Display for PortInfo {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        self.port.fmt(f)
    }
}

/// Serial ports, then HID devices with the ids of an Alpha1, then CAN interfaces. Nothing is opened. A kind
/// that this computer cannot list is left out.
pub fn ports() -> Vec<PortInfo> {
    let adapters = usb::serial_numbers();
    let found = serial_ports_on_usb();
    let serial = found.iter().map(|port| PortInfo {
        port: Port::Serial(port.path.clone()),
        adapter: port.serial.clone().filter(|serial| adapters.contains(serial)),
        usb: unique_name(port, &found).map(Port::Serial),
    });
    let other = |port| PortInfo {
        port,
        adapter: None,
        usb: None,
    };
    let robots = hid::alpha1_names()
        .into_iter()
        .map(|name| Port::Hid(Selector::Name(name)));
    let interfaces = can_interfaces().into_iter().map(|interface| Port::Can {
        interface,
        node: Node::default(),
    });
    serial.chain(robots.chain(interfaces).map(other)).collect()
}
