//! Serial ports with their USB devices, and interfaces for CAN, as the system lists them.

use std::fs;
#[cfg(target_os = "linux")]
use std::os::unix::fs::{FileTypeExt, MetadataExt};
use std::path::{Path, PathBuf};

use serial2::SerialPort;

use crate::ports::usb_name::{self, SerialPortInfo};

/// The character devices of Linux, by their numbers.
const DEVICES: &str = "/sys/dev/char";

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
        serial: match usb_device(&path) {
            UsbDevice::At(folder) => serial_number(&folder),
            UsbDevice::None | UsbDevice::NotShown => None,
        },
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

/// The USB device with a serial port.
#[derive(Debug, PartialEq, Eq)]
pub(crate) enum UsbDevice {
    /// The device with this folder.
    At(PathBuf),
    /// The port is not on USB.
    None,
    /// The system does not show it. Only Linux does, and not for a pty.
    NotShown,
}

/// The USB device with the serial port at this path.
pub(crate) fn usb_device(path: &str) -> UsbDevice {
    match device_number(path) {
        Some(number) => usb_device_of(Path::new(DEVICES), &number),
        None => UsbDevice::NotShown,
    }
}

/// The number of a port, which names its folder among the devices. A path does not: it may be a link, and a container may
/// have the port by another name.
#[cfg(target_os = "linux")]
fn device_number(path: &str) -> Option<String> {
    let port = fs::metadata(path).ok()?;
    let number = port.rdev();
    let is_device = port.file_type().is_char_device();
    is_device.then(|| format!("{}:{}", rustix::fs::major(number), rustix::fs::minor(number)))
}

/// Other systems have no such folders.
#[cfg(not(target_os = "linux"))]
fn device_number(_: &str) -> Option<String> {
    None
}

/// The USB device above this port: a converter's port has a folder in that of its interface, an adapter's has none. Above
/// the device are hubs, whose serial numbers are not its own.
fn usb_device_of(devices: &Path, number: &str) -> UsbDevice {
    let port = devices.join(number);
    if !port.exists() {
        return UsbDevice::NotShown;
    }
    let Ok(device) = fs::canonicalize(port.join("device")) else {
        return UsbDevice::None;
    };
    let mut folders = device.ancestors();
    match folders.find(|folder| folder.join("idVendor").exists()) {
        Some(folder) => UsbDevice::At(folder.to_owned()),
        None => UsbDevice::None,
    }
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

    #[cfg(target_os = "linux")]
    #[test]
    fn device_is_found_by_number_not_name() {
        let link = std::env::temp_dir().join(format!("armwire-null-{}", std::process::id()));
        std::os::unix::fs::symlink("/dev/null", &link).unwrap();
        assert_eq!(device_number(link.to_str().unwrap()).as_deref(), Some("1:3"));
        fs::remove_file(&link).unwrap();
        assert_eq!(device_number("/dev"), None);
    }

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
        for (number, port) in [
            ("188:0", "usb1/1-1/1-1:1.0/ttyUSB0"),
            ("188:1", "usb1/1-2/1-2:1.0/ttyUSB1"),
            ("166:0", "usb1/1-3/1-3:1.1"),
            ("4:64", "serial8250"),
        ] {
            symlink(folder(port), folder(&format!("char/{number}")).join("device")).unwrap();
        }
        folder("char/5:0");
        let device = |number| usb_device_of(&root.join("char"), number);
        let serial = |number| match device(number) {
            UsbDevice::At(folder) => serial_number(&folder),
            other => panic!("{number}: {other:?}"),
        };
        assert_eq!(serial("188:0").as_deref(), Some("A50285BI"));
        assert_eq!(serial("188:1"), None, "not the hub's");
        assert_eq!(serial("166:0").as_deref(), Some("35FFD8"));
        assert_eq!(device("4:64"), UsbDevice::None, "no device of USB");
        assert_eq!(device("5:0"), UsbDevice::None, "no device");
        assert_eq!(device("136:0"), UsbDevice::NotShown);
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
