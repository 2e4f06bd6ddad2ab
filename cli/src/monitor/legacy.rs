//! The Ling arm of the older generation: the joints and the gripper in its unsolicited frames.

use std::time::Duration;

use armwire::ling::legacy::{GripperState, Legacy, Response};
use armwire_bridge::time;

use super::reading::{LineErrors, News, Source};
use crate::describe::{Arm, legacy};
use crate::error::Error;
use crate::link::Link;

/// Maximum time without joints. Such an arm sends them 40 times per second.
const SILENCE: time::Duration = time::Duration::from_millis(500);

/// A listener on the arm's line.
pub(super) struct Listener {
    link: Link<Legacy>,
    gripper: Option<GripperState>,
}

impl Listener {
    pub(super) fn new(link: Link<Legacy>) -> Self {
        Self { link, gripper: None }
    }
}

impl Source for Listener {
    fn arm(&self) -> &'static str {
        Legacy::NAME
    }

    fn is_asked(&self) -> bool {
        false
    }

    /// The newest received joints, or the next ones if there are none.
    fn read(&mut self) -> Result<News, Error> {
        let until = self.link.now() + SILENCE;
        let mut joints = None::<Vec<_>>;
        loop {
            let left = match joints {
                Some(_) => time::Duration::ZERO,
                None => until.since(self.link.now()),
            };
            let heard = self
                .link
                .hear(Duration::from_micros(left.as_micros()), |response| response)?;
            match (heard, &joints) {
                (None, Some(_)) => {
                    let mut facts = joints.unwrap_or_default();
                    facts.extend(legacy::gripper(self.gripper.as_ref()));
                    return Ok(News::Reading(facts, None));
                }
                (None, None) if until <= self.link.now() => {
                    let reason = "the arm has stopped talking: is it still powered?";
                    return Err(Error::at(self.link.name(), reason));
                }
                (None, None) => {}
                (Some(responses), _) => {
                    for response in responses {
                        match response {
                            Response::Joints(_) => joints = Some(Legacy::facts(&response)),
                            Response::Gripper(state) => self.gripper = Some(state),
                            _ => {}
                        }
                    }
                }
            }
        }
    }

    fn line_errors(&self) -> LineErrors {
        LineErrors::of(&self.link)
    }
}
