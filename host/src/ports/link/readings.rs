//! Readings at a rate: each answer, also a late one, is reported with the time of its state.

use std::mem;
use std::ops::ControlFlow::{Break, Continue};
use std::time::{Duration, Instant};

use armwire::{ErrorFrame, Event, ParseError, time};

use super::Link;
use crate::describe::Arm;
use crate::error::Error;
use crate::time::stamps::HostTime;
use crate::time::stopwatch::after;

/// An event during a reading.
enum News<T> {
    /// The answer to an earlier reading.
    Late(T),
    Answer(Option<T>),
    Unacceptable(ParseError),
    ErrorFrame(ErrorFrame),
    TimedOut,
}

/// The answers that have arrived, and the time of the next part of what is due.
type Arrived<T> = (Vec<(T, HostTime)>, Option<time::Instant>);

impl<P: Arm> Link<P> {
    /// Makes one reading, as one of many at a rate, without the interrupt. Passes its answer to `take`, as converted and
    /// with the [time of its state](armwire::Client::time_of_state), and before it those to earlier readings. Returns true
    /// if there was one, false without any until this time: the reading is cancelled then, and its answer is passed to a
    /// later one. See [`Client::submit_reading`](armwire::Client::submit_reading).
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call), except for a missing answer.
    pub(crate) fn read_until<T>(
        &mut self,
        request: &P::Request<'_>,
        until: Instant,
        convert: impl Fn(P::Response<'_>) -> Option<T>,
        take: impl FnMut(T, HostTime),
    ) -> Result<bool, Error> {
        self.client.submit_reading(request);
        self.uninterrupted(|link| link.complete_reading(until, convert, take))
    }

    /// Completes the submitted reading, or cancels it at `limit`.
    fn complete_reading<T>(
        &mut self,
        limit: Instant,
        convert: impl Fn(P::Response<'_>) -> Option<T>,
        mut take: impl FnMut(T, HostTime),
    ) -> Result<bool, Error> {
        let (mut is_read, mut is_over) = (false, false);
        loop {
            let advanced = self.client.advance(|event| match event {
                Event::Answer(response) => Break(News::Answer(convert(response))),
                Event::Late(response) => convert(response).map_or(Continue(()), |value| Break(News::Late(value))),
                Event::Unacceptable(error) => Break(News::Unacceptable(error)),
                Event::ErrorFrame { frame } => Break(News::ErrorFrame(ErrorFrame::new(frame))),
                Event::TimedOut { .. } => Break(News::TimedOut),
                _ => Continue(()),
            })?;
            let (value, is_end) = match advanced {
                Break(News::Late(value)) => (Some(value), false),
                Break(News::Answer(value)) => (value, true),
                Break(News::Unacceptable(error)) => return Err(self.unacceptable(&error)),
                Break(News::ErrorFrame(frame)) => return Err(self.error_frame(frame)),
                Break(News::TimedOut) => (None, true),
                Continue(due) => {
                    let left = limit.saturating_duration_since(Instant::now());
                    // One more read after the limit: the answer may have arrived while this thread did not run.
                    if left.is_zero() && mem::replace(&mut is_over, true) {
                        self.client.cancel();
                        return Ok(is_read);
                    }
                    let wait = self.client.clock().until(due.unwrap_or_default());
                    self.client.receive(wait.min(left))?;
                    continue;
                }
            };
            if let Some(value) = value {
                take(value, self.client.time_of_state());
                is_read = true;
            }
            if is_end {
                return Ok(is_read);
            }
        }
    }

    /// Sends a reading, as one of many at a rate, and does not wait for its answer, which is among the later
    /// [readings](Self::readings). No call takes it for its own answer. Returns those that arrived before.
    ///
    /// # Errors
    ///
    /// Errors of the line, and [`Error::Unacceptable`] if the bytes of a connection are no messages.
    pub(crate) fn start_reading<T>(
        &mut self,
        request: &P::Request<'_>,
        convert: impl Fn(P::Response<'_>) -> Option<T>,
    ) -> Result<Vec<(T, HostTime)>, Error> {
        self.client.submit_reading(request);
        let (arrived, _) = self.arrived(convert)?;
        Ok(arrived)
    }

    /// The answers to readings, as converted and with the time of their states, after a wait of at most this long for the
    /// first one.
    ///
    /// # Errors
    ///
    /// As of [`start_reading`](Self::start_reading).
    pub(crate) fn readings<T>(
        &mut self,
        wait: Duration,
        convert: impl Fn(P::Response<'_>) -> Option<T>,
    ) -> Result<Vec<(T, HostTime)>, Error> {
        let (until, mut due) = (after(wait), None);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let wait = due.map_or(left, |due| self.client.clock().until(due).min(left));
            self.client.receive(wait)?;
            let arrived;
            (arrived, due) = self.arrived(&convert)?;
            if !arrived.is_empty() || left.is_zero() {
                return Ok(arrived);
            }
        }
    }

    /// The answers that have arrived. Sends what is due, and returns the time of the next part of that.
    fn arrived<T>(&mut self, convert: impl Fn(P::Response<'_>) -> Option<T>) -> Result<Arrived<T>, Error> {
        let mut arrived = Vec::new();
        loop {
            let advanced = self.client.advance(|event| match event {
                Event::Answer(response) | Event::Late(response) => convert(response).map_or(Continue(()), Break),
                _ => Continue(()),
            })?;
            match advanced {
                Break(value) => arrived.push((value, self.client.time_of_state())),
                Continue(due) => return Ok((arrived, due)),
            }
        }
    }

    /// The arm's responses that no call waits for, asked for or not, converted by `take`, after a wait of at most this
    /// long for the first byte. `None` if no byte came.
    ///
    /// # Errors
    ///
    /// Errors of the line, and [`Error::Unacceptable`] if the bytes of a connection are no messages.
    pub fn responses<T>(
        &mut self,
        wait: Duration,
        mut take: impl FnMut(P::Response<'_>) -> T,
    ) -> Result<Option<Vec<T>>, Error> {
        let n = self.client.receive(wait)?;
        let mut responses = Vec::new();
        self.client.take_events(|event| match event {
            Event::Answer(response) | Event::Late(response) | Event::Unsolicited(response) => {
                responses.push(take(response));
            }
            _ => {}
        })?;
        Ok((n > 0).then_some(responses))
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use armwire::framing::LONGEST_VOID;
    use armwire::ling::{GripperSpeed, JointState, Ling, Move, Opening, Position, Request, Speed, Torque};
    use armwire::messages::Messages;

    use super::*;
    use crate::error::text::Text;
    use crate::ports::line::{Line, Names, Reception};
    use crate::ports::link::fake::{Answering, joints};

    /// A line that accepts so many bytes, and then no write once.
    struct Breaking {
        left: usize,
        is_broken: bool,
        sent: Arc<Mutex<Vec<u8>>>,
    }

    impl Line for Breaking {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, _: &mut [u8], _: Duration) -> Result<usize, Error> {
            Ok(0)
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            if self.left == 0 && !self.is_broken {
                self.is_broken = true;
                return Err(Error::at("fake", "no"));
            }
            let n = if self.is_broken {
                bytes.len()
            } else {
                bytes.len().min(self.left)
            };
            self.left -= n.min(self.left);
            self.sent.lock().unwrap().extend(&bytes[..n]);
            Ok(n)
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    /// A link whose line breaks after so many bytes, and what is sent on it.
    fn breaking(left: usize) -> (Link<Ling>, Arc<Mutex<Vec<u8>>>) {
        let sent = Arc::default();
        let line = Breaking {
            left,
            is_broken: false,
            sent: Arc::clone(&sent),
        };
        (Link::new(Box::new(line), Ling::CONFIG), sent)
    }

    #[test]
    fn reading_does_not_complete_a_move() {
        let (mut link, sent) = breaking(10);
        let target = Move {
            joints: [(Position::CENTRE, Speed::MAX); 6],
            gripper: (Opening::OPEN, GripperSpeed(1_000)),
        };
        assert!(link.send(&Request::Move(target)).is_err());
        link.start_reading(&Request::ReadJoints, joint_state).unwrap();
        let sent = sent.lock().unwrap();
        let (void, read) = sent[10..].split_at(LONGEST_VOID);
        assert!(void.iter().all(|byte| *byte == 0), "{void:02X?}");
        assert_eq!(
            read,
            [Ling::FENCES[0], &[0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]].concat()
        );
    }

    fn joint_state(response: armwire::ling::Response) -> Option<JointState> {
        response.try_into().ok()
    }

    #[test]
    fn half_sent_reading_is_void() {
        let (mut link, sent) = breaking(10);
        let error = link.start_reading(&Request::ReadJoints, joint_state).unwrap_err();
        assert!(matches!(error, Error::At { .. }), "{error:?}");
        link.send(&Request::SetTorque(Torque::Off)).unwrap();
        let sent = sent.lock().unwrap();
        let rest = &sent[10..];
        assert!(rest[..LONGEST_VOID].iter().all(|byte| *byte == 0), "{sent:02X?}");
        assert_eq!(rest.len(), LONGEST_VOID + 7);
    }

    #[test]
    fn call_takes_no_answer_of_a_reading() {
        let arm = Answering::new(joints);
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        link.start_reading(&Request::ReadJoints, joint_state).unwrap();
        let state: JointState = link.read(&Request::ReadJoints).unwrap();
        assert_eq!(state.joints, [2; 6]);
    }

    #[test]
    fn each_reading_has_its_response() {
        let arm = Answering::new(|number| if number == 2 { Vec::new() } else { joints(number) });
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let mut readings = Vec::new();
        for _ in 0..4 {
            readings.extend(link.start_reading(&Request::ReadJoints, joint_state).unwrap());
            readings.extend(link.readings(Duration::ZERO, joint_state).unwrap());
        }
        let ticks: Vec<_> = readings.iter().map(|(state, _)| state.joints[0]).collect();
        assert_eq!(ticks, [1, 3, 4]);
    }

    #[test]
    fn lost_answer_does_not_delay_the_next_reading() {
        let arm = Answering::new(|number| if number == 1 { Vec::new() } else { joints(number) });
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let mut read = || {
            let mut ticks = Vec::new();
            let take = |state: JointState, _| ticks.push(state.joints[0]);
            link.read_until(&Request::ReadJoints, Instant::now(), joint_state, take)
                .unwrap();
            ticks
        };
        assert!(read().is_empty());
        assert_eq!(arm.lock().unwrap().requests, 1, "it is not repeated");
        assert_eq!(read(), [2]);
        assert_eq!(arm.lock().unwrap().requests, 2);
    }

    #[test]
    fn reading_runs_without_the_interrupt() {
        let mut link = Link::<Ling>::new(Box::new(Answering::new(|_| Vec::new())), Ling::CONFIG);
        link.set_interrupt(|| Err("Ctrl-C".into()));
        let until = Instant::now() + Duration::from_millis(2);
        let is_read = link.read_until(&Request::ReadJoints, until, joint_state, |_, _| {});
        assert!(matches!(is_read, Ok(false)));
        assert!(matches!(
            link.call(&Request::ReadJoints, drop),
            Err(Error::Interrupted(_))
        ));
    }
}
