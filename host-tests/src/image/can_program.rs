//! A program on the CAN bus, in virtual time.

use armwire_bridge::can::{Function, Node};
use armwire_bridge::control::MAX_FRAME;
use armwire_bridge::isotp::{Config, Endpoint, Event, Link};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Nanos, VirtualBoard};

/// Duration between two polls of the bus: about a frame.
const POLL_PERIOD: Nanos = Nanos(100_000);

/// A program that exchanges arm frames with an adapter by ISO-TP. The bus must have another node.
#[derive(Debug)]
pub struct CanProgram {
    pub(super) endpoint: Endpoint<MAX_FRAME, MAX_FRAME>,
}

impl Default for CanProgram {
    fn default() -> Self {
        Self::new(Link::Classic)
    }
}

impl CanProgram {
    /// A program that uses frames of this kind.
    pub fn new(link: Link) -> Self {
        let tx = Function::ArmRequest.id(Node::default());
        Self {
            endpoint: Endpoint::new(Config::new(link, tx)),
        }
    }

    /// Sends a frame to the arm.
    ///
    /// # Panics
    ///
    /// If the frame before is not sent completely.
    pub fn send(&mut self, frame: &[u8]) {
        self.endpoint.send(frame).unwrap();
    }

    /// Handles the bus. Returns an answer if there is one.
    ///
    /// # Panics
    ///
    /// If a transfer fails.
    pub fn poll<A: Arm>(&mut self, board: &mut VirtualBoard<A>) -> Option<Vec<u8>> {
        let now = board.now().instant();
        for frame in board.can().read() {
            if frame.id() != Function::ArmAnswer.id(Node::default()) {
                continue;
            }
            for event in self.endpoint.receive(frame.data(), now) {
                assert_eq!(event, Event::Received);
            }
        }
        assert_eq!(self.endpoint.tick(now).next(), None);
        self.transmit(board);
        let answer = self.endpoint.received().map(<[u8]>::to_vec);
        self.endpoint.release();
        answer
    }

    /// Sends the frames that are due.
    pub(super) fn transmit<A: Arm>(&mut self, board: &mut VirtualBoard<A>) {
        let now = board.now().instant();
        while self.endpoint.transmit_at().is_some_and(|at| at <= now)
            && let Some(frame) = self.endpoint.transmit(now)
        {
            board.can().send(&frame).unwrap();
            self.endpoint.transmitted(now);
        }
    }

    /// Sends a frame to the arm and returns the answer.
    ///
    /// # Panics
    ///
    /// If there is no answer within 100 ms, or as [`poll`](Self::poll).
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, frame: &[u8]) -> Vec<u8> {
        self.send(frame);
        let limit = board.now() + Nanos::from_millis(100);
        while board.now() < limit {
            if let Some(answer) = self.poll(board) {
                return answer;
            }
            board.run_for(POLL_PERIOD).unwrap();
        }
        panic!("no answer to {frame:02X?} by {}", board.now());
    }
}
