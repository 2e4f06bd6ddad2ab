//! A CAN adapter on a serial port with the SLCAN protocol.

use std::collections::VecDeque;
use std::thread;
use std::time::{Duration, Instant};

use armwire_bridge::can::Frame;
use armwire_bridge::slcan::{BitRate, Command, Malformed, Replies, Reply, Status};

use super::bus::Bus;
use crate::error::Error;
use crate::ports::line::Line;
use crate::ports::serial::Serial;
use crate::time::stopwatch::after;

/// Timeout of a reply. Some firmware replies to queries only.
const REPLY_TIMEOUT: Duration = Duration::from_millis(500);
/// Timeout of a command's acknowledgement. Some adapters send none.
const ACKNOWLEDGE_TIMEOUT: Duration = Duration::from_millis(100);
/// Time for the last frames to reach the bus, at the lowest bit rate.
const FLUSH_TIME: Duration = Duration::from_millis(50);

/// An adapter with its channel open.
pub(super) struct SlcanBus {
    serial: Serial,
    bit_rate: BitRate,
    /// Time of the last frame's transmission.
    sent: Option<Instant>,
    replies: Replies,
    /// Replies that were not taken yet.
    received: VecDeque<Result<Reply, Malformed>>,
}

impl SlcanBus {
    /// Resets the adapter from any state of an earlier program.
    pub(super) fn open(serial: Serial, bit_rate: BitRate) -> Result<Self, Error> {
        let baud = serial.baud();
        let mut bus = Self {
            serial,
            bit_rate,
            sent: None,
            replies: Replies::default(),
            received: VecDeque::new(),
        };
        for command in [Command::Nothing, Command::Nothing, Command::Close, Command::Version] {
            bus.send_command(command)?;
        }
        if !bus.settle()? {
            let reason = format!("no answer to SLCAN: is it a CAN adapter with this protocol, and at {baud} baud?");
            return Err(Error::at(bus.serial.name(), reason));
        }
        for (command, what) in [
            (
                Command::BitRate(bit_rate),
                format!("refuses {} bit/s: is it an SLCAN adapter?", bit_rate.bits_per_second()),
            ),
            (Command::Open, "does not open its channel".to_owned()),
        ] {
            bus.send_command(command)?;
            if bus.next_reply(ACKNOWLEDGE_TIMEOUT)? == Some(Ok(Reply::Refused)) {
                return Err(bus.refused(what));
            }
        }
        Ok(bus)
    }

    /// Reads an adapter's version, and any bytes before it. Returns true if an adapter replied.
    fn settle(&mut self) -> Result<bool, Error> {
        let until = Instant::now() + REPLY_TIMEOUT;
        let mut is_there = false;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let Some(reply) = self.next_reply(left)? else { break };
            // Some firmware has a format of its own, and firmware without the command sends an error.
            let is_version = matches!(reply, Ok(Reply::Version { .. }) | Err(Malformed { command: b'V', .. }));
            is_there |= is_version || reply.is_ok();
            if is_version || left.is_zero() {
                break;
            }
        }
        self.received.clear();
        Ok(is_there)
    }

    /// Writes one command in one piece: some firmware accepts no other.
    fn send_command(&mut self, command: Command) -> Result<(), Error> {
        let mut line = Vec::new();
        command.encode(&mut line);
        self.serial.write_all(&line)
    }

    /// The next reply, within this time.
    fn next_reply(&mut self, wait: Duration) -> Result<Option<Result<Reply, Malformed>>, Error> {
        let until = after(wait);
        let mut buf = [0; 1024];
        let mut is_over = false;
        loop {
            if let Some(reply) = self.received.pop_front() {
                return Ok(Some(reply));
            }
            // Bytes that are no reply do not extend the wait.
            if is_over {
                return Ok(None);
            }
            let left = until.saturating_duration_since(Instant::now());
            is_over = left.is_zero();
            let n = self.serial.read(&mut buf, left)?;
            self.received
                .extend(buf[..n].iter().filter_map(|&byte| self.replies.push(byte)));
        }
    }

    fn status(&mut self) -> Result<Option<Status>, Error> {
        let until = Instant::now() + ACKNOWLEDGE_TIMEOUT;
        let mut others = VecDeque::new();
        let mut status = None;
        self.send_command(Command::Status)?;
        while status.is_none() && Instant::now() < until {
            match self.next_reply(until.saturating_duration_since(Instant::now()))? {
                Some(Ok(Reply::Status(received))) => status = Some(received),
                // The adapter does not know the query.
                Some(Ok(Reply::Refused)) => break,
                Some(other) => others.push_back(other),
                None => {}
            }
        }
        others.append(&mut self.received);
        self.received = others;
        Ok(status)
    }

    fn refused(&self, what: String) -> Error {
        Error::at(self.serial.name(), format_args!("the CAN adapter {what}"))
    }
}

impl Bus for SlcanBus {
    fn send(&mut self, frame: &Frame) -> Result<(), Error> {
        self.sent = Some(Instant::now());
        self.send_command(Command::Transmit((*frame).into()))
    }

    fn receive(&mut self, wait: Duration) -> Result<Option<Frame>, Error> {
        let until = after(wait);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            match self.next_reply(left)? {
                // Frames with 29-bit identifiers and remote frames belong to other nodes.
                Some(Ok(Reply::Frame { frame, .. })) => {
                    if let Some(frame) = frame.to_adapter() {
                        return Ok(Some(frame));
                    }
                }
                // Only a frame of this program can have been refused.
                Some(Ok(Reply::Refused)) => {
                    let error_state = self.error_state().unwrap_or_else(|| "no reason reported".to_owned());
                    let hint = self.hint();
                    return Err(self.refused(format!("refuses a frame ({error_state}): {hint}, and another node?")));
                }
                Some(_) => {}
                None => return Ok(None),
            }
        }
    }

    fn error_state(&mut self) -> Option<String> {
        // A failed read gives no hint.
        let status = self.status().ok().flatten()?;
        (status != Status::default()).then(|| status.to_string())
    }

    fn hint(&self) -> String {
        format!("does the bus have {} bit/s", self.bit_rate.bits_per_second())
    }
}

impl Drop for SlcanBus {
    fn drop(&mut self) {
        // A closing channel may drop its unsent frames.
        if let Some(sent) = self.sent {
            thread::sleep(FLUSH_TIME.saturating_sub(sent.elapsed()));
        }
        // An open channel would fill the port without a reader.
        let _ = self.send_command(Command::Close);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, Ordering};

    use armwire_sim::pty::Pty;

    use super::*;

    /// Replies of an adapter that does not know the status query, until it is told to stop.
    fn serve(pty: &Pty, is_stopped: &AtomicBool) {
        let mut line = Vec::new();
        while !is_stopped.load(Ordering::Relaxed) {
            pty.wait(Some(Duration::from_millis(10))).unwrap();
            let mut bytes = [0; 64];
            let n = pty.read(&mut bytes).unwrap();
            for &byte in &bytes[..n] {
                line.push(byte);
                if byte == b'\r' {
                    let reply: &[u8] = match line[0] {
                        b'V' => b"V1013\r",
                        b'F' => b"\x07",
                        _ => b"\r",
                    };
                    pty.write(reply).unwrap();
                    line.clear();
                }
            }
        }
    }

    #[test]
    fn refused_status_query_refuses_no_frame() {
        let (pty, is_stopped) = (Pty::open(None).unwrap(), AtomicBool::new(false));
        thread::scope(|scope| {
            scope.spawn(|| serve(&pty, &is_stopped));
            let serial = Serial::open(pty.path().to_str().unwrap(), 115_200).unwrap();
            let mut bus = SlcanBus::open(serial, BitRate::new(1_000_000).unwrap()).unwrap();
            assert_eq!(bus.error_state(), None);
            let received = bus
                .receive(Duration::from_millis(10))
                .map_err(|error| error.to_string());
            assert_eq!(received, Ok(None));
            is_stopped.store(true, Ordering::Relaxed);
        });
    }
}
