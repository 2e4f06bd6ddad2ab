//! The Alpha1: which servos run.
//!
//! Not where they are: the protocol has that only from a single servo, which releases what it holds to answer.

use armwire::alpha1::{Alpha1, Request, Response, SERVOS, ServoStates};

use super::reading::{LineErrors, News, Quantity, Reading, Source};
use crate::describe::running;
use crate::error::Error;
use crate::link::{Line, Link};

/// A robot that is asked.
pub(super) struct Asked<L>(pub(super) Link<Alpha1, L>);

impl<L: Line> Source for Asked<L> {
    fn arm(&self) -> &'static str {
        "Alpha1"
    }

    fn read(&mut self) -> Result<News, Error> {
        let news = self.0.call(Request::ReadServoStates, |response| news(&response))?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn line_errors(&self) -> LineErrors {
        super::line_errors(&self.0)
    }
}

/// What a robot's message tells.
pub(super) fn news(response: &Response<'_>) -> News {
    match response {
        Response::ServoStates(states) => News::Reading(reading(*states), None),
        _ => News::Nothing,
    }
}

fn reading(states: ServoStates) -> Reading {
    let quantities = (1..=SERVOS as u8).map(|n| {
        let runs = states.running().any(|servo| servo == n);
        Quantity {
            column: format!("servo_{n}_runs"),
            name: format!("servo {n}"),
            value: Some(f64::from(u8::from(runs))),
            is_whole: true,
            text: if runs { "runs" } else { "-" }.to_owned(),
        }
    });
    Reading {
        quantities: quantities.collect(),
        status: None,
        line: format!("servos that run: {}", running(states)),
    }
}
