//! The xArm: joint positions and state.

use armwire::xarm::{Raw, Reply, Request, Response, XArm};
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
        let axes = self.link.call(&Request::ReadVersion, |response| match response {
            Response::Reply {
                reply: Reply::Version(text),
                ..
            } => text.version().ok().map(|version| version.axes.into()),
            _ => None,
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
        let news = self.link.call(&Request::Raw(request), |response| match response {
            Response::Reply {
                state,
                reply: Reply::Raw(raw),
            } => News::Reading(positions(state, raw.params(), axes), None),
            _ => News::Nothing,
        })?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn line_errors(&self) -> LineErrors {
        self.link.line_errors()
    }
}
