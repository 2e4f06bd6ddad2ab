//! A host and a device on one line, in virtual time.

use std::fmt;

use armwire::framing::Reason;
use armwire::messages::Messages;
use armwire::time::Duration;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output, ParseError};

use crate::serial::SerialDevice;

/// The device did not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct NoAnswer {
    /// Number of times the request was sent.
    pub sends: u8,
}

impl fmt::Display for NoAnswer {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sends {
            1 => f.write_str("no answer, sent once"),
            sends => write!(f, "no answer, sent {sends} times"),
        }
    }
}

impl std::error::Error for NoAnswer {}

/// An event of a client other than the result of a call.
#[derive(Clone, Debug, PartialEq)]
pub enum LineEvent {
    /// The frame of an answer that arrived after its timeout.
    Late(Vec<u8>),
    /// The frame of an unsolicited response.
    Unsolicited(Vec<u8>),
    /// The echo of a request.
    Echo,
    /// A valid frame that is not a known message.
    Unknown {
        /// The frame.
        frame: Vec<u8>,
        /// The parse error.
        error: ParseError,
    },
    /// Bytes that are not part of a frame.
    Noise {
        /// Offset of the first byte in the received stream.
        offset: u64,
        /// The bytes.
        bytes: Vec<u8>,
        /// Reason for the noise.
        reason: Reason,
    },
    /// A framing error in a lossless stream.
    Broken {
        /// Offset in the received stream.
        offset: u64,
        /// Reason for the error.
        reason: Reason,
    },
}

/// A [`Client`] with buffers of `N` bytes, connected to a device by a full-duplex line.
///
/// A byte takes ten bit times each way, rounded up to a microsecond. The clock advances from event to event.
///
/// ```
/// use armwire::ling::{Ling, MAX_FRAME, Request, Response, Stroke};
/// use armwire::Config;
/// use armwire::time::Instant;
/// use armwire_sim::ling::LingArm;
/// use armwire_sim::wire::Wire;
///
/// let arm = LingArm::new(armwire_sim::ling::Config::follower());
/// let mut wire = Wire::<Ling, _, MAX_FRAME>::new(Config::default(), arm);
/// assert_eq!(wire.call(Request::ReadStroke), Ok(Some(Response::Stroke(Stroke::Mm50))));
/// assert_eq!(wire.elapsed(), Instant::from_micros(7 * 10 + 200 + 7 * 10));
/// ```
#[derive(Debug)]
pub struct Wire<M: Messages, D, const N: usize> {
    client: Client<M, N>,
    device: D,
    now: Instant,
    byte_time: Duration,
    /// Byte in transit to the device, with its arrival time.
    to_device: Option<(Instant, u8)>,
    /// Byte in transit to the host, with its arrival time.
    to_host: Option<(Instant, u8)>,
    events: Vec<LineEvent>,
    /// Frame of the last answer, with its expectation.
    answer: (Vec<u8>, M::Expect),
}

/// Result of a call.
enum Outcome {
    Answered,
    Sent,
    TimedOut(NoAnswer),
}

impl<M: Messages + Default, D: SerialDevice, const N: usize> Wire<M, D, N> {
    /// Creates an idle line at time zero, at the configured baud rate. Without one a byte takes 1 µs.
    pub fn new(config: Config, device: D) -> Self {
        Self {
            client: Client::new(M::default(), config),
            device,
            now: Instant::ZERO,
            byte_time: Duration::from_micros(config.baud.map_or(1, |baud| 10_000_000_u64.div_ceil(baud.get().into()))),
            to_device: None,
            to_host: None,
            events: Vec::new(),
            answer: (Vec::new(), M::default().unsolicited()),
        }
    }

    /// Sends a request and returns its answer after the last stop bit. A request without an answer is complete when the
    /// device has received all of it.
    ///
    /// # Errors
    ///
    /// [`NoAnswer`] after the last timeout.
    ///
    /// # Panics
    ///
    /// If the client cannot accept the device's answer, or has no room for the request.
    pub fn call(&mut self, request: M::Request<'_>) -> Result<Option<M::Response<'_>>, NoAnswer> {
        // The previous call is complete.
        self.client
            .submit(&request)
            .expect("no request is in flight, and it has room");
        let mut bytes = [0; N];
        let n = self
            .client
            .messages()
            .encode_request(&request, &mut bytes)
            .expect("it has room");
        let info = self.client.messages().request(&bytes[..n]).expect("it is a request");
        self.answer.1 = info.expect;
        let mut outcome = None;
        loop {
            outcome = self.step(Instant::from_micros(u64::MAX)).or(outcome);
            if self.to_device.is_some() {
                continue;
            }
            match outcome {
                Some(Outcome::Answered) => break,
                Some(Outcome::Sent) => return Ok(None),
                Some(Outcome::TimedOut(silence)) => return Err(silence),
                None => {}
            }
        }
        let (frame, expect) = &self.answer;
        let response = self.client.messages().parse_response(frame, *expect);
        Ok(Some(response.expect("the client has accepted it")))
    }

    /// Advances virtual time without a call.
    pub fn wait(&mut self, span: Duration) {
        let end = self.now + span;
        loop {
            // A step at the end itself informs the device of the time.
            let last = self.now == end;
            self.step(end);
            if last {
                return;
            }
        }
    }

    /// Returns the virtual time since the start.
    pub fn elapsed(&self) -> Instant {
        self.now
    }

    /// Returns the client's other events since the last call of this function: noise, late answers, echoes.
    pub fn take_events(&mut self) -> Vec<LineEvent> {
        std::mem::take(&mut self.events)
    }

    /// Returns the device.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// Returns the device.
    pub fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Advances to the next event, or to `end`. Returns the result of a call, if one is complete.
    fn step(&mut self, end: Instant) -> Option<Outcome> {
        let (mut outcome, client_due) = self.poll(None);
        // A device is not polled while its line is busy: its output waits.
        if self.to_host.is_none() {
            let byte = self.device.transmit(self.now);
            self.to_host = byte.map(|byte| (self.now + self.byte_time, byte));
        }
        let device_due = match self.to_host {
            Some((due, _)) => Some(due),
            None => self.device.poll_timeout(),
        };
        let host_due = self.to_device.map(|(due, _)| due);
        // An event that is due already waits for the line.
        let client_due = client_due.filter(|due| *due > self.now);
        let due = [host_due, device_due, client_due];
        if outcome.is_none() {
            self.now = due.into_iter().flatten().fold(end, Instant::min).max(self.now);
        }
        if let Some((_, byte)) = self.to_device.take_if(|(due, _)| *due <= self.now) {
            self.device.receive(self.now, byte);
        }
        let byte = self.to_host.take_if(|(due, _)| *due <= self.now).map(|(_, byte)| byte);
        outcome = self.poll(byte).0.or(outcome);
        outcome
    }

    /// Passes a received byte to the client, transmits a byte if the line is free, and takes the client's events.
    fn poll(&mut self, received: Option<u8>) -> (Option<Outcome>, Option<Instant>) {
        let now = self.now;
        let rest = self.client.receive(now, received.as_slice());
        assert!(rest.is_empty(), "the client has room");
        let mut outcome = None;
        loop {
            let event = match self.client.poll(now) {
                Output::Timeout(until) => return (outcome, until),
                Output::Receive => {
                    self.client
                        .received(now, 0)
                        .expect("each byte was passed in when it arrived");
                    continue;
                }
                Output::Transmit(_) if self.to_device.is_some() => return (outcome, None),
                Output::Transmit(bytes) => {
                    self.to_device = bytes.first().map(|byte| (self.now + self.byte_time, *byte));
                    self.client.transmitted(now, 1).expect("there was a byte");
                    continue;
                }
                Output::Event(event) => event,
            };
            let mut frame = vec![0; N];
            let mut encode = |response| {
                let n = M::default().encode_response(&response, None, &mut frame);
                frame.truncate(n.expect("it came in so many bytes"));
                std::mem::take(&mut frame)
            };
            self.events.push(match event {
                Event::Answer(response) => {
                    self.answer.0 = encode(response);
                    outcome = Some(Outcome::Answered);
                    continue;
                }
                Event::Sent => {
                    outcome = Some(Outcome::Sent);
                    continue;
                }
                Event::TimedOut { sends } => {
                    outcome = Some(Outcome::TimedOut(NoAnswer { sends }));
                    continue;
                }
                Event::Unacceptable(error) => panic!("the answer cannot be accepted: {error}"),
                Event::ErrorFrame { frame } => panic!("the answer is the error frame {frame:02X?}"),
                Event::Late(response) => LineEvent::Late(encode(response)),
                Event::Unsolicited(response) => LineEvent::Unsolicited(encode(response)),
                Event::Echo => LineEvent::Echo,
                Event::Unknown { frame, error } => LineEvent::Unknown {
                    frame: frame.to_vec(),
                    error,
                },
                Event::Noise { offset, bytes, reason } => LineEvent::Noise {
                    offset,
                    bytes: bytes.to_vec(),
                    reason,
                },
                Event::Broken { offset, reason } => LineEvent::Broken { offset, reason },
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use std::num::NonZeroU32;

    use armwire::ling::{Ling, MAX_FRAME, Request, Response};

    use super::*;
    use crate::faults::{Line, Rates};
    use crate::ling::{self, LingArm};

    fn wire<D: SerialDevice>(baud: u32, device: D) -> Wire<Ling, D, MAX_FRAME> {
        let config = Config {
            baud: NonZeroU32::new(baud),
            ..Config::default()
        };
        Wire::new(config, device)
    }

    #[test]
    fn call_takes_line_time_plus_turnaround() {
        for (baud, byte_time) in [(1_000_000, 10), (115_200, 87), (2_000_000, 5)] {
            let mut wire = wire(baud, LingArm::new(ling::Config::follower()));
            wire.call(Request::ReadJoints).unwrap();
            assert_eq!(wire.elapsed(), Instant::from_micros((7 + 21) * byte_time + 200));
        }
    }

    #[test]
    fn deaf_device_is_reported_as_silent() {
        let deaf = Rates {
            drop: 1_000_000,
            ..Rates::NONE
        };
        let mut wire = wire(
            1_000_000,
            Line::new(LingArm::new(ling::Config::follower()), deaf, Rates::NONE, 1),
        );
        assert_eq!(wire.call(Request::ReadJoints), Err(NoAnswer { sends: 3 }));
        assert_eq!(wire.call(Request::SetZero), Ok(None));
    }

    #[test]
    fn damaged_answers_are_retried_and_show_as_events() {
        let rates = Rates {
            corrupt: 5_000,
            ..Rates::NONE
        };
        let mut wire = wire(
            1_000_000,
            Line::new(LingArm::new(ling::Config::follower()), Rates::NONE, rates, 2),
        );
        for _ in 0..100 {
            assert!(matches!(wire.call(Request::ReadJoints), Ok(Some(Response::Joints(_)))));
        }
        assert!(wire.device().injected_from_device().corrupted > 5);
        let events = wire.take_events();
        assert!(events.iter().any(|event| matches!(event, LineEvent::Noise { .. })));
        assert_eq!(wire.take_events(), []);
    }
}
