//! Ling arms of the older generation: recognised before anything is sent to them.

use std::time::{Duration, Instant};

use armwire::ling::Ling;
use armwire::ling::legacy::Detector;

use crate::link::{Line, Link};
use crate::problem::Problem;
use crate::serial::Serial;

/// How long a line is listened to before the first byte is sent. Such an arm talks forty times a second, two frames each
/// time, and is recognised by three: in 50 ms. A current arm keeps silent until it is asked.
const LISTEN: Duration = Duration::from_millis(100);
/// How long, if something is said in that time.
const LISTEN_ON: Duration = Duration::from_millis(500);

/// A line on which nothing is sent once an arm of the older generation was heard there: whoever reads gets the error.
pub(crate) struct Listened<L> {
    line: L,
    detector: Detector,
}

/// Opens the port of a Ling arm and listens. What is heard meanwhile, unasked, answers nothing and is left out.
///
/// # Errors
///
/// [`Problem::Older`], now and from every later call, when the arm is one of the older generation.
pub(crate) fn open(port: &str, baud: Option<u32>) -> Result<Link<Ling, Listened<Serial>>, Problem> {
    let (line, config) = Serial::open::<Ling>(port, baud)?;
    let line = Listened::new(line)?;
    Ok(Link::new(line, config))
}

impl<L: Line> Listened<L> {
    fn new(line: L) -> Result<Self, Problem> {
        let mut listened = Self {
            line,
            detector: Detector::new(),
        };
        let begun = Instant::now();
        let mut until = begun + LISTEN;
        let mut buf = [0; 256];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(listened);
            }
            if listened.read(&mut buf, left)? > 0 {
                until = begun + LISTEN_ON;
            }
        }
    }
}

impl<L: Line> Line for Listened<L> {
    fn name(&self) -> &str {
        self.line.name()
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Problem> {
        let n = self.line.read(buf, wait)?;
        match self.detector.hear(&buf[..n]) {
            None => Ok(n),
            Some(older) => Err(Problem::Older {
                port: self.name().to_owned(),
                older,
            }),
        }
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Problem> {
        self.line.write(bytes)
    }
}
