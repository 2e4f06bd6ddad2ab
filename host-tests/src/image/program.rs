//! A program at the serial port: the crate's client, in virtual time.

use armwire::ling::{self, Ling};
use armwire::{Client, Config, Event, Input, Micros, Protocol};
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Error, Nanos, VirtualBoard};

/// From the last stop bit of a request until an arm without an answer has obeyed it.
const OBEYED: Micros = Micros::from_millis(1);

/// A program that talks to a Ling arm.
pub type Program = ProgramOf<Ling, { ling::MAX_FRAME }>;

/// A program that talks to an arm by `P`, whose longest frame has `N` bytes.
#[derive(Debug)]
pub struct ProgramOf<P: Protocol, const N: usize> {
    client: Client<P, N>,
    others: Vec<Event<P>>,
}

impl<P: Protocol, const N: usize> Default for ProgramOf<P, N> {
    fn default() -> Self {
        Self::new(Config::DEFAULT)
    }
}

impl<P: Protocol, const N: usize> ProgramOf<P, N> {
    /// A program with a client of its own.
    pub fn new(config: Config) -> Self {
        Self {
            client: Client::new(config),
            others: Vec::new(),
        }
    }

    /// Makes one call. Returns the answer, or `None` when a request that gets none is with the arm.
    ///
    /// # Panics
    ///
    /// If anything but the answer happens.
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: P::Request) -> Option<P::Response> {
        let event = self.try_call(board, request);
        assert_eq!(self.others, [], "while waiting for the answer to {request:?}");
        match event {
            Event::Answer(response) => Some(response),
            Event::Sent => None,
            other => panic!("{other:?} instead of an answer to {request:?} at {}", board.now()),
        }
    }

    /// Makes one call on a line that may be bad, and returns how it ended.
    ///
    /// # Panics
    ///
    /// If the port closes.
    pub fn try_call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: P::Request) -> Event<P> {
        self.client.submit(request).unwrap();
        loop {
            while let Some(bytes) = self.client.poll_transmit(board.now().micros()) {
                let n = bytes.len();
                board.usb().write(bytes).unwrap();
                self.client.transmitted(board.now().micros(), n).unwrap();
            }
            let bytes = self.listen(board);
            let mut input = Input::Bytes(&bytes);
            while let Some(event) = self.client.handle(board.now().micros(), &mut input) {
                match event {
                    Event::Answer(_) | Event::Unacceptable(_) | Event::TimedOut { .. } => return event,
                    Event::Sent => {
                        board
                            .run_until(Nanos::from_millis(100), |board| board.usb().unsent() == 0)
                            .unwrap();
                        board.run_for(OBEYED).unwrap();
                        return event;
                    }
                    other => self.others.push(other),
                }
            }
        }
    }

    /// Runs until there are bytes from the adapter, or the client has waited long enough.
    fn listen<A: Arm>(&self, board: &mut VirtualBoard<A>) -> Vec<u8> {
        let now = board.now().micros();
        let limit = match self.client.poll_timeout() {
            Some(due) => due.since(now),
            None => Micros(0),
        };
        match board.run_until(limit, |board| board.usb().unread() > 0) {
            Ok(_) | Err(Error::TimedOut { .. }) => board.usb().read(),
            Err(error) => panic!("{error}"),
        }
    }
}
