//! The ports of this computer, by the names that a user types for them.

use std::fs;
use std::path::Path;

use serial2::SerialPort;

/// Type of a CAN interface in Linux (`ARPHRD_CAN`).
const CAN_TYPE: &str = "280";

/// Serial ports, and CAN interfaces, as the text of a [`Port`](crate::Port). Nothing is opened.
pub fn ports() -> Vec<String> {
    let interfaces = can_interfaces().into_iter().map(|name| format!("can:{name}"));
    serial_ports().into_iter().chain(interfaces).collect()
}

/// Serial ports, as paths.
pub fn serial_ports() -> Vec<String> {
    let ports = SerialPort::available_ports().unwrap_or_default();
    ports.iter().map(|port| port.to_string_lossy().into_owned()).collect()
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
pub fn can_interfaces() -> Vec<String> {
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
