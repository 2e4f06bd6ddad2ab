//! An open port, for the bytes of any protocol.

use std::fmt;
use std::time::{Duration, Instant};

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::interrupt::{Interrupt, Interrupter};
use crate::ports::line::{Line, Names, Reception};
use crate::ports::tap::Tap;

/// An open port without a protocol, from [`Connection::raw`](crate::Connection::raw). It is closed on drop.
pub struct RawPort {
    pub(super) line: Box<dyn Line>,
    tap: Option<Box<dyn Tap>>,
    pub(super) interrupter: Interrupter,
}

impl RawPort {
    /// A port without a tap and an interrupt.
    pub(super) fn new(line: Box<dyn Line>) -> Self {
        Self {
            line,
            tap: None,
            interrupter: Interrupter::default(),
        }
    }

    /// The port's name, as typed by the user.
    pub fn name(&self) -> &str {
        self.line.name()
    }

    /// Reads the bytes that have arrived, or waits at most `wait` for the first one. Returns their number; 0 if none
    /// arrived, or if `buf` is empty. A wait with an [interrupt](Self::set_interrupt) ends after 100 ms at most.
    ///
    /// # Errors
    ///
    /// [`Error::Lost`] if the port or the connection is gone, [`Error::Interrupted`] by the interrupt. Others of a CAN
    /// bus.
    pub fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        // No read waits on a line that always has bytes. Before they are taken: an error loses none.
        self.interrupter.run_if_due(Instant::now())?;
        // To a line, 0 bytes are its end.
        if buf.is_empty() {
            return Ok(0);
        }
        let n = self.line.read(buf, self.interrupter.part(wait))?;
        if let Some(tap) = &mut self.tap {
            tap.received(&buf[..n]);
        }
        if n == 0 && !wait.is_zero() {
            self.interrupter.run(Instant::now())?;
        }
        Ok(n)
    }

    /// Writes some of the bytes, at least one if there are any, and returns how many. On CAN they are one message,
    /// whose length is [limited](crate::Connection::raw), and all are written.
    ///
    /// # Errors
    ///
    /// [`Error::Lost`] if the port or the connection is gone, [`Error::Stuck`] if it accepts no bytes. Others of a CAN
    /// bus.
    pub fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        if bytes.is_empty() {
            return Ok(0);
        }
        let n = self.line.write(bytes)?;
        if let Some(tap) = &mut self.tap {
            tap.sent(&bytes[..n]);
        }
        Ok(n)
    }

    /// Writes all bytes.
    ///
    /// # Errors
    ///
    /// As [`write`](Self::write).
    pub fn write_all(&mut self, mut bytes: &[u8]) -> Result<(), Error> {
        while !bytes.is_empty() {
            let n = self.write(bytes)?;
            bytes = &bytes[n..];
        }
        Ok(())
    }

    /// Makes reads run this check at least every 100 ms, whether bytes arrive or not. Its error ends the read, as
    /// [`Error::Interrupted`]: no bytes are lost.
    pub fn set_interrupt(&mut self, check: impl FnMut() -> Interrupt + Send + 'static) {
        self.interrupter.set(Some(Box::new(check)));
    }

    /// Gives `tap` all bytes from now on, in both directions.
    pub fn set_tap(&mut self, tap: impl Tap + 'static) {
        self.tap = Some(Box::new(tap));
    }

    /// A hint for a missing answer. It is known without I/O.
    pub(super) fn hint(&self, reception: Reception, names: Names) -> Text {
        self.line.hint(reception, names)
    }
}

impl fmt::Debug for RawPort {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("RawPort")
            .field("name", &self.name())
            .finish_non_exhaustive()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ports::endless::Endless;

    #[test]
    fn line_that_always_has_bytes_is_interrupted() {
        let mut port = RawPort::new(Box::new(Endless(&[0])));
        port.set_interrupt(|| Err("Ctrl-C".into()));
        let end = port.read(&mut [0; 8], Duration::from_secs(1));
        assert!(matches!(end, Err(Error::Interrupted(_))), "{end:?}");
    }
}
