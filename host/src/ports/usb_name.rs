//! The name of a port by the serial number of its USB device, `usb:SERIAL`: it stays when the path changes.

use std::fmt::Write as _;

use crate::describe::escaped;

/// The beginning of a name.
const PREFIX: &str = "usb:";
/// The end of the name of an adapter's control port.
pub(crate) const CONTROL: &str = "/control";

/// A serial port of this computer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct SerialPortInfo {
    /// Its path.
    pub(crate) path: String,
    /// The serial number of its USB device. `None` if it has none, or is not on USB.
    pub(crate) serial: Option<String>,
}

/// The serial number in a name. `None` for a path.
pub(crate) fn serial_in(port: &str) -> Option<&str> {
    port.strip_prefix(PREFIX)
}

/// The name of the port with this serial number.
pub(crate) fn name_of(serial: &str) -> String {
    format!("{PREFIX}{serial}")
}

/// The name of the control port of the adapter with this serial number.
pub(crate) fn control_name_of(serial: &str) -> String {
    format!("{PREFIX}{serial}{CONTROL}")
}

/// The name of this port. `None` if it has no serial number, shares it, or has one that cannot be typed.
pub(crate) fn unique_name(port: &SerialPortInfo, ports: &[SerialPortInfo]) -> Option<String> {
    let serial = port.serial.as_deref()?;
    let is_typed = !serial.is_empty() && escaped(serial) == serial && !serial.ends_with(CONTROL);
    (is_typed && with_serial(serial, ports).count() == 1).then(|| name_of(serial))
}

/// The path of the only port with this serial number.
///
/// # Errors
///
/// The reason, if no port or several ports have it.
pub(crate) fn path<'a>(serial: &str, ports: &'a [SerialPortInfo]) -> Result<&'a str, String> {
    let paths: Vec<_> = with_serial(serial, ports).map(|port| port.path.as_str()).collect();
    match paths.as_slice() {
        [path] => Ok(path),
        [] => Err(not_found(ports)),
        several => Err(format!(
            "several ports have this USB serial number, {}: use a path",
            several.join(" and ")
        )),
    }
}

fn with_serial<'a>(serial: &str, ports: &'a [SerialPortInfo]) -> impl Iterator<Item = &'a SerialPortInfo> {
    ports.iter().filter(move |port| port.serial.as_deref() == Some(serial))
}

/// The reason for a serial number that no port has.
fn not_found(ports: &[SerialPortInfo]) -> String {
    let mut reason = "no port has this USB serial number".to_owned();
    for (n, port) in ports.iter().enumerate() {
        reason += if n == 0 { "; there are: " } else { ", " };
        reason += &port.path;
        if let Some(name) = unique_name(port, ports) {
            let _ = write!(reason, " ({name})");
        }
    }
    if ports.is_empty() {
        reason += ", and there are no ports: is the adapter plugged in?";
    }
    reason
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ports(ports: &[(&str, Option<&str>)]) -> Vec<SerialPortInfo> {
        let port = |&(path, serial): &(&str, Option<&str>)| SerialPortInfo {
            path: path.to_owned(),
            serial: serial.map(str::to_owned),
        };
        ports.iter().map(port).collect()
    }

    #[test]
    fn unique_serial_number_names_its_port() {
        let ports = ports(&[("/dev/ttyUSB0", Some("A50285BI")), ("/dev/ttyACM0", Some("35FFD8"))]);
        for port in &ports {
            let name = unique_name(port, &ports).unwrap();
            assert_eq!(path(serial_in(&name).unwrap(), &ports), Ok(port.path.as_str()));
        }
        // Serial numbers are compared as they are.
        assert!(path("a50285bi", &ports).is_err());
    }

    #[test]
    fn shared_serial_number_is_refused_with_the_paths() {
        let ports = ports(&[("/dev/ttyUSB0", Some("0001")), ("/dev/ttyUSB1", Some("0001"))]);
        assert_eq!(
            path("0001", &ports).unwrap_err(),
            "several ports have this USB serial number, /dev/ttyUSB0 and /dev/ttyUSB1: use a path"
        );
        assert_eq!(unique_name(&ports[0], &ports), None);
    }

    #[test]
    fn unknown_serial_number_is_refused_with_the_ports() {
        let there = ports(&[("/dev/ttyUSB0", None), ("/dev/ttyUSB1", Some("A1"))]);
        assert_eq!(
            path("A2", &there).unwrap_err(),
            "no port has this USB serial number; there are: /dev/ttyUSB0, /dev/ttyUSB1 (usb:A1)"
        );
        assert_eq!(
            path("A2", &[]).unwrap_err(),
            "no port has this USB serial number, and there are no ports: is the adapter plugged in?"
        );
    }

    #[test]
    fn port_without_usable_number_has_no_name() {
        for serial in [None, Some(""), Some("A\x1B[2J"), Some("A1/control")] {
            let ports = ports(&[("/dev/ttyUSB0", serial)]);
            assert_eq!(unique_name(&ports[0], &ports), None, "{serial:?}");
        }
    }
}
