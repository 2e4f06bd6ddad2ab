//! An SLCAN adapter on the CAN bus, as a separate FD node.

use armwire_bridge::slcan::Status;
use armwire_sim::pty::Pty;
use armwire_sim::slcan::Adapter;

use super::bytes::BACKLOG;
use crate::board::Can;
use crate::can::{ErrorState, NodeConfig, Outcome};
use crate::error::Error;
use crate::time::Nanos;

/// Number of pending frames at which the adapter refuses the next: an eighth of a second at 1 Mbit/s.
const QUEUE: usize = 1024;

/// Maximum time that a closing channel waits for its pending frames. A bus may let none through.
const LEAVE: Nanos = Nanos::from_millis(200);

/// The pty of the adapter's serial port.
pub(super) struct CanPort {
    pty: Pty,
    adapter: Adapter,
    node: u8,
    /// The adapter's node configuration on the bus.
    joined: Option<NodeConfig>,
    /// The time of the channel's close, while frames are pending.
    leaving: Option<Nanos>,
}

impl CanPort {
    /// An adapter that is `node` on the bus.
    pub(super) fn new(pty: Pty, node: u8) -> Self {
        Self {
            pty,
            adapter: Adapter::new(),
            node,
            joined: None,
            leaving: None,
        }
    }

    pub(super) fn pty(&self) -> &Pty {
        &self.pty
    }

    /// Passes the program's input on to the bus.
    pub(super) fn take(&mut self, can: &Can<'_>, now: Nanos) -> Result<(), Error> {
        if self.adapter.output().len() < BACKLOG {
            let mut bytes = [0; BACKLOG];
            let count = self.pty.read(&mut bytes).map_err(Error::Serve)?;
            for &byte in &bytes[..count] {
                let node = self.node;
                self.adapter.receive(byte, |frame| {
                    can.unsent_by(node) < QUEUE && can.send_on_the_wire(node, &frame).is_ok()
                });
                self.join(can, now);
            }
        }
        self.join(can, now);
        Ok(())
    }

    /// Joins or leaves the bus as the program requests. Pending frames go out before the adapter leaves.
    fn join(&mut self, can: &Can<'_>, now: Nanos) {
        let config = |rate| NodeConfig::fd(rate, self.adapter.data_bit_rate());
        let wanted = match (self.adapter.bit_rate().map(config), self.adapter.is_listening()) {
            (Some(config), true) => Some(config.silent()),
            (wanted, _) => wanted,
        };
        if wanted == self.joined {
            self.leaving = None;
            return;
        }
        let waits = wanted.is_none() && can.unsent_by(self.node) > 0;
        if waits && now.since(*self.leaving.get_or_insert(now)) < LEAVE {
            return;
        }
        self.leaving = None;
        self.joined = wanted;
        match wanted {
            Some(config) => can.join(self.node, config),
            None => can.leave(self.node),
        }
    }

    /// Passes received frames and errors on to the program.
    pub(super) fn give(&mut self, can: &Can<'_>, now: Nanos) -> Result<(), Error> {
        for frame in can.read_by(self.node) {
            self.adapter.on_frame(&frame, now.instant());
        }
        let is_wrong = |outcome| outcome != Outcome::Sent;
        if self.joined.is_some() && can.frames().iter().any(|frame| is_wrong(frame.outcome)) {
            self.adapter.report(Status::BUS_ERROR);
        }
        let state = can.errors(self.node).map(|(.., state)| state);
        if let Some(ErrorState::Passive | ErrorState::BusOff) = state {
            self.adapter.report(Status::ERROR_PASSIVE);
        }
        let output = self.adapter.output();
        let count = self.pty.write(output).map_err(Error::Serve)?;
        output.drain(..count);
        Ok(())
    }
}
