//! A TCP connection as a line.

use std::fmt;
use std::io::{self, ErrorKind, Read, Write};
use std::net::{SocketAddr, TcpStream, ToSocketAddrs};
use std::str::FromStr;
use std::time::Duration;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception, is_nothing_yet};

/// TCP port of an xArm's requests.
const PORT: u16 = 502;
/// Timeout of a connection to each address of a name.
const CONNECT_TIMEOUT: Duration = Duration::from_secs(3);
/// Timeout of a write.
const WRITE_TIMEOUT: Duration = Duration::from_secs(2);

/// A host and a port on it.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct TcpAddress {
    host: String,
    port: u16,
}

/// [`Error::Port`] if the text names no host.
impl FromStr for TcpAddress {
    type Err = Error;

    /// A host, for example `192.168.1.10`, `arm.local:502`, `::1` or `[::1]:502`.
    fn from_str(text: &str) -> Result<Self, Error> {
        Self::parse(text, Some(PORT)).map_err(|reason| Error::Port(reason.into()))
    }
}

impl TcpAddress {
    /// An address, for example `192.168.1.10:4000` or `[::1]:4000`. The port may be omitted if there is a default.
    pub(crate) fn parse(text: &str, usual_port: Option<u16>) -> Result<Self, String> {
        let (host, port) = match text.rsplit_once(':') {
            Some((host, port)) if !host.contains(':') || host.ends_with(']') => (host, port.parse().ok()),
            _ if usual_port.is_none() => return Err(format!("'{text}' has no port, such as {text}:4000")),
            _ => (text, usual_port),
        };
        let bare = host.strip_prefix('[').and_then(|host| host.strip_suffix(']'));
        match (bare.unwrap_or(host), port) {
            ("", _) => Err(format!("'{text}' names no host")),
            (_, None) => Err(format!("what follows the colon of '{text}' is not a port, 1 to 65535")),
            (_, Some(0)) => Err("there is no port 0".to_owned()),
            (host, Some(port)) => Ok(Self {
                host: host.to_owned(),
                port,
            }),
        }
    }
}

impl fmt::Display for TcpAddress {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.host.contains(':') {
            true => write!(f, "[{}]:{}", self.host, self.port),
            false => write!(f, "{}:{}", self.host, self.port),
        }
    }
}

/// An open connection.
pub(crate) struct Tcp {
    name: String,
    stream: TcpStream,
    is_serial: bool,
}

impl Tcp {
    /// Connects to an xArm or, if `is_serial`, to a server of an arm's serial port.
    pub(crate) fn connect(host: &TcpAddress, is_serial: bool) -> Result<Self, Error> {
        let name = host.to_string();
        let addresses = (host.host.as_str(), host.port).to_socket_addrs();
        let addresses = addresses.map_err(|error| {
            let reason = format_args!("no such host ({error}): give its address instead?");
            Error::at(&name, reason)
        })?;
        let mut connected = Err(ErrorKind::AddrNotAvailable.into());
        for address in addresses {
            connected = open(&address);
            if connected.is_ok() {
                break;
            }
        }
        let stream = connected.map_err(|error| not_connected(&name, peer(is_serial), &error))?;
        Ok(Self {
            name,
            stream,
            is_serial,
        })
    }
}

fn open(address: &SocketAddr) -> io::Result<TcpStream> {
    let stream = TcpStream::connect_timeout(address, CONNECT_TIMEOUT)?;
    stream.set_nodelay(true)?;
    stream.set_write_timeout(Some(WRITE_TIMEOUT))?;
    Ok(stream)
}

impl Line for Tcp {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        match self.read_within(buf, wait) {
            Ok(0) => {
                let peer = peer(self.is_serial);
                let reason = format_args!(
                    "the {peer} closed the connection: is it switched off, or does it accept no more connections?"
                );
                Err(Error::lost(&self.name, reason))
            }
            Ok(n) => Ok(n),
            Err(error) if is_nothing_yet(&error) => Ok(0),
            Err(error) => Err(self.lost(error)),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        loop {
            match self.stream.write(bytes) {
                Ok(0) => return Err(self.lost(ErrorKind::WriteZero.into())),
                Ok(n) => return Ok(n),
                Err(error) if error.kind() == ErrorKind::Interrupted => {}
                Err(error) => return Err(self.lost(error)),
            }
        }
    }

    fn hint(&self, reception: Reception, names: Names) -> Text {
        let arm = names.arm;
        let begin = match (reception, self.is_serial) {
            (Reception::Silence, false) => return format!("is {arm} listening at this address and port?").into(),
            (Reception::Garbage, false) => return "is this an xArm's control port?".into(),
            (Reception::Silence, true) => "is the arm powered, and is it on the server's serial port? Is it",
            (Reception::Garbage, true) => "does the server's serial port use the arm's baud rate, and is it",
        };
        Text::from(format!("{begin} {arm}, not "))
            .append(&names.other())
            .and("?")
    }
}

impl Tcp {
    /// Reads the available bytes, waiting at most `wait` for the first one.
    fn read_within(&mut self, buf: &mut [u8], wait: Duration) -> io::Result<usize> {
        // No timeout at all would mean forever, and the shortest one takes a tick of the system's clock.
        if wait.is_zero() {
            self.stream.set_nonblocking(true)?;
            let read = self.stream.read(buf);
            self.stream.set_nonblocking(false)?;
            return read;
        }
        self.stream.set_read_timeout(Some(wait))?;
        self.stream.read(buf)
    }

    fn lost(&self, error: io::Error) -> Error {
        let peer = peer(self.is_serial);
        let reason = match error.kind() {
            ErrorKind::WouldBlock | ErrorKind::TimedOut => {
                format!("the connection accepts no bytes: is the {peer} still there?")
            }
            _ => format!("the connection is gone ({error}): was the {peer} switched off?"),
        };
        Error::lost(&self.name, reason)
    }
}

/// The other end of a connection, in words.
fn peer(is_serial: bool) -> &'static str {
    match is_serial {
        true => "server",
        false => "arm",
    }
}

/// The error of a failed connection.
fn not_connected(name: &str, peer: &str, error: &io::Error) -> Error {
    let reason = match error.kind() {
        ErrorKind::ConnectionRefused => {
            format!("nothing listens there: is it the right address and port, and has the {peer} started?")
        }
        ErrorKind::TimedOut | ErrorKind::HostUnreachable | ErrorKind::NetworkUnreachable => format!(
            "cannot be reached ({error}): is it the right address, is the {peer} on, and is this computer in its \
             network?"
        ),
        _ => format!("connection failed: {error}"),
    };
    Error::at(name, reason)
}

#[cfg(test)]
mod tests {
    use std::net::TcpListener;

    use super::*;

    #[test]
    fn hosts_are_names_or_addresses_with_ports() {
        for (text, shown) in [
            ("192.168.1.10", "192.168.1.10:502"),
            ("arm.local:15020", "arm.local:15020"),
            ("::1", "[::1]:502"),
            ("[::1]", "[::1]:502"),
            ("[fe80::2]:1502", "[fe80::2]:1502"),
        ] {
            assert_eq!(text.parse::<TcpAddress>().unwrap().to_string(), shown);
        }
    }

    #[test]
    fn invalid_host_and_port_is_reported() {
        for text in ["", ":502", "arm:", "arm:x", "arm:65536", "arm:0", "[]:1"] {
            assert!(text.parse::<TcpAddress>().is_err(), "{text}");
        }
    }

    #[test]
    fn read_without_a_wait_returns_what_has_arrived() {
        let server = TcpListener::bind("127.0.0.1:0").unwrap();
        let host = server.local_addr().unwrap().to_string().parse().unwrap();
        let mut line = Tcp::connect(&host, true).unwrap();
        let (mut arm, _) = server.accept().unwrap();
        let mut buf = [0; 8];
        assert_eq!(line.read(&mut buf, Duration::ZERO).unwrap(), 0);
        arm.write_all(&[1, 2, 3]).unwrap();
        assert_eq!(line.read(&mut buf, Duration::MAX).unwrap(), 3);
        arm.write_all(&[4]).unwrap();
        line.stream.peek(&mut buf).unwrap();
        assert_eq!(line.read(&mut buf, Duration::ZERO).unwrap(), 1);
        drop(arm);
        line.stream.peek(&mut buf).unwrap();
        assert!(matches!(line.read(&mut buf, Duration::ZERO), Err(Error::Lost { .. })));
    }
}
