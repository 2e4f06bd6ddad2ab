//! The ports of this computer, by the names that a user types for them.

use std::fmt::{self, Display, Formatter};

use armwire_bridge::can::Node;

use crate::ports::control::usb;
use crate::ports::hid::{self, Selector};
use crate::ports::port::Port;
use crate::ports::system::{can_interfaces, serial_ports};

/// A port of this computer. It is displayed as the text of its port.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct PortInfo {
    /// The port.
    pub port: Port,
    /// The serial number of the adapter on USB whose port it is. `None` for other ports, and on other systems than Linux.
    pub adapter: Option<String>,
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
    let serial = serial_ports().into_iter().map(|port| PortInfo {
        adapter: usb::serial_number_of(&port).filter(|serial| adapters.contains(serial)),
        port: Port::Serial(port),
    });
    let other = |port| PortInfo { port, adapter: None };
    let robots = hid::alpha1_names()
        .into_iter()
        .map(|name| Port::Hid(Selector::Name(name)));
    let interfaces = can_interfaces().into_iter().map(|interface| Port::Can {
        interface,
        node: Node::default(),
    });
    serial.chain(robots.chain(interfaces).map(other)).collect()
}
