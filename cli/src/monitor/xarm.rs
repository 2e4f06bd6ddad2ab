//! The xArm: joint positions and state.
//!
//! Joint positions are in register 42, which the document does not have. It is read as the vendor's package does: seven
//! little-endian floating-point numbers in radians, of which an arm with fewer axes uses the first. What an arm answers
//! otherwise is shown as it is.

use armwire::xarm::{Raw, Reply, Request, State, XArm};

use super::reading::{LineErrors, News, Reading, Source};
use crate::call::ask;
use crate::describe::angle;
use crate::error::Error;
use crate::hex;
use crate::link::{Line, Link};

/// The register of joint positions.
const POSITIONS: u8 = 42;
/// How many positions there are, whatever the arm.
const JOINTS: usize = 7;

/// An arm that is asked.
pub(super) struct Asked<L> {
    link: Link<XArm, L>,
    /// How many joints the arm has, once it was asked.
    axes: Option<usize>,
}

impl<L: Line> Asked<L> {
    pub(super) fn new(link: Link<XArm, L>) -> Self {
        Self { link, axes: None }
    }

    /// How many joints the arm has; as many as any if it does not tell.
    fn read_axes(&mut self) -> Result<usize, Error> {
        let axes = ask(&mut self.link, Request::ReadVersion, |_, reply| match reply {
            Reply::Version(text) => text.version().map_or(JOINTS, |version| version.axes.into()),
            _ => JOINTS,
        })?;
        Ok(axes.unwrap_or(JOINTS))
    }
}

impl<L: Line> Source for Asked<L> {
    fn arm(&self) -> &'static str {
        "xArm"
    }

    fn read(&mut self) -> Result<News, Error> {
        let axes = match self.axes {
            Some(axes) => axes,
            None => {
                let axes = self.read_axes()?;
                *self.axes.insert(axes)
            }
        };
        let positions = Raw::new(POSITIONS, &[]).expect("the document does not have this register");
        let news = ask(&mut self.link, Request::Raw(positions), |state, reply| match reply {
            Reply::Raw(raw) => News::Reading(reading(state, raw.params(), axes), None),
            _ => News::Nothing,
        })?;
        Ok(news.unwrap_or(News::Nothing))
    }

    fn line_errors(&self) -> LineErrors {
        super::line_errors(&self.link)
    }
}

fn reading(state: State, params: &[u8], axes: usize) -> Reading {
    let told = match params.as_chunks() {
        (positions, []) if positions.len() == JOINTS => Some(positions),
        _ => None,
    };
    let radians = (0..axes.min(JOINTS)).map(|joint| Some(f32::from_le_bytes(*told?.get(joint)?)));
    let words = |radians: Option<f32>| (radians, radians.map_or("not told".to_owned(), angle));
    let quantities = Reading::joints(radians.map(words));
    let line = match (told, params) {
        (Some(_), _) => {
            let joints: Vec<_> = quantities.iter().map(|joint| joint.text.as_str()).collect();
            joints.join("  ")
        }
        (None, []) => format!("register {POSITIONS} not told"),
        (None, params) => format!("register {POSITIONS} {}", hex::show(params)),
    };
    let status = match told {
        Some(_) => state.to_string(),
        None => format!("{state}, {line}"),
    };
    Reading {
        quantities,
        status: Some(status),
        line: format!("{line}  {state}"),
    }
}
