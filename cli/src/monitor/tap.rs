//! A line whose bytes are captured.

use std::time::Duration;

use crate::args::Speaker;
use crate::describe::Arm;
use crate::error::Error;
use crate::link::{Line, Names, Reception};
use crate::recording::Capture;
use crate::stamps::now;

/// A line, and the capture of its bytes in both directions.
pub(super) struct Tap<P: Arm> {
    line: Box<dyn Line>,
    capture: Capture<P>,
}

impl<P: Arm> Tap<P> {
    pub(super) fn new(line: Box<dyn Line>, capture: Capture<P>) -> Self {
        Self { line, capture }
    }
}

impl<P> Line for Tap<P>
where
    P: Arm + Send,
    P::Expect: Send,
{
    fn name(&self) -> &str {
        self.line.name()
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        let n = self.line.read(buf, wait)?;
        self.capture.push(Speaker::Arm, &buf[..n], now());
        Ok(n)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        let n = self.line.write(bytes)?;
        self.capture.push(Speaker::Host, &bytes[..n], now());
        Ok(n)
    }

    fn hints(&mut self, reception: Reception, arm: Names) -> String {
        self.line.hints(reception, arm)
    }
}
