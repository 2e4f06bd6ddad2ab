//! A program at the serial port: the crate's client, in virtual time.

use armwire::ling::{self, Ling};
use armwire::messages::Messages;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output};
use armwire_bridge::Duration;
use armwire_virtual_board::line::Arm;
use armwire_virtual_board::{Error, Nanos, VirtualBoard};

/// Time from the last stop bit of a request until an arm has obeyed it, without an answer.
const OBEYED: Duration = Duration::from_millis(1);

/// A program for a Ling arm.
pub type Program = ProgramOf<Ling, { ling::MAX_FRAME }>;

/// A program for an arm with protocol `P`. Its longest frame has `N` bytes.
#[derive(Debug)]
pub struct ProgramOf<P: Messages, const N: usize> {
    client: Client<P, N>,
    /// Events other than the outcome of calls.
    others: Vec<String>,
    /// The last answer, as a frame, and its expectation.
    answer: (Vec<u8>, P::Expect),
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
            others: Vec::new(),
            answer: (Vec::new(), P::default().unsolicited()),
        }
    }

    /// Makes one call. Returns the answer, or `None` when a request that gets none is with the arm.
    ///
    /// # Panics
    ///
    /// If anything but the answer happens.
    pub fn call<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: P::Request<'_>) -> Option<P::Response<'_>> {
        let is_answered = self.run(board, &request);
        assert!(
            self.others.is_empty(),
            "{:?} while waiting for the answer to {request:?}",
            self.others
        );
        is_answered.then(|| self.answer())
    }

    /// Makes one call as [`call`](Self::call) does, on a line that may be bad.
    ///
    /// # Panics
    ///
    /// If there is no answer.
    pub fn call_on_bad_line<A: Arm>(
        &mut self,
        board: &mut VirtualBoard<A>,
        request: P::Request<'_>,
    ) -> Option<P::Response<'_>> {
        self.run(board, &request).then(|| self.answer())
    }

    /// Makes one call. Returns true if the arm answered; the answer is in `answer`.
    fn run<A: Arm>(&mut self, board: &mut VirtualBoard<A>, request: &P::Request<'_>) -> bool {
        self.client.submit(request).unwrap();
        let mut frame = vec![0; N];
        let len = self.client.messages().encode_request(request, &mut frame).unwrap();
        self.answer.1 = self.client.messages().request(&frame[..len]).unwrap().expect;
        let mut bytes = Vec::new();
        loop {
            let now = board.now().instant();
            let left = self.client.receive(now, &bytes).len();
            bytes.drain(..bytes.len() - left);
            match self.client.poll(now) {
                Output::Transmit(out) => {
                    let n = out.len();
                    board.usb().write(out).unwrap();
                    self.client.transmitted(board.now().instant(), n).unwrap();
                }
                Output::Timeout(until) => bytes.extend(listen(board, until)),
                Output::Event(Event::Answer(response)) => {
                    let n = P::default().encode_response(&response, None, &mut frame).unwrap();
                    frame.truncate(n);
                    self.answer.0 = frame;
                    return true;
                }
                Output::Event(Event::Sent) => {
                    board
                        .run_until(Nanos::from_millis(100), |board| board.usb().unsent() == 0)
                        .unwrap();
                    board.run_for(OBEYED).unwrap();
                    return false;
                }
                Output::Event(event @ (Event::Unacceptable(_) | Event::TimedOut { .. })) => {
                    panic!("{event:?} instead of an answer to {request:?} at {}", board.now());
                }
                Output::Event(other) => self.others.push(format!("{other:?}")),
            }
        }
    }

    fn answer(&self) -> P::Response<'_> {
        let (frame, expect) = &self.answer;
        let response = self.client.messages().parse_response(frame, *expect);
        response.expect("the client has accepted it")
    }
}

/// Runs until bytes arrive from the adapter, or until this time.
fn listen<A: Arm>(board: &mut VirtualBoard<A>, until: Option<Instant>) -> Vec<u8> {
    let until = until.map_or(Instant::ZERO, Instant::from);
    let limit = until.since(board.now().instant());
    match board.run_until(limit, |board| board.usb().unread() > 0) {
        Ok(_) | Err(Error::TimedOut { .. }) => board.usb().read(),
        Err(error) => panic!("{error}"),
    }
}
