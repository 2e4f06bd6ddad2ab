//! An arm that is polled: a request for each reading.

use armwire::alpha1::{self, Alpha1};
use armwire::ling::{self, Kind, Ling};
use armwire::messages::Messages;
use armwire_host::describe::Arm;
use armwire_host::{LineErrors, Link};

use super::reading::{News, Source};
use crate::error::Error;

/// A protocol with a request for the state of the arm.
pub(super) trait Readable: Arm {
    /// The request for a reading.
    const READING: Self::Request<'static>;

    /// The request for temperatures; `None` for an arm without temperatures.
    const CELSIUS: Option<Self::Request<'static>> = None;

    /// Maximum number of temperatures.
    const SERVOS: usize = 0;

    /// The request for the stroke of the gripper; `None` for an arm without a gripper.
    const STROKE: Option<Self::Request<'static>> = None;

    /// The news in a message.
    fn news(response: &Self::Response<'_>) -> News;
}

impl Readable for Ling {
    const READING: ling::Request = ling::Request::ReadJoints;

    const CELSIUS: Option<ling::Request> = Some(ling::Request::ReadTemperatures);

    const SERVOS: usize = Kind::Follower.servos();

    const STROKE: Option<ling::Request> = Some(ling::Request::ReadStroke);

    fn news(response: &ling::Response) -> News {
        match response {
            ling::Response::Joints(_) => News::Reading(Self::facts(response), None),
            ling::Response::Temperatures(celsius) => News::Celsius(celsius.as_slice().to_vec()),
            _ => News::Nothing,
        }
    }
}

/// The readings show which servos run. Positions can be read from a single servo only, which stops holding its position
/// to answer.
impl Readable for Alpha1 {
    const READING: alpha1::Request<'static> = alpha1::Request::ReadServoStates;

    fn news(response: &alpha1::Response<'_>) -> News {
        match response {
            alpha1::Response::ServoStates(_) => News::Reading(Self::facts(response), None),
            _ => News::Nothing,
        }
    }
}

/// A polled arm.
pub(super) struct Polled<P: Arm>(pub(super) Link<P>);

impl<P: Readable> Polled<P> {
    fn poll(&mut self, request: &P::Request<'_>) -> Result<News, Error> {
        let news = self.0.call(request, |response| P::news(&response))?;
        Ok(news.unwrap_or(News::Nothing))
    }
}

impl<P: Readable> Source for Polled<P> {
    fn arm(&self) -> &'static str {
        P::NAME
    }

    fn servos(&self) -> usize {
        P::SERVOS
    }

    fn read(&mut self) -> Result<News, Error> {
        self.poll(&P::READING)
    }

    fn read_celsius(&mut self) -> Result<News, Error> {
        P::CELSIUS.map_or(Ok(News::Nothing), |request| self.poll(&request))
    }

    fn read_stroke(&mut self) -> Result<News, Error> {
        P::STROKE.map_or(Ok(News::Nothing), |request| self.poll(&request))
    }

    fn line_errors(&self) -> LineErrors {
        self.0.line_errors()
    }
}

/// The news in a frame that answers another host.
pub(super) fn news<P: Readable>(frame: &[u8]) -> News {
    let arm = P::default();
    let response = Messages::parse_response(&arm, frame, arm.unsolicited());
    response.map_or(News::Nothing, |response| P::news(&response))
}
