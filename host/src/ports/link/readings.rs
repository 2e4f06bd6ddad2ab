//! Readings at a rate: requests that nothing waits for, and the responses that arrive later.

use std::ops::ControlFlow;
use std::time::Duration;

use armwire::Event;

use super::Link;
use crate::describe::Arm;
use crate::error::Error;

impl<P: Arm> Link<P> {
    /// Sends a reading, as one of many at a rate, and does not wait for its answer, which is among the later
    /// [responses](Self::responses). No call takes it for its own answer. Those that arrived before go to `take`. See
    /// [`Client::submit_reading`](armwire::Client::submit_reading).
    ///
    /// # Errors
    ///
    /// Errors of the line, and [`Error::Unacceptable`] if the bytes of a connection are no messages.
    pub(crate) fn start_reading(
        &mut self,
        request: &P::Request<'_>,
        mut take: impl FnMut(P::Response<'_>),
    ) -> Result<(), Error> {
        self.client.submit_reading(request);
        let sent = self.client.advance(|event| {
            response(event).map(&mut take);
            ControlFlow::<()>::Continue(())
        });
        sent.map(drop)
    }

    /// The arm's responses that no call waits for, converted by `take`, after a wait of at most this long for the first
    /// byte. `None` if no byte came.
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
        self.client
            .take_events(|event| responses.extend(response(event).map(&mut take)))?;
        Ok((n > 0).then_some(responses))
    }
}

/// The response in an event, whether it was asked for or not.
fn response<R>(event: Event<'_, R>) -> Option<R> {
    match event {
        Event::Answer(response) | Event::Late(response) | Event::Unsolicited(response) => Some(response),
        _ => None,
    }
}

#[cfg(test)]
mod tests {
    use std::sync::{Arc, Mutex};

    use armwire::framing::Framing;
    use armwire::ling::{GripperSpeed, JointState, Ling, Move, Opening, Position, Request, Speed, Torque};

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
        link.start_reading(&Request::ReadJoints, drop).unwrap();
        let sent = sent.lock().unwrap();
        let (void, read) = sent[10..].split_at(Ling::LONGEST);
        assert!(void.iter().all(|byte| *byte == 0), "{void:02X?}");
        assert_eq!(read, [0xAA, 0x06, 0x00, 0x01, 0xFE, 0x9A, 0xFF]);
    }

    #[test]
    fn half_sent_reading_is_void() {
        let (mut link, sent) = breaking(3);
        let error = link.start_reading(&Request::ReadJoints, drop).unwrap_err();
        assert!(matches!(error, Error::At { .. }), "{error:?}");
        link.send(&Request::SetTorque(Torque::Off)).unwrap();
        let sent = sent.lock().unwrap();
        assert!(sent[3..3 + Ling::LONGEST].iter().all(|byte| *byte == 0), "{sent:02X?}");
        assert_eq!(sent.len(), 3 + Ling::LONGEST + 7);
    }

    #[test]
    fn call_takes_no_answer_of_a_reading() {
        let arm = Answering::new(joints);
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        link.start_reading(&Request::ReadJoints, drop).unwrap();
        let state: JointState = link.read(&Request::ReadJoints).unwrap();
        assert_eq!(state.joints, [2; 6]);
    }

    #[test]
    fn each_reading_has_its_response() {
        let arm = Answering::new(|number| if number == 2 { Vec::new() } else { joints(number) });
        let mut link = Link::<Ling>::new(Box::new(Arc::clone(&arm)), Ling::CONFIG);
        let mut readings = Vec::new();
        for _ in 0..4 {
            let mut take = |response| readings.extend(JointState::try_from(response));
            link.start_reading(&Request::ReadJoints, &mut take).unwrap();
            link.responses(Duration::ZERO, take).unwrap();
        }
        let ticks: Vec<_> = readings.iter().map(|state| state.joints[0]).collect();
        assert_eq!(ticks, [1, 3, 4]);
    }
}
