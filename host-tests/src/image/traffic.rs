//! Counts of the traffic on the wires: a test of any length needs constant memory.

use armwire_virtual_board::VirtualBoard;
use armwire_virtual_board::can::{Outcome, Sender};
use armwire_virtual_board::line::{self, Arm, Direction, Fault, LineByte};
use armwire_virtual_board::usb::Direction as UsbDirection;
use armwire_virtual_board::usb::cdc::Port;

/// Counts of the traffic so far.
#[derive(Clone, Copy, Debug, Default)]
pub struct Traffic {
    /// Numbers of the serial port's IN and OUT endpoints.
    input: u8,
    output: u8,
    /// Bytes from the arm.
    pub bytes_from_arm: u32,
    /// Bytes from the arm without a stop bit.
    pub framing_faults: u32,
    /// Bytes from the arm with inconsistent samples in the receiver.
    pub noise_faults: u32,
    /// Bytes from the arm that were low from start to end.
    pub breaks: u32,
    /// Overrun bytes from the arm.
    pub overruns: u32,
    /// Bytes from the arm while the receiver was off.
    pub unreceived: u32,
    /// Bytes from the arm that the firmware took from the DMA.
    pub taken: u32,
    /// Bytes to the arm.
    pub bytes_to_arm: u32,
    /// Packets of the serial port for the host.
    pub packets_to_host: u32,
    /// Packets without data.
    pub empty_packets_to_host: u32,
    /// Packets of the serial port from the host.
    pub packets_from_host: u32,
    /// Successful CAN frames of the board.
    pub frames_of_board: u32,
    /// Successful CAN frames of other nodes.
    pub frames_of_nodes: u32,
    /// Successful CAN frames of a flood.
    pub frames_of_flood: u32,
    /// Failed CAN frames of any node.
    pub broken_frames: u32,
}

impl Traffic {
    /// Discards earlier traffic and starts counting.
    ///
    /// # Panics
    ///
    /// If no device with one serial port was enumerated.
    pub fn begin<A: Arm>(board: &mut VirtualBoard<A>) -> Self {
        let device = board.usb().device().expect("a device").configuration.clone();
        let [port] = Port::find(&device)[..] else {
            panic!("not one serial port: {device:?}");
        };
        board.uart().forget_bytes();
        board.usb().forget_packets();
        board.can().forget_frames();
        Self {
            input: port.input.number,
            output: port.output.number,
            ..Self::default()
        }
    }

    /// Counts the traffic since the last call.
    pub fn count<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let (from, to): (Vec<LineByte>, _) = board
            .uart()
            .bytes()
            .into_iter()
            .partition(|byte| byte.direction == Direction::ToBoard);
        self.bytes_from_arm += from.len() as u32;
        self.bytes_to_arm += to.len() as u32;
        let count = |outcome| from.iter().filter(|byte| byte.outcome == outcome).count() as u32;
        let faults = |fault| count(line::Outcome::Faulty(fault));
        self.framing_faults += faults(Fault::Framing);
        self.noise_faults += faults(Fault::Noise);
        self.breaks += faults(Fault::Break);
        self.overruns += faults(Fault::Overrun);
        self.unreceived += count(line::Outcome::Lost);
        self.taken += board.uart().taken();
        board.uart().forget_bytes();

        for packet in board.usb().packets() {
            match packet.direction {
                UsbDirection::In if packet.endpoint == self.input => {
                    self.packets_to_host += 1;
                    self.empty_packets_to_host += u32::from(packet.data.is_empty());
                }
                UsbDirection::Out if packet.endpoint == self.output => self.packets_from_host += 1,
                _ => {}
            }
        }
        board.usb().forget_packets();

        for frame in board.can().frames() {
            let count = match (frame.outcome, frame.sender) {
                (Outcome::Sent, Sender::Board) => &mut self.frames_of_board,
                (Outcome::Sent, Sender::Node(_)) => &mut self.frames_of_nodes,
                (Outcome::Sent, Sender::Flood) => &mut self.frames_of_flood,
                _ => &mut self.broken_frames,
            };
            *count += 1;
        }
        board.can().forget_frames();
    }
}
