//! A blocking call at a time over a line: the one place with a clock.

use std::io::{self, ErrorKind};
use std::thread;
use std::time::{Duration, Instant};

use armwire::{Client, Config, Event, Input, Micros, Reason, xarm};

use crate::describe::Arm;
use crate::problem::{Heard, Problem};

/// The longest frame of every protocol fits: with a shorter buffer it does not compile.
const BUFFER: usize = xarm::MAX_FRAME;
/// Bytes kept of what was heard instead of an answer.
const KEPT: usize = 256;
/// More bytes than a port keeps for its reader: whoever has read so many reads what is being said now.
const BUFFERED: usize = 65_536;

/// What carries the bytes.
pub(crate) trait Line {
    /// What the user calls it.
    fn name(&self) -> &str;

    /// Reads what has arrived, waiting so long for the first byte; no bytes when none came.
    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Problem>;

    /// Writes some of the bytes, at least one, and returns how many. On a line that carries whole messages the bytes are
    /// one.
    fn write(&mut self, bytes: &[u8]) -> Result<usize, Problem>;

    /// What to ask oneself about this line when nothing comes from the arm, or something that is none of its messages.
    fn doubts(&mut self, came: Came, arm: &str) -> String;
}

/// What came instead of an answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Came {
    Nothing,
    Garbage,
}

impl Line for Box<dyn Line> {
    fn name(&self) -> &str {
        self.as_ref().name()
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Problem> {
        self.as_mut().read(buf, wait)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Problem> {
        self.as_mut().write(bytes)
    }

    fn doubts(&mut self, came: Came, arm: &str) -> String {
        self.as_mut().doubts(came, arm)
    }
}

/// Whether reading or writing failed only because it would have to wait.
pub(crate) fn is_nothing_yet(error: &io::Error) -> bool {
    matches!(
        error.kind(),
        ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted
    )
}

/// An open line with a client on it.
pub(crate) struct Link<P: Arm, L> {
    line: L,
    client: Client<P, BUFFER>,
    start: Instant,
    dropped: usize,
    checksums: usize,
}

impl<P: Arm, L: Line> Link<P, L> {
    pub(crate) fn new(line: L, config: Config) -> Self {
        Self {
            line,
            client: Client::new(config),
            start: Instant::now(),
            dropped: 0,
            checksums: 0,
        }
    }

    /// Makes one call and returns the answer, if the request gets one.
    pub(crate) fn call(&mut self, request: P::Request) -> Result<Option<P::Response>, Problem> {
        // Every call runs to its end, so none is in flight.
        let _ = self.client.submit(request);
        let has_answer = P::reply(&request).is_some();
        let begun = self.now();
        let mut heard = Heard::default();
        let mut buf = [0; 256];
        loop {
            let n = if has_answer {
                // Before it transmits this takes what has arrived, so that no old answer is taken for a new one.
                self.receive(&mut buf)?
            } else {
                // Torque off does not wait for an arm that never stops talking.
                self.transmit()?;
                0
            };
            let bytes = &buf[..n];
            heard.count += n;
            let room = KEPT - heard.bytes.len();
            heard.bytes.extend(bytes.iter().take(room));

            let now = self.now();
            let mut input = Input::Bytes(bytes);
            // To the end, even once the answer is there: what follows it in the same read would be lost.
            let mut outcome = None;
            while let Some(event) = self.client.handle(now, &mut input) {
                match event {
                    Event::Answer(response) => outcome = Some(Ok(Some(response))),
                    Event::Unacceptable(error) => {
                        outcome = Some(Err(Problem::Unacceptable {
                            name: self.line.name().to_owned(),
                            error: error.to_string(),
                        }));
                    }
                    Event::Sent => outcome = Some(Ok(None)),
                    Event::TimedOut { sends } => {
                        heard.sends = sends;
                        heard.millis = now.since(begun).0 / 1_000;
                        outcome = Some(Err(self.no_answer(&request, std::mem::take(&mut heard))));
                    }
                    Event::Late(_) | Event::Unsolicited(_) => heard.frames += 1,
                    Event::Unknown(error) => {
                        heard.unknown.get_or_insert_with(|| error.to_string());
                    }
                    Event::Echo => heard.echoes += 1,
                    Event::Noise(noise) => {
                        self.dropped += noise.len;
                        let checksum = usize::from(matches!(noise.reason, Reason::Checksum { .. }));
                        heard.checksums += checksum;
                        self.checksums += checksum;
                    }
                    Event::Broken(noise) => {
                        let name = self.line.name().to_owned();
                        let broken = Problem::Broken {
                            name,
                            arm: P::NAME,
                            noise,
                        };
                        outcome.get_or_insert(Err(broken));
                    }
                }
            }
            if let Some(outcome) = outcome {
                return outcome;
            }
            if n == 0 || heard.count > BUFFERED {
                self.transmit()?;
            }
        }
    }

    /// What the arm says unasked, waiting so long for the first byte; nothing when none came.
    pub(crate) fn hear(&mut self, wait: Duration) -> Result<Option<Vec<P::Response>>, Problem> {
        let mut buf = [0; 256];
        let n = self.line.read(&mut buf, wait)?;
        let now = self.now();
        let mut input = Input::Bytes(&buf[..n]);
        let mut heard = Vec::new();
        while let Some(event) = self.client.handle(now, &mut input) {
            match event {
                Event::Unsolicited(response) => heard.push(response),
                Event::Noise(noise) => {
                    self.dropped += noise.len;
                    self.checksums += usize::from(matches!(noise.reason, Reason::Checksum { .. }));
                }
                _ => {}
            }
        }
        Ok((n > 0).then_some(heard))
    }

    /// Bytes that belonged to no frame, so far.
    pub(crate) fn dropped(&self) -> usize {
        self.dropped
    }

    /// Frames with a wrong checksum, so far.
    pub(crate) fn checksums(&self) -> usize {
        self.checksums
    }

    /// What the user calls the line.
    pub(crate) fn name(&self) -> &str {
        self.line.name()
    }

    /// Time since the line was opened.
    pub(crate) fn now(&self) -> Micros {
        Micros(self.start.elapsed().as_micros().try_into().unwrap_or(u64::MAX))
    }

    pub(crate) fn sleep_until(&self, instant: Micros) {
        thread::sleep(Duration::from_micros(instant.since(self.now()).0));
    }

    fn transmit(&mut self) -> Result<(), Problem> {
        while let Some(bytes) = self.client.poll_transmit(self.now()) {
            let n = self.line.write(bytes)?;
            let taken = self.client.transmitted(self.now(), n);
            taken.expect("a line takes no more than it is given");
        }
        Ok(())
    }

    /// What has arrived, waiting for it until the client has something to do.
    fn receive(&mut self, buf: &mut [u8]) -> Result<usize, Problem> {
        let due = self.client.poll_timeout().unwrap_or_default();
        let wait = Duration::from_micros(due.since(self.now()).0);
        self.line.read(buf, wait)
    }

    fn no_answer(&mut self, request: &P::Request, heard: Heard) -> Problem {
        let begun = is_begun::<P>(request, &heard.bytes);
        let came = if heard.count == 0 { Came::Nothing } else { Came::Garbage };
        Problem::NoAnswer {
            name: self.line.name().to_owned(),
            arm: P::NAME,
            doubts: self.line.doubts(came, P::NAME),
            heard: Box::new(Heard { begun, ..heard }),
        }
    }
}

/// Whether an answer to the request begins somewhere in the bytes, with the request's header and then otherwise, where
/// its end may have been lost.
fn is_begun<P: Arm>(request: &P::Request, bytes: &[u8]) -> bool {
    let mut out = [0; BUFFER];
    let sent = P::encode_request(request, &mut out).unwrap_or(0);
    let (header, next) = (&out[..P::HEADER], out[P::HEADER]);
    let answered = |window: &[u8]| window.starts_with(header) && window[P::HEADER] != next;
    !P::RELIABLE && sent > P::HEADER && bytes.windows(P::HEADER + 1).any(answered)
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;

    use armwire::Protocol;
    use armwire::ling::{Frame, JointState, Ling, MAX_FRAME, MotionStatus, Request, Response};

    use super::*;

    /// Joints at this position, as an arm tells it.
    fn joints(ticks: u16) -> Vec<u8> {
        let response = Response::Joints(JointState {
            joints: [ticks; 6],
            gripper: 0,
            status: MotionStatus::Idle,
        });
        let mut out = [0; MAX_FRAME];
        let n = Ling::encode_response(&response, &mut out).unwrap();
        out[..n].to_vec()
    }

    /// An arm that gives each request an answer, by how many there were.
    struct Answering {
        answer: fn(u16) -> Vec<u8>,
        said: VecDeque<Vec<u8>>,
        asked: u16,
    }

    impl Answering {
        fn new(answer: fn(u16) -> Vec<u8>) -> Self {
            Self {
                answer,
                said: VecDeque::new(),
                asked: 0,
            }
        }
    }

    impl Line for &mut Answering {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Problem> {
            let said = self.said.pop_front().unwrap_or_default();
            buf[..said.len()].copy_from_slice(&said);
            Ok(said.len())
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Problem> {
            self.asked += 1;
            self.said.push_back((self.answer)(self.asked));
            Ok(bytes.len())
        }

        fn doubts(&mut self, _: Came, _: &str) -> String {
            unreachable!("it answers")
        }
    }

    /// The answer with a gripper stroke that no gripper has.
    fn unknown_stroke(_: u16) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let frame = Frame {
            command: 0x04,
            function: 0x0E,
            data: &[3],
        };
        let n = frame.encode(&mut out).unwrap();
        out[..n].to_vec()
    }

    #[test]
    fn an_unacceptable_answer_ends_the_call_at_once_with_the_reason() {
        let mut arm = Answering::new(unknown_stroke);
        let mut link = Link::<Ling, _>::new(&mut arm, Ling::CONFIG);
        let problem = link.call(Request::ReadStroke).unwrap_err();
        assert_eq!(
            problem.to_string(),
            "fake: the arm's answer cannot be accepted: command 04 function 0E: gripper stroke type is 3, must be 0..=2 \
             (data byte 0)"
        );
        assert_eq!(link.line.asked, 1);
    }

    #[test]
    fn an_answer_that_waits_on_the_line_is_not_taken_for_that_to_the_next_request() {
        let mut arm = Answering::new(joints);
        let mut link = Link::<Ling, _>::new(&mut arm, Ling::CONFIG);
        for _ in 0..3 {
            link.line.said.push_back(joints(4000));
            let Ok(Some(Response::Joints(state))) = link.call(Request::ReadJoints) else {
                panic!("no answer");
            };
            assert_eq!(state.joints, [link.line.asked; 6]);
        }
    }
}
