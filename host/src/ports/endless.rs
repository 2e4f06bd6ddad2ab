//! A line on which bytes do not end, for tests.

use std::time::Duration;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};

/// A line that fills each read with these bytes, again and again.
pub(super) struct Endless(pub(super) &'static [u8]);

impl Line for Endless {
    fn name(&self) -> &str {
        "fake"
    }

    fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
        let bytes = self.0.iter().cycle();
        buf.iter_mut().zip(bytes).for_each(|(to, byte)| *to = *byte);
        Ok(buf.len())
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        Ok(bytes.len())
    }

    fn hint(&self, _: Reception, _: Names) -> Text {
        Text::default()
    }
}
