//! A host and a device on one line, in virtual time: a whole conversation in no time at all.

use std::fmt;

use armwire::framing::Reason;
use armwire::messages::Messages;
use armwire::time::Duration;
use armwire::time::Instant;
use armwire::{Client, Config, Event, Output, ParseError};

use crate::serial::SerialDevice;

/// The device did not answer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Silence {
    /// How often it was asked.
    pub sends: u8,
}

impl fmt::Display for Silence {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self.sends {
            1 => f.write_str("no answer, asked once"),
            sends => write!(f, "no answer, asked {sends} times"),
        }
    }
}

impl std::error::Error for Silence {}

/// What a client received besides the outcome of calls.
#[derive(Clone, Debug, PartialEq)]
pub enum LineEvent {
    /// An answer to a request that was given up, as a frame.
    Late(Vec<u8>),
    /// A response that answers nothing, as a frame.
    Unsolicited(Vec<u8>),
    /// A request that the line gave back.
    Echo,
    /// A good frame that is no message.
    Unknown {
        /// The frame.
        frame: Vec<u8>,
        /// Why it is none.
        error: ParseError,
    },
    /// Bytes that are not part of a frame.
    Noise {
        /// Where they start, in bytes since the start.
        offset: u64,
        /// The bytes.
        bytes: Vec<u8>,
        /// Why.
        reason: Reason,
    },
    /// A lossless stream broke.
    Broken {
        /// Where, in bytes since the start.
        offset: u64,
        /// Why.
        reason: Reason,
    },
}

/// A [`Client`] with buffers of `N` bytes, connected to a device by a full-duplex line.
///
/// A byte takes ten bit times each way, rounded up to a microsecond, and the clock jumps from event to event.
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
    /// The byte on its way to the device, and when it is there.
    to_device: Option<(Instant, u8)>,
    /// The byte on its way to the host, and when it is there.
    to_host: Option<(Instant, u8)>,
    events: Vec<LineEvent>,
    /// The last answer, as a frame, and what it is expected as.
    answer: (Vec<u8>, M::Expect),
}

/// How a call ended.
enum Outcome {
    Answered,
    Sent,
    TimedOut(Silence),
}

impl<M: Messages + Default, D: SerialDevice, const N: usize> Wire<M, D, N> {
    /// A quiet line at time zero, at the configured baud rate.
    pub fn new(config: Config, device: D) -> Self {
        Self {
            client: Client::new(M::default(), config),
            device,
            now: Instant::ZERO,
            byte_time: Duration::from_micros(10_000_000_u64.div_ceil(config.baud.get().into())),
            to_device: None,
            to_host: None,
            events: Vec::new(),
            answer: (Vec::new(), M::default().unsolicited()),
        }
    }

    /// Makes one call and returns the answer, if the request gets one, when its last stop bit is over. A request that
    /// gets none is done when the device has all of it.
    ///
    /// # Errors
    ///
    /// [`Silence`] when the client gives up.
    ///
    /// # Panics
    ///
    /// If the client cannot accept the device's answer, or has no room for the request.
    pub fn call(&mut self, request: M::Request<'_>) -> Result<Option<M::Response<'_>>, Silence> {
        // Every call runs to its end.
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

    /// Lets time pass without a call.
    pub fn wait(&mut self, span: Duration) {
        let end = self.now + span;
        loop {
            // One step more at the end itself, to let the device know the time.
            let last = self.now == end;
            self.step(end);
            if last {
                return;
            }
        }
    }

    /// Virtual time since the start.
    pub fn elapsed(&self) -> Instant {
        self.now
    }

    /// What the client received besides the outcome of calls, since this was last asked: noise, late answers, echoes.
    pub fn take_events(&mut self) -> Vec<LineEvent> {
        std::mem::take(&mut self.events)
    }

    /// The device.
    pub fn device(&self) -> &D {
        &self.device
    }

    /// The device.
    pub fn device_mut(&mut self) -> &mut D {
        &mut self.device
    }

    /// Goes to the next instant at which something happens, or to `end`, and returns how a call ended, if one did.
    fn step(&mut self, end: Instant) -> Option<Outcome> {
        let (mut outcome, client_due) = self.poll(None);
        // While its line is taken the device need not be asked: it says the same later.
        if self.to_host.is_none() {
            let byte = self.device.transmit(self.now);
            self.to_host = byte.map(|byte| (self.now + self.byte_time, byte));
        }
        let device_due = match self.to_host {
            Some((due, _)) => Some(due),
            None => self.device.poll_timeout(),
        };
        let host_due = self.to_device.map(|(due, _)| due);
        // What is due already waits for the line to be free.
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

    /// Lets the client receive a byte, transmit one if its line is free, and say what happened.
    fn poll(&mut self, received: Option<u8>) -> (Option<Outcome>, Option<Instant>) {
        let now = self.now;
        let rest = self.client.receive(now, received.as_slice());
        assert!(rest.is_empty(), "the client has room");
        let mut outcome = None;
        loop {
            let event = match self.client.poll(now) {
                Output::Timeout(until) => return (outcome, until),
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
                    outcome = Some(Outcome::TimedOut(Silence { sends }));
                    continue;
                }
                Event::Unacceptable(error) => panic!("the answer cannot be accepted: {error}"),
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
            baud: NonZeroU32::new(baud).unwrap(),
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
        assert_eq!(wire.call(Request::ReadJoints), Err(Silence { sends: 3 }));
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
            Line::new(LingArm::new(ling::Config::follower()), Rates::NONE, rates, 1),
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
