//! An SLCAN adapter: the adapter's side of [`armwire_bridge::slcan`], without a CAN controller and without I/O.

#[cfg(test)]
mod tests;

use armwire::time::Instant;
use armwire_bridge::slcan::{BitRate, Command, Commands, DataBitRate, MINUTE, Reply, Status};

use crate::can::{Frame, Id};

/// Maximum output for a program that does not read. Further frames are lost, which sets a bit of the [`Status`].
const MAX_OUTPUT: usize = 65_536;
/// Version 1.0 of hardware and software.
const VERSION: Reply = Reply::Version {
    hardware: 0x10,
    software: 0x10,
};
const SERIAL_NUMBER: Reply = Reply::SerialNumber(*b"ARMW");

/// An SLCAN adapter without its CAN controller.
///
/// It follows the channel states of LAWICEL's adapters: a bit rate is required before opening, and frames pass only
/// while the channel is open. Output for the program is in [`output`](Self::output).
#[derive(Clone, Debug, Default)]
pub struct Adapter {
    commands: Commands,
    bit_rate: Option<BitRate>,
    data_bit_rate: DataBitRate,
    channel: Channel,
    time_stamps: bool,
    /// Status bits, cleared when the program reads them.
    status: Status,
    output: Vec<u8>,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
enum Channel {
    #[default]
    Closed,
    Open,
    Listening,
}

impl Adapter {
    /// Creates a closed adapter without a bit rate. Its data phase has 2 Mbit/s.
    pub fn new() -> Self {
        Self::default()
    }

    /// Returns the bit rate of the open or listening channel, in bits per second. `None` while it is closed.
    pub fn bit_rate(&self) -> Option<u32> {
        match self.channel {
            Channel::Closed => None,
            Channel::Open | Channel::Listening => self.bit_rate.map(BitRate::bits_per_second),
        }
    }

    /// Returns the data bit rate of FD frames with bit rate switching, in bits per second.
    pub fn data_bit_rate(&self) -> u32 {
        self.data_bit_rate.bits_per_second()
    }

    /// Returns true if the channel is listen-only: it acknowledges no frames.
    pub fn is_listening(&self) -> bool {
        self.channel == Channel::Listening
    }

    /// Takes the next byte from the program. Passes a frame to `transmit`, which returns whether there is room for it.
    pub fn receive(&mut self, byte: u8, transmit: impl FnOnce(Frame) -> bool) {
        if let Some(command) = self.commands.push(byte) {
            let reply = command.ok().and_then(|command| self.execute(command, transmit));
            reply.unwrap_or(Reply::Refused).encode(&mut self.output);
        }
    }

    /// Executes a command and returns the reply. `None` if the command is not allowed in this state.
    fn execute(&mut self, command: Command, transmit: impl FnOnce(Frame) -> bool) -> Option<Reply> {
        let is_closed = self.channel == Channel::Closed;
        let can_open = is_closed && self.bit_rate.is_some();
        match command {
            Command::Nothing => {}
            Command::BitRate(rate) if is_closed => self.bit_rate = Some(rate),
            Command::DataBitRate(rate) if is_closed => self.data_bit_rate = rate,
            Command::TimeStamps(on) if is_closed => self.time_stamps = on,
            Command::Open if can_open => self.channel = Channel::Open,
            Command::Listen if can_open => self.channel = Channel::Listening,
            Command::Close if !is_closed => self.channel = Channel::Closed,
            Command::Transmit(frame) if self.channel == Channel::Open => {
                if !transmit(frame) {
                    self.report(Status::TRANSMIT_QUEUE_FULL);
                    return None;
                }
                return Some(Reply::Sent {
                    is_extended: matches!(frame.id, Id::Extended(_)),
                });
            }
            Command::Status if !is_closed => return Some(Reply::Status(std::mem::take(&mut self.status))),
            Command::Version => return Some(VERSION),
            Command::SerialNumber => return Some(SERIAL_NUMBER),
            _ => return None,
        }
        Some(Reply::Done)
    }

    /// Takes a frame of another node from the bus at `now`. The program receives it if the channel is open.
    pub fn on_frame(&mut self, frame: &Frame, now: Instant) {
        if self.channel == Channel::Closed {
            return;
        }
        if self.output.len() >= MAX_OUTPUT {
            self.report(Status::RECEIVE_QUEUE_FULL);
            return;
        }
        let millis = (now.as_micros() / 1_000 % u64::from(MINUTE)) as u16;
        let millis = self.time_stamps.then_some(millis);
        Reply::Frame { frame: *frame, millis }.encode(&mut self.output);
    }

    /// Sets status bits until the program reads them.
    pub fn report(&mut self, status: Status) {
        self.status = self.status.and(status);
    }

    /// Returns the bytes for the program. Remove delivered bytes from the front.
    pub fn output(&mut self) -> &mut Vec<u8> {
        &mut self.output
    }
}
