//! The Ling arm of the older generation: what it says of its joints and its gripper.

use std::time::Duration;

use armwire::ling::Position;
use armwire::ling::legacy::{GripperState, Legacy, Response};
use armwire_bridge::time;

use super::reading::{LineErrors, News, Quantity, Reading, Source};
use crate::describe::{joint, legacy};
use crate::error::Error;
use crate::link::{Line, Link};

/// How long such an arm may say nothing of its joints, though it says it forty times a second.
const SILENCE: time::Duration = time::Duration::from_millis(500);

/// An arm that is heard.
pub(super) struct Heard<L> {
    link: Link<Legacy, L>,
    gripper: Option<GripperState>,
}

impl<L: Line> Heard<L> {
    pub(super) fn new(link: Link<Legacy, L>) -> Self {
        Self { link, gripper: None }
    }
}

impl<L: Line> Source for Heard<L> {
    fn arm(&self) -> &'static str {
        "Ling, older generation"
    }

    fn is_asked(&self) -> bool {
        false
    }

    /// The newest of what the arm has said, or else the next.
    fn read(&mut self) -> Result<News, Error> {
        let until = self.link.now() + SILENCE;
        let mut joints = None;
        loop {
            let left = match joints {
                Some(_) => time::Duration::ZERO,
                None => until.since(self.link.now()),
            };
            let heard = self
                .link
                .hear(Duration::from_micros(left.as_micros()), |response| response)?;
            match (heard, &joints) {
                (None, Some(joints)) => return Ok(News::Reading(reading(*joints, self.gripper.as_ref()), None)),
                (None, None) if until <= self.link.now() => {
                    let reason = "the arm has stopped talking: is it still powered?";
                    return Err(Error::at(self.link.name(), reason));
                }
                (None, None) => {}
                (Some(responses), _) => {
                    for response in responses {
                        match response {
                            Response::Joints(state) => joints = Some(state.joints()),
                            Response::Gripper(state) => self.gripper = Some(state),
                            _ => {}
                        }
                    }
                }
            }
        }
    }

    fn line_errors(&self) -> LineErrors {
        super::line_errors(&self.link)
    }
}

fn reading(ticks: [u16; 6], state: Option<&GripperState>) -> Reading {
    let words = ticks.map(joint);
    let gripper = state.map_or("gripper not heard of yet".to_owned(), legacy::gripper);
    let line = format!("{}  {gripper}", words.join("  "));
    let radians = ticks.map(|ticks| Position::new(ticks).ok().map(Position::radians));
    let mut quantities = Reading::joints(radians.into_iter().zip(words));
    // Raw, for their scale depends on the gripper.
    let raw = |name: &str, value: fn(&GripperState) -> u16| {
        let value = state.map(value);
        Quantity {
            column: format!("{}_raw", name.replace(' ', "_")),
            name: name.to_owned(),
            value: value.map(f64::from),
            is_whole: true,
            text: value.map_or("-".to_owned(), |value| value.to_string()),
        }
    };
    quantities.extend([
        raw("gripper", |state| state.servo),
        raw("potentiometer", |state| state.potentiometer),
        raw("sync button", |state| state.sync_button.into()),
        raw("attitude button", |state| state.attitude_button.into()),
    ]);
    Reading {
        quantities,
        status: None,
        line,
    }
}
