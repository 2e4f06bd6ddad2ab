//! A pseudo-terminal in place of a serial port.
//!
//! Any serial program can open it. A pty has no UART: the ioctls for DTR and RTS fail, and bytes take no time. The
//! server is responsible for baud rate and pacing.

#[cfg_attr(not(unix), path = "pty/no_ends.rs")]
mod ends;
#[cfg(unix)]
mod link;
#[cfg(all(test, unix))]
mod tests;

use std::io;
use std::path::Path;
use std::time::Duration;

use ends::Ends;

/// Both ends of a pty in raw mode. The server's end is non-blocking.
///
/// Clients may open and close the pty at any time; only their bytes are visible to the server. Unread bytes of one
/// client remain for the next, unless it empties its input buffer, as serial libraries can. Dropping this removes
/// its symbolic link and closes the pty.
///
/// ```
/// use std::io::{Read, Write};
/// use armwire_sim::pty::Pty;
///
/// let pty = Pty::open(None)?;
/// let mut client = std::fs::OpenOptions::new().read(true).write(true).open(pty.path())?;
/// client.write_all(&[0xAA, 0x0A, 0x0D])?;
///
/// let mut bytes = [0; 64];
/// pty.wait(None)?;
/// assert_eq!(pty.read(&mut bytes)?, 3);
/// assert_eq!(pty.read(&mut bytes)?, 0);
/// assert_eq!(pty.write(&[0x03])?, 1);
/// client.read_exact(&mut bytes[..1])?;
/// assert_eq!(bytes[0], 0x03);
/// # Ok::<(), std::io::Error>(())
/// ```
#[derive(Debug)]
pub struct Pty(Ends);

impl Pty {
    /// Creates a pty and, if `link` is given, a symbolic link to it.
    ///
    /// # Errors
    ///
    /// If the system has no free pty, or the link cannot be created. The link of a killed server is replaced. Anything
    /// else at that path, the link of a running server included, is [`io::ErrorKind::AlreadyExists`]. Windows has no ptys:
    /// [`io::ErrorKind::Unsupported`].
    ///
    /// A running server holds a lock on the empty file `LINK.lock`.
    pub fn open(link: Option<&Path>) -> io::Result<Self> {
        Ends::open(link).map(Self)
    }

    /// Returns the path for clients: the symbolic link if there is one, else the device.
    pub fn path(&self) -> &Path {
        self.0.path()
    }

    /// Returns the baud rate set by the last client.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn baud(&self) -> io::Result<u32> {
        self.0.baud()
    }

    /// Sets the baud rate, as a client would.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn set_baud(&self, baud: u32) -> io::Result<()> {
        self.0.set_baud(baud)
    }

    /// Reads the clients' bytes, as many as are available and fit, perhaps none. Does not block.
    ///
    /// Call it a few times a second even when no bytes are expected. A client's exclusive use of a terminal
    /// (`TIOCEXCL`) ends when the last descriptor is closed; the server keeps one open, so reading ends it instead. A
    /// file lock, which serial libraries also take, lasts until its owner closes the port or dies.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn read(&self, bytes: &mut [u8]) -> io::Result<usize> {
        self.0.read(bytes)
    }

    /// Writes bytes to the clients, as many as there is room for, perhaps none. Does not block.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn write(&self, bytes: &[u8]) -> io::Result<usize> {
        self.0.write(bytes)
    }

    /// Waits for bytes to [`read`](Self::read), without limit or up to a timeout. Returns true if there are any.
    ///
    /// A signal ends the wait early.
    ///
    /// # Errors
    ///
    /// If the system call fails.
    pub fn wait(&self, timeout: Option<Duration>) -> io::Result<bool> {
        wait_for_any(&[self], timeout)
    }
}

/// Waits for bytes to [`read`](Pty::read) at any of these, without limit or up to a timeout. Returns true if there are
/// any.
///
/// A signal ends the wait early.
///
/// # Errors
///
/// If the system call fails.
pub fn wait_for_any(ptys: &[&Pty], timeout: Option<Duration>) -> io::Result<bool> {
    Ends::wait_for_any(ptys.iter().map(|pty| &pty.0), timeout)
}
