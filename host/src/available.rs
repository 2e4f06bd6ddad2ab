//! The ports of this computer, by the names that a user types for them.

use std::fmt::{self, Display, Formatter};
use std::fs;
use std::path::Path;

use armwire_bridge::can::Node;
use serial2::SerialPort;

use crate::control::usb;
use crate::hid::{self, Selector};
use crate::port::Port;

/// Type of a CAN interface in Linux (`ARPHRD_CAN`).
const CAN_TYPE: &str = "280";

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

/// Serial ports, as paths.
pub(crate) fn serial_ports() -> Vec<String> {
    let ports = SerialPort::available_ports().unwrap_or_default();
    let names = ports.iter().map(|port| port.to_string_lossy().into_owned());
    names.filter(|name| !waits_for_carrier(name)).collect()
}

/// Returns true for a port of macOS whose open waits for a carrier. Each has a twin that does not, `/dev/cu.…`.
fn waits_for_carrier(port: &str) -> bool {
    port.starts_with("/dev/tty.")
}

/// Returns true if this computer has this serial port. Windows ignores case, and a prefix.
pub fn has_serial_port(port: &str) -> bool {
    if cfg!(windows) {
        let port = port.trim_start_matches(r"\\.\");
        return serial_ports().iter().any(|known| known.eq_ignore_ascii_case(port));
    }
    // Not only known names: a link is a port, too.
    Path::new(port).exists()
}

/// The interfaces that Linux has for CAN. Other systems have none.
pub(crate) fn can_interfaces() -> Vec<String> {
    let Ok(entries) = fs::read_dir("/sys/class/net") else {
        return Vec::new();
    };
    let is_can = |name: &String| {
        let kind = fs::read_to_string(format!("/sys/class/net/{name}/type"));
        kind.is_ok_and(|kind| kind.trim() == CAN_TYPE)
    };
    let names = entries
        .flatten()
        .map(|entry| entry.file_name().to_string_lossy().into_owned());
    let mut names: Vec<_> = names.filter(is_can).collect();
    names.sort();
    names
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_call_out_ports_of_macos_are_listed() {
        assert!(waits_for_carrier("/dev/tty.usbserial-0001"));
        for port in ["/dev/cu.usbserial-0001", "/dev/ttyUSB0", "COM3"] {
            assert!(!waits_for_carrier(port), "{port}");
        }
    }
}
