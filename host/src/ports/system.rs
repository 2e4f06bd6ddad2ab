//! Serial ports with their USB devices, and interfaces for CAN, as the system lists them.

use std::fs;
use std::path::{Path, PathBuf};

use serial2::SerialPort;

use crate::ports::usb_name::{self, SerialPortInfo};

/// The serial ports of Linux.
const TTYS: &str = "/sys/class/tty";

/// Type of a CAN interface in Linux (`ARPHRD_CAN`).
const CAN_TYPE: &str = "280";

/// Serial ports, as paths.
pub(crate) fn serial_ports() -> Vec<String> {
    let ports = SerialPort::available_ports().unwrap_or_default();
    let names = ports.iter().map(|port| port.to_string_lossy().into_owned());
    names.filter(|name| !waits_for_carrier(name)).collect()
}

/// Serial ports with their serial numbers on USB, which only Linux shows.
pub(crate) fn serial_ports_on_usb() -> Vec<SerialPortInfo> {
    let info = |path: String| SerialPortInfo {
        serial: usb_device(&path).and_then(|device| serial_number(&device)),
        path,
    };
    serial_ports().into_iter().map(info).collect()
}

/// The path of a serial port, which may be named by its USB serial number.
///
/// # Errors
///
/// The reason, if no port or several ports have that number, or the system does not show it.
pub(crate) fn serial_path(port: &str) -> Result<String, String> {
    match usb_name::serial_in(port) {
        None => Ok(port.to_owned()),
        Some(serial) if cfg!(target_os = "linux") => usb_name::path(serial, &serial_ports_on_usb()).map(str::to_owned),
        Some(_) => {
            Err("this system does not show which port has this USB serial number: use the port's path".to_owned())
        }
    }
}

/// The folder of the USB device with the serial port at this path. `None` if it is not on USB, and except on Linux.
pub(crate) fn usb_device(path: &str) -> Option<PathBuf> {
    // The port may be a link, for example under /dev/serial/by-id.
    let device = fs::canonicalize(path).ok()?;
    usb_device_of(Path::new(TTYS), device.file_name()?.to_str()?)
}

/// The USB device above this port: a converter's port has a folder in that of its interface, an adapter's has none. Above
/// the device are hubs, whose serial numbers are not its own.
fn usb_device_of(ttys: &Path, name: &str) -> Option<PathBuf> {
    let port = fs::canonicalize(ttys.join(name).join("device")).ok()?;
    let device = port.ancestors().find(|folder| folder.join("idVendor").exists());
    device.map(Path::to_owned)
}

/// The serial number of the USB device with this folder.
fn serial_number(device: &Path) -> Option<String> {
    let serial = fs::read_to_string(device.join("serial")).ok()?;
    Some(serial.trim_end().to_owned())
}

/// Returns true for a port of macOS whose open waits for a carrier. Each has a twin that does not, `/dev/cu.…`.
fn waits_for_carrier(port: &str) -> bool {
    port.starts_with("/dev/tty.")
}

/// Returns true if this computer has this serial port, a path or `usb:SERIAL`. Windows ignores case, and a prefix.
pub fn has_serial_port(port: &str) -> bool {
    if usb_name::serial_in(port).is_some() {
        return serial_path(port).is_ok();
    }
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

    #[cfg(unix)]
    #[test]
    fn serial_number_is_that_of_the_ports_device() {
        use std::os::unix::fs::symlink;

        let root = std::env::temp_dir().join(format!("armwire-usb-{}", std::process::id()));
        let folder = |path: &str| {
            let folder = root.join(path);
            fs::create_dir_all(&folder).unwrap();
            folder
        };
        let device = |path: &str, serial: Option<&str>| {
            let folder = folder(path);
            fs::write(folder.join("idVendor"), "1209\n").unwrap();
            if let Some(serial) = serial {
                fs::write(folder.join("serial"), format!("{serial}\n")).unwrap();
            }
        };
        device("usb1", Some("0000:00:14.0"));
        device("usb1/1-1", Some("A50285BI"));
        device("usb1/1-2", None);
        device("usb1/1-3", Some("35FFD8"));
        for (name, port) in [
            ("ttyUSB0", "usb1/1-1/1-1:1.0/ttyUSB0"),
            ("ttyUSB1", "usb1/1-2/1-2:1.0/ttyUSB1"),
            ("ttyACM0", "usb1/1-3/1-3:1.1"),
            ("ttyS0", "serial8250"),
        ] {
            symlink(folder(port), folder(&format!("class/{name}")).join("device")).unwrap();
        }
        let serial = |name| serial_number(&usb_device_of(&root.join("class"), name)?);
        assert_eq!(serial("ttyUSB0").as_deref(), Some("A50285BI"));
        assert_eq!(serial("ttyUSB1"), None, "not the hub's");
        assert_eq!(serial("ttyACM0").as_deref(), Some("35FFD8"));
        assert_eq!(serial("ttyS0"), None);
        assert_eq!(serial("ttyS1"), None);
        fs::remove_dir_all(&root).unwrap();
    }

    #[test]
    fn only_call_out_ports_of_macos_are_listed() {
        assert!(waits_for_carrier("/dev/tty.usbserial-0001"));
        for port in ["/dev/cu.usbserial-0001", "/dev/ttyUSB0", "COM3"] {
            assert!(!waits_for_carrier(port), "{port}");
        }
    }
}
