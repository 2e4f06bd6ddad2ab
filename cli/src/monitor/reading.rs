//! Readings of an arm, and their source.

use armwire_bridge::control::Stamp;
use armwire_host::describe::Fact;
use armwire_host::{Adapter, LineErrors};

use crate::error::Error;

/// News from a [`Source`].
#[derive(Clone, Debug)]
pub(super) enum News {
    /// The state of the arm, and its stamp if an adapter has stamped it. All readings of an arm have the same items.
    Reading(Vec<Fact>, Option<Stamp>),
    /// Temperatures of the servos, in °C.
    Celsius(Vec<u8>),
    /// A notice for the user.
    Notice(String),
    /// Nothing yet.
    Nothing,
}

/// A recipient of each frame that an adapter stamped.
pub(super) type OnFrame = Box<dyn FnMut(Stamp, &[u8])>;

/// A source of readings.
pub(super) trait Source {
    /// The name of the arm, with its article.
    fn arm(&self) -> &'static str;

    /// Maximum number of temperatures of such an arm.
    fn servos(&self) -> usize {
        0
    }

    /// Returns true if each reading needs a request.
    fn is_polled(&self) -> bool {
        true
    }

    /// Returns true if the monitor determines the rate of readings.
    fn is_paced(&self) -> bool {
        true
    }

    /// Makes a request, or waits for a moment.
    fn read(&mut self) -> Result<News, Error>;

    /// Requests the temperatures, if the arm has them.
    fn read_celsius(&mut self) -> Result<News, Error> {
        Ok(News::Nothing)
    }

    /// Requests the stroke of the gripper, if the arm has one. The answer is for the recording.
    fn read_stroke(&mut self) -> Result<News, Error> {
        Ok(News::Nothing)
    }

    /// Errors on the line.
    fn line_errors(&self) -> LineErrors;

    /// The adapter, if it is the source.
    fn adapter(&mut self) -> Option<&mut Adapter> {
        None
    }
}
