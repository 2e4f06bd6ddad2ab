//! The line of a port that was lost.

use std::time::Duration;

use crate::error::Error;
use crate::error::outside::Outside;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

/// The line of a port that was lost, and that is not open: the system may give its name to the device that comes back.
pub(crate) struct LostLine {
    pub(crate) name: String,
    pub(crate) reason: Outside,
}

impl LostLine {
    fn error(&self) -> Error {
        Error::lost(&self.name, self.reason.as_str())
    }
}

impl Line for LostLine {
    fn name(&self) -> &str {
        &self.name
    }

    fn read(&mut self, _: &mut [u8], _: Duration) -> Result<usize, Error> {
        Err(self.error())
    }

    fn write(&mut self, _: &[u8]) -> Result<usize, Error> {
        Err(self.error())
    }

    fn hint(&self, _: Reception, _: Names) -> Text {
        Text::default()
    }
}
