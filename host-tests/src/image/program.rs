//! A program at the serial port: the crate's client, in virtual time.

use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output};
use armwire_bridge::Duration;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Error, Nanos, VirtualBoard};

/// Time from the last stop bit of a request without an answer until the arm has executed it.
const EXECUTION_TIME: Duration = Duration::from_millis(1);

/// A program for a Ling arm.
pub type Program = ProgramOf<Ling, { ling::MAX_FRAME }>;

/// A program for an arm with protocol `P`. Its longest frame has `N` bytes.
#[derive(Debug)]
pub struct ProgramOf<P: Messages, const N: usize> {
    client: Client<P, N>,
    /// True for a line with noise: client events other than the outcome of a call are ignored.
    pub is_line_noisy: bool,
    /// The frame of the last answer.
    answer: Vec<u8>,
}

impl<P: Messages + Default, const N: usize> Default for ProgramOf<P, N> {
    fn default() -> Self {
        Self::new(Config::DEFAULT)
    }
}

impl<P: Messages + Default, const N: usize> ProgramOf<P, N> {
    /// A program with a client of its own.
    pub fn new(config: Config) -> Self {
        Self {
            client: Client::new(P::default(), config),
            is_line_noisy: false,
            answer: Vec::new(),
        }
    }

    /// Makes one call. Returns the answer, or `None` when the arm has a request without an answer.
    ///
    /// # Panics
    ///
    /// If there is no answer, or for any other event on a line without noise.
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: P::Request<'_>) -> Option<P::Response<'_>> {
        self.client.submit(&request).unwrap();
        let mut frame = vec![0; N];
        let len = self.client.messages().encode_request(&request, &mut frame).unwrap();
        let expect = self.client.messages().request(&frame[..len]).unwrap().expect;
        let mut bytes = Vec::new();
        loop {
            let now = board.now().instant();
            let left = self.client.receive(now, &bytes).len();
            bytes.drain(..bytes.len() - left);
            match self.client.poll(now) {
                Output::Receive => bytes.extend(board.usb().read()),
                Output::Transmit(out) => {
                    let n = out.len();
                    board.usb().write(out).unwrap();
                    self.client.transmitted(board.now().instant(), n).unwrap();
                }
                Output::Timeout(until) => bytes.extend(receive(board, until)),
                Output::Event(Event::Answer(response)) => {
                    let n = P::default().encode_response(&response, None, &mut frame).unwrap();
                    frame.truncate(n);
                    break;
                }
                Output::Event(Event::Sent) => {
                    board
                        .run_until(Nanos::from_millis(100), |board| board.usb().unsent() == 0)
                        .unwrap();
                    board.run_for(EXECUTION_TIME).unwrap();
                    return None;
                }
                Output::Event(event @ (Event::Unacceptable(_) | Event::ErrorFrame { .. } | Event::TimedOut { .. })) => {
                    panic!("{event:?} instead of an answer to {request:?} at {}", board.now());
                }
                Output::Event(other) => assert!(
                    self.is_line_noisy,
                    "{other:?} while waiting for the answer to {request:?}"
                ),
            }
        }
        self.answer = frame;
        let response = self.client.messages().parse_response(&self.answer, expect);
        Some(response.expect("the client has accepted it"))
    }
}

/// Runs until bytes arrive from the adapter, or until this time.
fn receive<A: Arm>(board: &mut VirtualBoard<A>, until: Option<Instant>) -> Vec<u8> {
    let until = until.map_or(Instant::ZERO, Instant::from);
    let limit = until.since(board.now().instant());
    match board.run_until(limit, |board| board.usb().unread() > 0) {
        Ok(_) | Err(Error::TimedOut { .. }) => board.usb().read(),
        Err(error) => panic!("{error}"),
    }
}
