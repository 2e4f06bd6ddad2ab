//! The arm's serial port.

use std::collections::VecDeque;

use armwire_sim::pty::Pty;

use super::BACKLOG;
use crate::board::{Error, VirtualBoard};
use crate::line::Arm;
use crate::usb::cdc::LineCoding;

/// The pty that stands in for it.
pub(super) struct SerialPort {
    pty: Pty,
    /// The rate that the firmware was told of.
    baud: u32,
    to_program: VecDeque<u8>,
}

impl SerialPort {
    /// Opens the board's port at the pty's baud rate.
    pub(super) fn open<A: Arm>(pty: Pty, board: &mut VirtualBoard<A>) -> Result<Self, Error> {
        let baud = pty.baud().map_err(Error::Serve)?;
        board.usb().open(0, LineCoding::new(baud))?;
        let to_program = VecDeque::new();
        Ok(Self { pty, baud, to_program })
    }

    pub(super) fn pty(&self) -> &Pty {
        &self.pty
    }

    pub(super) fn take<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        let wanted = self.pty.baud().map_err(Error::Serve)?;
        if !board.usb().is_open() || wanted != self.baud {
            // A firmware that started over is a new device.
            board.usb().open(0, LineCoding::new(wanted))?;
            self.baud = wanted;
        }
        if board.usb().unsent() < BACKLOG {
            let mut bytes = [0; BACKLOG];
            let count = self.pty.read(&mut bytes).map_err(Error::Serve)?;
            board.usb().write(&bytes[..count])?;
        }
        Ok(())
    }

    pub(super) fn give<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Result<(), Error> {
        self.to_program.extend(board.usb().read());
        let count = self
            .pty
            .write(self.to_program.make_contiguous())
            .map_err(Error::Serve)?;
        self.to_program.drain(..count);
        board.usb().set_reading(self.to_program.len() < BACKLOG);
        Ok(())
    }
}
