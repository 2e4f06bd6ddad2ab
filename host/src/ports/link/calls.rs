//! Calls: a request, and the wait for its answer.

use std::mem;
use std::ops::ControlFlow::{Break, Continue};
use std::time::{Duration, Instant};

use armwire::messages::OtherAnswer;
use armwire::{ErrorFrame, Event, ParseError};

use super::Link;
use super::line_client::BUFFER;
use crate::describe::{Arm, Fact, line};
use crate::error::Error;
use crate::error::received::{LATE_HINT, Missing, Received};
use crate::ports::line::{Names, Reception};
use crate::time::stopwatch::after;

/// The longest wait for the explanation of a response: the xArm's timeout of its documented registers.
const EXPLAINED_WITHIN: Duration = Duration::from_secs(2);

/// The end of a call by an event of the client.
enum End<T> {
    /// The answer as converted, or `None` if the request has none.
    Done(Option<T>),
    Unacceptable(ParseError),
    ErrorFrame(ErrorFrame),
    TimedOut {
        sends: u8,
    },
}

impl<P: Arm> Link<P> {
    /// Makes one call. Returns the answer as converted by `take`, or `None` if the request has none.
    ///
    /// # Errors
    ///
    /// [`Error`] if the line fails or no acceptable answer arrives.
    pub fn call<T>(
        &mut self,
        request: &P::Request<'_>,
        take: impl FnOnce(P::Response<'_>) -> T,
    ) -> Result<Option<T>, Error> {
        self.client.submit(request);
        self.complete(request, take, None)
    }

    /// Makes one call without the interrupt. `None` if no answer arrives until this time: the call is cancelled then.
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call), except for a missing answer.
    pub(crate) fn call_until<T>(
        &mut self,
        request: &P::Request<'_>,
        until: Instant,
        take: impl FnOnce(P::Response<'_>) -> T,
    ) -> Result<Option<T>, Error> {
        self.client.submit(request);
        match self.uninterrupted(|link| link.complete(request, take, Some(until))) {
            Err(Error::NoAnswer { .. }) => Ok(None),
            result => result,
        }
    }

    /// Completes the submitted call, or cancels it at `limit`, without an answer then.
    fn complete<T>(
        &mut self,
        request: &P::Request<'_>,
        take: impl FnOnce(P::Response<'_>) -> T,
        limit: Option<Instant>,
    ) -> Result<Option<T>, Error> {
        let clock = self.client.clock();
        let begun = clock.now();
        let errors = self.client.errors();
        let mut received = Received::default();
        let mut take = Some(take);
        let mut is_over = false;
        loop {
            let advanced = self.client.advance(|event| {
                match event {
                    Event::Answer(response) => return Break(End::Done(take.take().map(|take| take(response)))),
                    Event::Sent => return Break(End::Done(None)),
                    Event::Unacceptable(error) => return Break(End::Unacceptable(error)),
                    Event::ErrorFrame { frame } => return Break(End::ErrorFrame(ErrorFrame::new(frame))),
                    Event::TimedOut { sends } => return Break(End::TimedOut { sends }),
                    Event::Late(_) => received.late += 1,
                    Event::Unsolicited(_) => received.frames += 1,
                    Event::Unknown { error, .. } => {
                        received.unknown.get_or_insert_with(|| error.to_string());
                    }
                    Event::Echo => received.echoes += 1,
                    // `advance` counts noise, and fails if the stream is broken.
                    Event::Noise { .. } | Event::Broken { .. } => {}
                }
                Continue(())
            })?;
            let until = match advanced {
                Continue(until) => until.unwrap_or_default(),
                Break(End::Done(answer)) => return Ok(answer),
                Break(End::Unacceptable(error)) => return Err(self.unacceptable(&error)),
                Break(End::ErrorFrame(frame)) => return Err(self.error_frame(frame)),
                Break(End::TimedOut { sends }) => {
                    received.sends = sends;
                    received.millis = clock.now().since(begun).as_micros() / 1_000;
                    received.checksums = self.client.errors().checksums - errors.checksums;
                    return Err(self.no_answer(request, received));
                }
            };
            let mut wait = clock.until(until);
            if let Some(limit) = limit {
                let left = limit.saturating_duration_since(Instant::now());
                // One more read after the limit: the answer may have arrived while this thread did not run.
                if left.is_zero() && mem::replace(&mut is_over, true) {
                    self.client.cancel();
                    return Ok(None);
                }
                wait = wait.min(left);
            }
            self.client.receive(wait)?;
        }
    }

    /// Sends a request whose response has no data, or that has no response.
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call), and [`Error::Refused`] if the arm reports a failure.
    pub fn send(&mut self, request: &P::Request<'_>) -> Result<(), Error> {
        let refusal = self.call(request, |response| {
            P::refusal(&response).map(|reason| (reason, P::follow_up(&response)))
        })?;
        match refusal.flatten() {
            Some((reason, follow_up)) => Err(self.refused(&reason, follow_up)),
            None => Ok(()),
        }
    }

    /// The error of a refused request, with the explanation that `follow_up` reads.
    pub fn refused(&mut self, reason: &str, follow_up: Option<P::Request<'static>>) -> Error {
        match line(&self.explain(follow_up)).as_str() {
            "" => Error::refused(self.name(), reason),
            explained => Error::refused(self.name(), format_args!("{reason}; {explained}")),
        }
    }

    /// Reads the explanation of an earlier response. Empty without an answer in 2 s: a failure here
    /// would hide that response.
    pub fn explain(&mut self, follow_up: Option<P::Request<'static>>) -> Vec<Fact> {
        let Some(request) = follow_up else {
            return Vec::new();
        };
        let until = after(EXPLAINED_WITHIN);
        self.client.submit(&request);
        let explained = self.complete(&request, |response| P::explanation(&response), Some(until));
        explained.ok().flatten().unwrap_or_default()
    }

    /// Makes one call, and returns the value of its answer. A silent arm has the stale window to answer late.
    ///
    /// # Errors
    ///
    /// As of [`call`](Self::call); [`Error::Unacceptable`] if the request has another answer or none, and
    /// [`Error::Refused`] if the arm reports a failure.
    pub fn read<T>(&mut self, request: &P::Request<'_>) -> Result<T, Error>
    where
        T: for<'a> TryFrom<P::Response<'a>>,
    {
        self.read_with(request, |response| T::try_from(response).ok())
    }

    /// Makes one call, and returns what `take` finds in the answer. Otherwise as [`read`](Self::read).
    ///
    /// # Errors
    ///
    /// As of [`read`](Self::read).
    pub fn read_with<T>(
        &mut self,
        request: &P::Request<'_>,
        take: impl FnOnce(P::Response<'_>) -> Option<T>,
    ) -> Result<T, Error> {
        let answer = self.call(request, |response| match P::refusal(&response) {
            None => Ok(take(response).ok_or_else(|| OtherAnswer { got: response }.to_string())),
            Some(reason) => Err((reason, P::follow_up(&response))),
        });
        match answer {
            Ok(Some(Ok(Ok(value)))) => Ok(value),
            Ok(Some(Err((reason, follow_up)))) => Err(self.refused(&reason, follow_up)),
            Ok(Some(Ok(Err(other)))) => Err(Error::unacceptable(self.name(), other)),
            Ok(None) => Err(Error::unacceptable(
                self.name(),
                format_args!("'{request}' has no answer"),
            )),
            Err(Error::NoAnswer {
                name,
                missing: Missing::Silent,
                bytes,
                ..
            }) if self.comes_late()? => Err(Error::NoAnswer {
                name,
                missing: Missing::Late,
                cause: "the answer came too late".into(),
                hint: LATE_HINT.into(),
                bytes,
            }),
            Err(error) => Err(error),
        }
    }

    /// Returns true if the answer to a call that timed out arrives within the stale window.
    ///
    /// # Errors
    ///
    /// As of [`responses`](Self::responses).
    fn comes_late(&mut self) -> Result<bool, Error> {
        let until = after(self.stale_window);
        loop {
            let left = until.saturating_duration_since(Instant::now());
            self.client.receive(left)?;
            let mut is_late = false;
            self.client
                .take_events(|event| is_late |= matches!(event, Event::Late(_)))?;
            // The wait ends even if bytes do not.
            if is_late || left.is_zero() {
                return Ok(is_late);
            }
        }
    }

    pub(super) fn unacceptable(&self, error: &ParseError) -> Error {
        let reason = format_args!("the arm's answer cannot be accepted: {error}");
        Error::unacceptable(self.name(), reason)
    }

    pub(super) fn error_frame(&self, frame: ErrorFrame) -> Error {
        let name = self.name().into();
        Error::ErrorFrame { name, frame }
    }

    fn no_answer(&self, request: &P::Request<'_>, mut received: Received) -> Error {
        let (count, bytes) = self.client.received();
        received.count = count;
        received.bytes = bytes.to_vec();
        received.begun = is_begun::<P>(request, bytes);
        let reception = match count {
            0 => Reception::Silence,
            _ => Reception::Garbage,
        };
        let names = Names {
            arm: P::NAME,
            other: P::OTHER,
        };
        let (cause, hint) = received.cause(P::NAME, self.client.hint(reception, names));
        Error::NoAnswer {
            name: self.name().into(),
            cause: cause.into(),
            hint,
            missing: received.missing(),
            bytes: count,
        }
    }
}

/// Returns true if an answer to the request begins somewhere in the bytes: the request's header, followed by another
/// byte. Its end may be lost.
fn is_begun<P: Arm>(request: &P::Request<'_>, bytes: &[u8]) -> bool {
    let mut out = [0; BUFFER];
    let sent = P::default().encode_request(request, &mut out).unwrap_or(0);
    let (header, next) = (&out[..P::HEADER], out[P::HEADER]);
    let answered = |window: &[u8]| window.starts_with(header) && window[P::HEADER] != next;
    !P::LOSSLESS && sent > P::HEADER && bytes.windows(P::HEADER + 1).any(answered)
}

#[cfg(test)]
mod tests {
    use std::cell::Cell;
    use std::collections::VecDeque;
    use std::sync::{Arc, Mutex};
    use std::time::Duration;

    use armwire::alpha1::{self, Alpha1, Outcome};
    use armwire::framing::LONGEST_VOID;
    use armwire::ling::{
        Frame, GripperSpeed, JointState, Ling, MAX_FRAME, Move, Opening, Position, Request, Response, Speed, Stroke,
        TemperatureLimit, Torque,
    };
    use armwire::messages::Messages;
    use armwire::xarm::{self, XArm};
    use armwire::{Device, DeviceEvent};

    use super::*;
    use crate::error::text::Text;
    use crate::ports::endless::Endless;
    use crate::ports::line::Line;
    use crate::ports::link::fake::{Answering, fence_answer, joints};

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
    fn unacceptable_answer_ends_the_call_with_its_reason() {
        let arm = Answering::new(unknown_stroke);
        arm.lock().unwrap().answers_fences = false;
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let error = link.call(&Request::ReadStroke, drop).unwrap_err();
        assert_eq!(
            error.to_string(),
            "fake: the arm's answer cannot be accepted: command 04 function 0E: gripper stroke type is 3, must be 0..=2 \
             (data byte 0)"
        );
        assert_eq!(arm.lock().unwrap().requests, 1);
    }

    /// An arm's error frame.
    fn error_frame(_: u16) -> Vec<u8> {
        let mut out = [0; MAX_FRAME];
        let frame = Frame {
            command: 0xEE,
            function: 0x00,
            data: &[0x01, 0x03],
        };
        let n = frame.encode(&mut out).unwrap();
        out[..n].to_vec()
    }

    #[test]
    fn error_frame_ends_the_call_with_its_bytes() {
        let arm = Answering::new(error_frame);
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let error = link.call(&Request::ReadJoints, drop).unwrap_err();
        assert_eq!(
            error.to_string(),
            "fake: the arm answered with an error frame, which no document explains: AA EE 00 02 01 03 36 FF"
        );
        assert_eq!(arm.lock().unwrap().requests, 1);
    }

    #[test]
    fn another_answer_ends_the_read_with_its_text() {
        let arm = Answering::new(joints);
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let state: JointState = link.read(&Request::ReadJoints).unwrap();
        assert_eq!(state.joints, [1; 6]);
        let error = link.read::<Stroke>(&Request::ReadJoints).unwrap_err();
        assert_eq!(
            error.to_string(),
            "fake: another answer: joints: -179.82° -179.82° -179.82° -179.82° -179.82° -179.82°, gripper: 0.0 % open, \
             status: idle"
        );
        let error = link.read::<JointState>(&Request::SetTorque(Torque::Off)).unwrap_err();
        assert_eq!(error.to_string(), "fake: 'torque off' has no answer");
    }

    /// An Alpha1's report of a stop that failed.
    fn failed_stop(_: u16) -> Vec<u8> {
        let mut out = [0; alpha1::MAX_FRAME];
        let response = alpha1::Response::Stopped(Outcome::Failure);
        let n = Alpha1.encode_response(&response, None, &mut out).unwrap();
        out[..n].to_vec()
    }

    #[test]
    fn refused_request_is_not_sent_with_success() {
        let robot = Answering::new(failed_stop);
        let mut link = Link::<Alpha1>::new(Box::new(robot), Alpha1::CONFIG);
        let error = link.send(&alpha1::Request::Stop).unwrap_err();
        assert!(matches!(error, Error::Refused { .. }), "{error:?}");
    }

    /// A line whose second write fails, after one of five bytes.
    #[derive(Default)]
    struct Failing {
        writes: usize,
        written: Vec<u8>,
    }

    impl Line for Arc<Mutex<Failing>> {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, _: &mut [u8], _: Duration) -> Result<usize, Error> {
            Ok(0)
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            let line = &mut *self.lock().unwrap();
            line.writes += 1;
            let n = match line.writes {
                1 => 5,
                2 => return Err(Error::at("fake", "no")),
                _ => bytes.len(),
            };
            line.written.extend(&bytes[..n]);
            Ok(n)
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    #[test]
    fn half_sent_motion_never_reaches_the_arm() {
        let line = Arc::new(Mutex::new(Failing::default()));
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&line)), Ling::CONFIG);
        let (position, speed) = (Position::new(2048).unwrap(), Speed::new(100).unwrap());
        let motion = Request::Move(Move {
            joints: [(position, speed); 6],
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1000)),
        });
        assert!(matches!(link.call(&motion, drop), Err(Error::At { .. })));
        assert!(matches!(link.call(&Request::SetTorque(Torque::Off), drop), Ok(None)));
        let mut out = [0; MAX_FRAME];
        Ling.encode_request(&motion, &mut out).unwrap();
        let mut expected = out[..5].to_vec();
        expected.resize(5 + LONGEST_VOID, 0);
        let n = Ling.encode_request(&Request::SetTorque(Torque::Off), &mut out).unwrap();
        expected.extend(&out[..n]);
        assert_eq!(line.lock().unwrap().written, expected);
    }

    #[test]
    fn half_sent_request_ends_a_tcp_connection() {
        let line = Arc::new(Mutex::new(Failing::default()));
        let mut link = Link::<XArm>::new(Box::new(Arc::clone(&line)), XArm::CONFIG);
        assert!(matches!(
            link.call(&xarm::Request::ReadVersion, |_| ()),
            Err(Error::At { .. })
        ));
        for _ in 0..2 {
            let error = link.call(&xarm::Request::ReadVersion, |_| ()).unwrap_err();
            let text = "fake: the connection ended in the middle of a request: open it again";
            assert_eq!(error.to_string(), text);
        }
        assert_eq!(line.lock().unwrap().written.len(), 5);
    }

    thread_local! {
        /// The state of the random numbers of this test's line and interrupt.
        static RANDOM: Cell<u64> = const { Cell::new(1) };
    }

    /// A random number below `bound`.
    fn below(bound: usize) -> usize {
        RANDOM.set(RANDOM.get().wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1));
        (RANDOM.get() >> 33) as usize % bound
    }

    /// A line that fails, and accepts and returns bytes in pieces, at random. Its arm answers late.
    struct Random {
        arm: Device<Ling, MAX_FRAME>,
        /// The request in flight.
        current: Option<Request>,
        /// The number of requests that the arm has executed, which is in its answers.
        executed: u16,
        /// Answers that have not arrived, and bytes that have.
        answers: VecDeque<Vec<u8>>,
        arrived: VecDeque<u8>,
    }

    impl Line for Arc<Mutex<Random>> {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
            let line = &mut *self.lock().unwrap();
            if !wait.is_zero() && below(4) == 0 {
                line.arrived.extend(line.answers.pop_front().unwrap_or_default());
            }
            let n = line.arrived.len().min(1 + below(buf.len()));
            buf.iter_mut()
                .zip(line.arrived.drain(..n))
                .for_each(|(to, byte)| *to = byte);
            Ok(n)
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            if below(8) == 0 {
                return Err(Error::at("fake", "no"));
            }
            let line = &mut *self.lock().unwrap();
            let n = 1 + below(bytes.len());
            assert!(line.arm.receive(&bytes[..n]).is_empty());
            while let Some(event) = line.arm.poll() {
                if let DeviceEvent::Request { request, .. } = event {
                    if let Some(answer) = fence_answer(&request) {
                        line.answers.push_back(answer);
                        continue;
                    }
                    assert_eq!(Some(request), line.current, "its call has ended");
                    line.executed += 1;
                    line.answers
                        .extend((request == Request::ReadJoints).then(|| joints(line.executed)));
                }
            }
            Ok(n)
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            String::new().into()
        }
    }

    #[test]
    fn calls_that_fail_anywhere_leave_nothing_behind() {
        let line = Arc::new(Mutex::new(Random {
            arm: Device::new(Ling),
            current: None,
            executed: 0,
            answers: VecDeque::new(),
            arrived: VecDeque::new(),
        }));
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&line)), Ling::CONFIG);
        link.set_interrupt(|| match below(8) {
            0 => Err("enough".into()),
            _ => Ok(()),
        });
        let (mut answered, mut failed) = (0, 0);
        for celsius in (0..=200).cycle().take(20_000) {
            let setting = Request::SetTemperatureLimit(TemperatureLimit::new(celsius).unwrap());
            let request = [Request::ReadJoints, setting][below(2)];
            let earlier = {
                let mut line = line.lock().unwrap();
                line.current = Some(request);
                line.executed
            };
            match link.call(&request, |response| response) {
                Ok(Some(Response::Joints(state))) => {
                    assert!(state.joints[0] > earlier, "{} after {earlier}", state.joints[0]);
                    answered += 1;
                }
                Ok(None) => assert_eq!(line.lock().unwrap().executed, earlier + 1),
                Ok(other) => panic!("{other:?}"),
                Err(Error::At { .. } | Error::Interrupted(_) | Error::NoAnswer { .. }) => failed += 1,
                Err(error) => panic!("{error}"),
            }
            line.lock().unwrap().current = None;
        }
        assert!(
            answered > 1_000 && failed > 1_000,
            "{answered} answered, {failed} failed"
        );
    }

    #[test]
    fn endless_noise_ends_the_wait_for_late_answers() {
        let mut link = Link::<Ling>::new(Box::new(Endless(&[0])), Ling::CONFIG);
        assert!(matches!(link.comes_late(), Ok(false)));
    }

    #[test]
    fn broken_stream_is_an_error_without_a_call() {
        let link = || Link::<XArm>::new(Box::new(Endless(&[0xFF])), XArm::CONFIG);
        for error in [
            link().responses(Duration::ZERO, |_| ()).unwrap_err(),
            link().comes_late().unwrap_err(),
        ] {
            assert!(matches!(error, Error::Unacceptable { .. }), "{error:?}");
        }
    }

    #[test]
    fn interrupt_ends_a_call_with_its_reason() {
        let silent = Answering::new(|_| Vec::new());
        let mut link = Link::<Ling>::new(Box::new(silent), Ling::CONFIG);
        link.set_interrupt(|| Err("enough".into()));
        let error = link.call(&Request::ReadJoints, drop).unwrap_err();
        assert!(matches!(&error, Error::Interrupted(reason) if reason.to_string() == "enough"));
    }

    #[test]
    fn interrupt_ends_a_call_on_a_noisy_line() {
        let mut link = Link::<Ling>::new(Box::new(Endless(&[0])), Ling::CONFIG);
        link.set_interrupt(|| Err("enough".into()));
        let error = link.call(&Request::ReadJoints, drop).unwrap_err();
        assert!(matches!(error, Error::Interrupted(_)), "{error:?}");
    }

    #[test]
    fn stale_answer_is_not_taken_for_the_next() {
        let arm = Answering::new(joints);
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        for _ in 0..3 {
            arm.lock().unwrap().answers.push_back(joints(4000));
            let Ok(Some(Response::Joints(state))) = link.call(&Request::ReadJoints, |response| response) else {
                panic!("no answer");
            };
            assert_eq!(state.joints, [arm.lock().unwrap().requests; 6]);
        }
    }
}
