//! A serial port as a line.

#[cfg(unix)]
use std::fs;
use std::io::{self, ErrorKind};
use std::net::IpAddr;
#[cfg(unix)]
use std::os::unix::fs::MetadataExt;
use std::time::Duration;

#[cfg(unix)]
use rustix::fs::{FlockOperation, flock};
#[cfg(unix)]
use rustix::io::Errno;
#[cfg(unix)]
use rustix::termios::{ControlModes, InputModes, ioctl_tiocexcl, ioctl_tiocnxcl};
#[cfg(unix)]
use serial2::Settings;
use serial2::{KeepSettings, SerialPort};

use crate::error::Error;
use crate::error::text::{Remedy, Text};
use crate::ports::line::{Line, Names, Reception, is_nothing_yet};
use crate::ports::port_user;
use crate::ports::system;
use crate::ports::usb_name;

/// Timeout of a write. The longest request takes less than 40 ms at 9600 baud.
const WRITE_TIMEOUT: Duration = Duration::from_millis(500);

/// An open port.
pub(crate) struct Serial {
    /// Its path, or `usb:SERIAL`.
    name: String,
    port: SerialPort,
    baud: u32,
}

impl Line for Serial {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        // The library counts in milliseconds; rounded down, the last one would be spent without a pause.
        let millis = wait.as_micros().div_ceil(1_000).try_into().unwrap_or(u64::MAX);
        self.port
            .set_read_timeout(Duration::from_millis(millis))
            .map_err(|error| self.lost(error))?;
        match self.port.read(buf) {
            // Silence is a timeout, so this is the end.
            Ok(0) => Err(self.lost(ErrorKind::BrokenPipe.into())),
            Ok(n) => Ok(n),
            Err(error) if is_nothing_yet(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        // A port that has room takes bytes at once. The library asks the system for room first, each time.
        #[cfg(unix)]
        if let Ok(n @ 1..) = rustix::io::write(&self.port, bytes) {
            return Ok(n);
        }
        loop {
            match self.port.write(bytes) {
                Ok(n) if n > 0 => return Ok(n),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) if !is_nothing_yet(&error) => return Err(self.lost(error)),
                Ok(_) | Err(_) => {
                    return Err(Error::Stuck {
                        name: self.name.as_str().into(),
                    });
                }
            }
        }
    }

    fn hint(&self, reception: Reception, names: Names) -> Text {
        let (baud, arm) = (self.baud, names.arm);
        let (before, after) = match reception {
            Reception::Silence => (
                Text::from(format!(
                    "is the arm powered, is it on this port, and does it talk at {baud} baud"
                ))
                .remedy(Remedy::TryBaud)
                .and(&format!("? Is it {arm}, and not ")),
                " nor an SLCAN adapter (slcan:PORT)?",
            ),
            Reception::Garbage => (
                Text::from(format!("is {baud} the baud rate"))
                    .remedy(Remedy::TryBaud)
                    .and(&format!(", and is it {arm}, and not ")),
                "?",
            ),
        };
        before.append(&names.other()).and(after)
    }
}

impl Serial {
    /// Opens a port, by its path or as `usb:SERIAL`.
    pub(crate) fn open(name: &str, baud: u32) -> Result<Self, Error> {
        let path = system::serial_path(name).map_err(|reason| Error::at(name, reason))?;
        let port = open(&path, baud).map_err(|error| not_opened(name, &path, &error))?;
        let name = name.to_owned();
        Ok(Self { name, port, baud })
    }

    /// The baud rate.
    pub(crate) fn baud(&self) -> u32 {
        self.baud
    }

    fn lost(&self, error: io::Error) -> Error {
        Error::unplugged(&self.name, &error)
    }
}

#[cfg(unix)]
impl Drop for Serial {
    fn drop(&mut self) {
        // Otherwise a terminal that another program keeps open, such as the server of a pty, refuses later programs.
        let _ = ioctl_tiocnxcl(&self.port);
    }
}

/// Opens the port at this path for us alone, with nothing in it to read.
fn open(path: &str, baud: u32) -> io::Result<SerialPort> {
    // The settings of a port that another program uses are not ours to change.
    let mut port = SerialPort::open(path, KeepSettings)?;
    #[cfg(unix)]
    flock(&port, FlockOperation::NonBlockingLockExclusive)?;
    let mut settings = port.get_configuration()?;
    settings.set_raw();
    settings.set_baud_rate(baud)?;
    #[cfg(unix)]
    receive_all(&mut settings);
    port.set_configuration(&settings)?;
    // Discards bytes that an earlier program did not read.
    port.discard_input_buffer()?;
    port.set_write_timeout(WRITE_TIMEOUT)?;
    // This keeps out programs that do not try the lock.
    #[cfg(unix)]
    ioctl_tiocexcl(&port)?;
    Ok(port)
}

/// Turns the receiver on for any state of the modem lines, and receives a break as a byte: a wrong baud rate may cause
/// one.
#[cfg(unix)]
fn receive_all(settings: &mut Settings) {
    let termios = settings.as_termios_mut();
    termios.c_cflag |= (ControlModes::CREAD | ControlModes::CLOCAL).bits();
    termios.c_iflag &= !InputModes::IGNBRK.bits();
}

/// The error of a port that this computer does not have.
pub(crate) fn not_found(name: &str) -> Error {
    match system::serial_path(name) {
        Ok(path) => not_opened(name, &path, &ErrorKind::NotFound.into()),
        Err(reason) => Error::at(name, reason),
    }
}

/// The error of a port that cannot be opened at its path.
fn not_opened(name: &str, path: &str, error: &io::Error) -> Error {
    let reason = match error.kind() {
        // Another program has locked the port, or keeps all others from opening it.
        ErrorKind::WouldBlock | ErrorKind::ResourceBusy if cfg!(unix) => {
            let user = match port_user::owner(path) {
                Some(user) => user.to_string(),
                None => format!("another program ('fuser -v {path}' names it)"),
            };
            return Error::InUse {
                name: name.into(),
                user: user.into(),
            };
        }
        ErrorKind::NotFound if is_host(name) => "no such port; a server of a serial port is tcp:HOST:PORT".to_owned(),
        ErrorKind::NotFound => {
            let interfaces = system::can_interfaces().into_iter().map(|name| format!("can:{name}"));
            let names: Vec<_> = system::serial_ports().into_iter().chain(interfaces).collect();
            match names.as_slice() {
                [] => "no such port, nor any other: is the adapter plugged in?".to_owned(),
                names => format!("no such port; there are: {}", names.join(", ")),
            }
        }
        #[cfg(unix)]
        ErrorKind::PermissionDenied => match group(path) {
            Some(group) => format!(
                "permission denied: add yourself to the group '{group}' ('sudo usermod -aG {group} $USER') and log in again"
            ),
            None => {
                "permission denied: add yourself to the group that owns it (often dialout or uucp) and log in again"
                    .to_owned()
            }
        },
        // The error of Windows for a port that is already open.
        #[cfg(not(unix))]
        ErrorKind::PermissionDenied => {
            let user = "another program".to_owned();
            return Error::InUse {
                name: name.into(),
                user: user.into(),
            };
        }
        #[cfg(unix)]
        _ if Errno::from_io_error(error) == Some(Errno::NOTTY) => "not a serial port".to_owned(),
        _ => format!("cannot be opened: {error}"),
    };
    Error::at(name, reason)
}

/// Returns true for an address or a host name, with or without a port.
pub(crate) fn is_host(text: &str) -> bool {
    let is_port = |port: &str| port.parse::<u16>().is_ok();
    let has_port = text
        .rsplit_once(':')
        .is_some_and(|(host, port)| !host.contains('/') && is_port(port));
    // A USB serial number may be a number.
    usb_name::serial_in(text).is_none() && (has_port || text.parse::<IpAddr>().is_ok())
}

/// The group that owns a port, if that is one for users.
#[cfg(unix)]
fn group(path: &str) -> Option<String> {
    let gid = fs::metadata(path).ok()?.gid();
    let groups = fs::read_to_string("/etc/group").ok()?;
    // The format of a line is `name:password:id:members`.
    let mut fields = groups.lines().map(|line| line.split(':').collect::<Vec<_>>());
    let owner = fields.find(|fields| fields.get(2).is_some_and(|id| id.parse() == Ok(gid)))?;
    (gid != 0).then(|| owner[0].to_owned())
}
