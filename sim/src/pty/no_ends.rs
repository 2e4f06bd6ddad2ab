//! No pty: the system has none.

use std::convert::Infallible;
use std::io::{self, ErrorKind};
use std::path::Path;
use std::time::Duration;

#[derive(Debug)]
pub(super) struct Ends(Infallible);

impl Ends {
    pub(super) fn open(_link: Option<&Path>) -> io::Result<Self> {
        let text = "this system has no pseudo-terminals: a virtual serial port needs Linux or macOS";
        Err(io::Error::new(ErrorKind::Unsupported, text))
    }

    pub(super) fn path(&self) -> &Path {
        match self.0 {}
    }

    pub(super) fn baud(&self) -> io::Result<u32> {
        match self.0 {}
    }

    pub(super) fn set_baud(&self, _baud: u32) -> io::Result<()> {
        match self.0 {}
    }

    pub(super) fn read(&self, _bytes: &mut [u8]) -> io::Result<usize> {
        match self.0 {}
    }

    pub(super) fn write(&self, _bytes: &[u8]) -> io::Result<usize> {
        match self.0 {}
    }

    pub(super) fn wait_for_any<'a>(
        mut ends: impl Iterator<Item = &'a Self>,
        _timeout: Option<Duration>,
    ) -> io::Result<bool> {
        ends.next().map_or(Ok(false), |ends| match ends.0 {})
    }
}
