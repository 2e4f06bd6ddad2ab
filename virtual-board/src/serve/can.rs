//! The CAN bus, behind an SLCAN adapter.

use armwire_sim::pty::Pty;
use armwire_sim::slcan::{Adapter, Status};

use super::BACKLOG;
use crate::board::{Error, VirtualBoard};
use crate::can::Outcome;
use crate::line::Arm;

/// How many frames wait for the bus before the adapter refuses the next: an eighth of a second at 1 Mbit/s.
const QUEUE: usize = 1024;

/// The pty that stands in for the adapter's serial port.
pub(super) struct CanPort {
    pty: Pty,
    adapter: Adapter,
    /// The bit rate at which the adapter is on the bus.
    attached: Option<u32>,
}

impl CanPort {
    pub(super) fn new(pty: Pty) -> Self {
        Self {
            pty,
            adapter: Adapter::new(),
            attached: None,
        }
    }

    pub(super) fn pty(&self) -> &Pty {
        &self.pty
    }

    pub(super) fn take<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        if self.adapter.output().len() >= BACKLOG {
            return Ok(());
        }
        let mut bytes = [0; BACKLOG];
        let count = self.pty.read(&mut bytes).map_err(Error::Serve)?;
        for &byte in &bytes[..count] {
            let bus = board.can();
            // An FD frame is refused too: this bus carries none.
            self.adapter
                .receive(byte, |frame| bus.unsent() < QUEUE && bus.send(&frame).is_ok());
            self.attach(board);
        }
        self.attach(board);
        Ok(())
    }

    /// Takes part in the bus as far as the program wants it. What it has sent goes out before the adapter leaves.
    fn attach<A: Arm>(&mut self, board: &VirtualBoard<A>) {
        let wanted = self.adapter.bit_rate();
        let is_leaving = wanted.is_none() && board.can().unsent() > 0;
        if wanted == self.attached || is_leaving {
            return;
        }
        match wanted {
            Some(rate) => board.can().attach(rate),
            None => board.can().detach(),
        }
        board.can().set_acknowledging(!self.adapter.is_listening());
        self.attached = wanted;
    }

    pub(super) fn give<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        let now = board.now().micros();
        for frame in board.can().read() {
            self.adapter.hear(&frame, now);
        }
        let is_wrong = |outcome| outcome != Outcome::Sent;
        if self.attached.is_some() && board.can().frames().iter().any(|frame| is_wrong(frame.outcome)) {
            self.adapter.report(Status::BUS_ERROR);
        }
        let output = self.adapter.output();
        let count = self.pty.write(output).map_err(Error::Serve)?;
        output.drain(..count);
        Ok(())
    }
}
