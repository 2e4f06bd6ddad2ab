//! No pseudo-terminal: the system has none.

use std::convert::Infallible;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::Duration;

/// A pty, which does not exist.
#[derive(Debug)]
pub struct Pty(Infallible);

impl Pty {
    /// # Errors
    ///
    /// Always.
    pub fn open(_link: Option<&Path>) -> io::Result<Self> {
        let text = "this system has no pseudo-terminals: a virtual serial port needs Linux or macOS";
        Err(io::Error::new(ErrorKind::Unsupported, text))
    }

    /// Returns the path for clients.
    pub fn path(&self) -> &Path {
        match self.0 {}
    }

    /// Returns the baud rate set by the last client.
    ///
    /// # Errors
    ///
    /// None.
    pub fn baud(&self) -> io::Result<u32> {
        match self.0 {}
    }

    /// Sets the baud rate, as a client would.
    ///
    /// # Errors
    ///
    /// None.
    pub fn set_baud(&self, _baud: u32) -> io::Result<()> {
        match self.0 {}
    }

    /// Reads the clients' bytes.
    ///
    /// # Errors
    ///
    /// None.
    pub fn read(&self, _bytes: &mut [u8]) -> io::Result<usize> {
        match self.0 {}
    }

    /// Writes bytes to the clients.
    ///
    /// # Errors
    ///
    /// None.
    pub fn write(&self, _bytes: &[u8]) -> io::Result<usize> {
        match self.0 {}
    }

    /// Waits for bytes.
    ///
    /// # Errors
    ///
    /// None.
    pub fn wait(&self, _timeout: Option<Duration>) -> io::Result<bool> {
        match self.0 {}
    }
}
