//! What a monitor learns of an arm.

use armwire_bridge::control::Stamp;

use crate::control::ControlLink;
use crate::error::Error;

/// What an arm is at one moment. Of one arm all readings have the same quantities.
#[derive(Clone, Debug)]
pub(super) struct Reading {
    pub(super) quantities: Vec<Quantity>,
    /// What the arm says of itself beyond that.
    pub(super) status: Option<String>,
    /// All of it on one line.
    pub(super) line: String,
}

/// One thing that is measured.
#[derive(Clone, Debug)]
pub(super) struct Quantity {
    /// What it is called in tables, with its unit, such as `joint_1_rad`.
    pub(super) column: String,
    /// What people call it, such as `joint 1`.
    pub(super) name: String,
    /// Its value in that unit; `None` where what the arm says is none.
    pub(super) value: Option<f64>,
    /// Whether it is counted, or is yes or no: 0 and more, without decimals.
    pub(super) is_whole: bool,
    /// In words.
    pub(super) text: String,
}

/// What comes from a [`Source`].
#[derive(Clone, Debug)]
pub(super) enum News {
    /// How the arm is, and when it said so by the adapter's clock, if that is known.
    Reading(Reading, Option<Stamp>),
    /// The temperatures of its servos, in °C.
    Celsius(Vec<u8>),
    /// Something to tell the user.
    Notice(String),
    /// Nothing so far.
    Nothing,
}

/// Where readings come from.
pub(super) trait Source {
    /// What arm it is.
    fn arm(&self) -> &'static str;

    /// How many temperatures such an arm can have.
    fn servos(&self) -> usize {
        0
    }

    /// Whether the arm is asked for each reading. Otherwise it is listened to.
    fn is_asked(&self) -> bool {
        true
    }

    /// Whether it is for us to say how often there is a reading.
    fn is_paced(&self) -> bool {
        true
    }

    /// Asks the arm, or listens for a moment.
    fn read(&mut self) -> Result<News, Error>;

    /// Asks for the temperatures, of an arm that has them.
    fn read_celsius(&mut self) -> Result<News, Error> {
        Ok(News::Nothing)
    }

    /// What was wrong with what came.
    fn line_errors(&self) -> LineErrors;

    /// The adapter, of a source that has it.
    fn adapter(&mut self) -> Option<&mut ControlLink> {
        None
    }
}

/// What is wrong with what comes over a line.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct LineErrors {
    /// Bytes that were no part of a frame.
    pub(super) noise_bytes: usize,
    /// Frames with a wrong checksum.
    pub(super) checksums: usize,
}

impl Reading {
    /// The angles of joints, with the words for each.
    pub(super) fn joints(joints: impl IntoIterator<Item = (Option<f32>, String)>) -> Vec<Quantity> {
        let joints = (1..).zip(joints);
        let joints = joints.map(|(n, (radians, text))| Quantity {
            column: format!("joint_{n}_rad"),
            name: format!("joint {n}"),
            value: radians.map(f64::from),
            is_whole: false,
            text,
        });
        joints.collect()
    }
}
