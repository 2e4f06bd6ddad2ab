//! The xArm: joint positions, error, warning and state.

use armwire::xarm::{Answer, Codes, Raw, Request, State, VersionText, XArm};
use armwire_host::describe::{
    Arm, Fact,
    xarm::{POSITIONS, codes, positions},
};
use armwire_host::{LineErrors, Link};

use super::reading::{News, Source};
use crate::error::Error;

/// A polled arm.
pub(super) struct PolledXArm {
    link: Link<XArm>,
    /// Number of joints, once the arm's version was read.
    axes: Option<Option<usize>>,
}

impl PolledXArm {
    pub(super) fn new(link: Link<XArm>) -> Self {
        Self { link, axes: None }
    }

    /// Reads the number of joints. `None` if the arm's version does not name it.
    fn read_axes(&mut self) -> Result<Option<usize>, Error> {
        let axes = self.link.call(&Request::ReadVersion, |response| {
            let answer = Answer::<VersionText<'_>>::try_from(response).ok()?;
            answer.value.version().ok().map(|version| version.axes.into())
        })?;
        Ok(axes.flatten())
    }

    /// The error and the warning of an arm in this state. They are read only if it has one.
    fn read_codes(&mut self, state: State) -> Vec<Fact> {
        if !state.has_codes() {
            return codes(Some(Codes::NONE));
        }
        let explained = self.link.explain(Some(Codes::READ));
        match explained.is_empty() {
            true => codes(None),
            false => explained,
        }
    }
}

impl Source for PolledXArm {
    fn arm(&self) -> &'static str {
        XArm::NAME
    }

    fn read(&mut self) -> Result<News, Error> {
        let axes = match self.axes {
            Some(axes) => axes,
            None => {
                let axes = self.read_axes()?;
                *self.axes.insert(axes)
            }
        };
        let request = Raw::new(POSITIONS, &[]).expect("the document does not have this register");
        let read = self.link.call(&Request::Raw(request), |response| {
            let Answer { value, state } = Answer::<Raw<'_>>::try_from(response).ok()?;
            Some((positions(state, value.params(), axes), state))
        })?;
        let Some((mut facts, state)) = read.flatten() else {
            return Ok(News::Nothing);
        };
        facts.extend(self.read_codes(state));
        Ok(News::Reading(facts, None))
    }

    fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }
}
