//! The xArm: joint positions and state.

use armwire::xarm::{Answer, Raw, Request, VersionText, XArm};
use armwire_host::describe::{
    Arm,
    xarm::{POSITIONS, positions},
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
        let news = self.link.call(&Request::Raw(request), |response| {
            Answer::<Raw<'_>>::try_from(response).map_or(News::Nothing, |Answer { value, state }| {
                News::Reading(positions(state, value.params(), axes), None)
            })
        })?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }
}
