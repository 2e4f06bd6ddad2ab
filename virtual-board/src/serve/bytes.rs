//! A stream of bytes: the arm's serial port, or the control port.

use std::collections::VecDeque;

use armwire_sim::pty::Pty;

use crate::{Error, Pipe};

/// Number of buffered bytes at which the other side is no longer read.
pub(super) const BACKLOG: usize = 4096;

/// The pty of the port.
pub(super) struct BytePort {
    pty: Pty,
    to_program: VecDeque<u8>,
}

impl BytePort {
    pub(super) fn new(pty: Pty) -> Self {
        let to_program = VecDeque::new();
        Self { pty, to_program }
    }

    pub(super) fn pty(&self) -> &Pty {
        &self.pty
    }

    pub(super) fn take(&mut self, pipe: Pipe<'_>) -> Result<(), Error> {
        if pipe.unsent() < BACKLOG {
            let mut bytes = [0; BACKLOG];
            let count = self.pty.read(&mut bytes).map_err(Error::Serve)?;
            pipe.write(&bytes[..count])?;
        }
        Ok(())
    }

    pub(super) fn give(&mut self, pipe: Pipe<'_>) -> Result<(), Error> {
        self.to_program.extend(pipe.read());
        let count = self
            .pty
            .write(self.to_program.make_contiguous())
            .map_err(Error::Serve)?;
        self.to_program.drain(..count);
        pipe.set_reading(self.to_program.len() < BACKLOG);
        Ok(())
    }
}
