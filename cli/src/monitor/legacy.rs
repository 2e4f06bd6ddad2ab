//! The Ling arm of the older generation: the joints and the gripper in its unsolicited frames.

use std::time::{Duration, Instant};

use armwire::ling::legacy::{GripperState, Legacy, Response};
use armwire::time;
use armwire_host::describe::{Arm, legacy};
use armwire_host::{LineErrors, Link, SilenceLimit};

use super::reading::{News, Source};
use crate::error::Error;

/// The time between two joints: such an arm sends them 40 times per second.
const PERIOD: time::Duration = time::Duration::from_millis(25);

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

    fn is_polled(&self) -> bool {
        false
    }

    /// The newest received joints, or the next ones if there are none.
    fn read(&mut self) -> Result<News, Error> {
        let until = Instant::now() + Duration::from(SilenceLimit::REOPEN.at(PERIOD));
        let mut joints = None::<Vec<_>>;
        loop {
            let left = until.saturating_duration_since(Instant::now());
            let wait = if joints.is_some() { Duration::ZERO } else { left };
            let Some(responses) = self.link.responses(wait, |response| response)? else {
                if let Some(mut facts) = joints {
                    facts.extend(legacy::gripper(self.gripper.as_ref()));
                    return Ok(News::Reading(facts, None));
                }
                if left.is_zero() {
                    let reason =
                        "the arm stopped sending: is it still powered, and does no other program read the port?";
                    return Err(Error::at(self.link.name(), reason));
                }
                continue;
            };
            for response in responses {
                match response {
                    Response::Joints(_) => joints = Some(Legacy::facts(&response)),
                    Response::Gripper(state) => self.gripper = Some(state),
                    _ => {}
                }
            }
        }
    }

    fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }
}
