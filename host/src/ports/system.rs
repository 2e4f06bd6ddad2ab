//! Serial ports and interfaces for CAN, as the system lists them.

use std::fs;
use std::path::Path;

use serial2::SerialPort;

/// Type of a CAN interface in Linux (`ARPHRD_CAN`).
const CAN_TYPE: &str = "280";

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
