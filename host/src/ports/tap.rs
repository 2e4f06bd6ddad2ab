//! A line, and a recipient of the bytes on it.

use std::time::Duration;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

/// A recipient of the bytes on a line.
pub trait Tap: Send {
    /// Bytes that the line accepted.
    fn sent(&mut self, bytes: &[u8]);

    /// Bytes from the line.
    fn received(&mut self, bytes: &[u8]);
}

/// A line that may have a tap.
pub(crate) struct Tapped {
    pub(crate) line: Box<dyn Line>,
    pub(crate) tap: Option<Box<dyn Tap>>,
}

impl Tapped {
    /// A line without a tap.
    pub(crate) fn new(line: Box<dyn Line>) -> Self {
        Self { line, tap: None }
    }
}

impl Line for Tapped {
    fn name(&self) -> &str {
        self.line.name()
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        let n = self.line.read(buf, wait)?;
        if let Some(tap) = &mut self.tap {
            tap.received(&buf[..n]);
        }
        Ok(n)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let n = self.line.write(bytes)?;
        if let Some(tap) = &mut self.tap {
            tap.sent(&bytes[..n]);
        }
        Ok(n)
    }

    fn hint(&self, reception: Reception, arm: Names) -> Text {
        self.line.hint(reception, arm)
    }
}
