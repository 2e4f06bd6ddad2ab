//! The Ling arm: joints, gripper and status, and now and then the temperatures.

use armwire::ling::{JointState, Kind, Ling, Opening, Position, Request, Response};

use super::reading::{LineErrors, News, Quantity, Reading, Source};
use crate::describe::{gripper, joint};
use crate::error::Error;
use crate::link::{Line, Link};

/// How many servos the larger of the two kinds has.
pub(super) const SERVOS: usize = Kind::Follower.servos();

/// An arm that is asked.
pub(super) struct Asked<L>(pub(super) Link<Ling, L>);

impl<L: Line> Source for Asked<L> {
    fn arm(&self) -> &'static str {
        "Ling"
    }

    fn servos(&self) -> usize {
        SERVOS
    }

    fn read(&mut self) -> Result<News, Error> {
        let news = self.0.call(Request::ReadJoints, |response| news(&response))?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn read_celsius(&mut self) -> Result<News, Error> {
        let news = self.0.call(Request::ReadTemperatures, |response| news(&response))?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn line_errors(&self) -> LineErrors {
        super::line_errors(&self.0)
    }
}

/// What an arm's message tells.
pub(super) fn news(response: &Response) -> News {
    match response {
        Response::Joints(state) => News::Reading(reading(state), None),
        Response::Temperatures(celsius) => News::Celsius(celsius.as_slice().to_vec()),
        _ => News::Nothing,
    }
}

fn reading(state: &JointState) -> Reading {
    let words = state.joints.map(joint);
    let opening = gripper(state.gripper);
    let line = format!("{}  gripper {opening}  {}", words.join("  "), state.status);
    let radians = state
        .joints
        .map(|ticks| Position::new(ticks).ok().map(Position::radians));
    let mut quantities = Reading::joints(radians.into_iter().zip(words));
    quantities.push(Quantity {
        column: "gripper_percent".to_owned(),
        name: "gripper".to_owned(),
        value: Opening::new(state.gripper)
            .ok()
            .map(|opening| f64::from(opening.per_mille()) / 10.0),
        is_whole: false,
        text: opening,
    });
    Reading {
        quantities,
        status: Some(state.status.to_string()),
        line,
    }
}
