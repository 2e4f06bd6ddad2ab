//! Ling arms of the older generation: recognised before anything is sent to them.

use std::time::{Duration, Instant};

use armwire::Config;
use armwire::ling::Ling;
use armwire::ling::legacy::Detector;

use crate::error::Error;
use crate::error::text::Text;
use crate::ports::line::{Line, Names, Reception};
use crate::ports::port::Connection;

/// Listening time before the first byte is sent. An older arm transmits two frames forty times a second. Two frames
/// detect it, in 25 ms. A current arm is silent without a request.
const LISTEN_TIME: Duration = Duration::from_millis(100);
/// Listening time if bytes arrive meanwhile.
const EXTENDED_LISTEN_TIME: Duration = Duration::from_millis(500);

/// A line that sends nothing after an arm of the older generation was detected: reads and writes return the error.
struct Listened {
    line: Box<dyn Line>,
    detector: Detector,
}

/// Opens the line of a Ling arm and listens. Unsolicited bytes received meanwhile are discarded.
///
/// # Errors
///
/// [`Error::Legacy`], now and from every later call, when the arm is one of the older generation.
pub(crate) fn open(connection: &Connection) -> Result<(Box<dyn Line>, Config), Error> {
    let (line, config) = connection.line::<Ling>()?;
    let line = Listened::new(line, Instant::now())?;
    Ok((Box::new(line), config))
}

impl Listened {
    /// Listens, as from `begun`.
    fn new(line: Box<dyn Line>, begun: Instant) -> Result<Self, Error> {
        let mut listened = Self {
            line,
            detector: Detector::new(),
        };
        let mut until = begun + LISTEN_TIME;
        let mut buf = [0; 256];
        loop {
            let left = until.saturating_duration_since(Instant::now());
            // One more read after the timeout: the port may hold bytes that arrived while this thread did not run.
            if listened.read(&mut buf, left)? > 0 {
                until = begun + EXTENDED_LISTEN_TIME;
            }
            if until <= Instant::now() {
                return Ok(listened);
            }
        }
    }

    /// Takes the next bytes from the arm. Fails once the older generation was detected.
    fn check(&mut self, bytes: &[u8]) -> Result<(), Error> {
        match self.detector.push(bytes) {
            None => Ok(()),
            Some(legacy) => Err(Error::Legacy {
                name: self.name().into(),
                legacy,
            }),
        }
    }
}

impl Line for Listened {
    fn name(&self) -> &str {
        self.line.name()
    }

    fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
        let n = self.line.read(buf, wait)?;
        self.check(&buf[..n])?;
        Ok(n)
    }

    fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
        self.check(&[])?;
        self.line.write(bytes)
    }

    fn hint(&self, reception: Reception, arm: Names) -> Text {
        self.line.hint(reception, arm)
    }
}

#[cfg(test)]
mod tests {
    use std::sync::Arc;
    use std::sync::atomic::{AtomicUsize, Ordering};

    use armwire::ling::Request;

    use super::*;
    use crate::describe::Arm;
    use crate::ports::link::Link;

    /// The joint frames of an arm of the older generation.
    const JOINTS: [u8; 23] = [
        0xAA, 0x14, 0x12, 0xA9, 0x07, 0xA9, 0x07, 0xE6, 0x0C, 0x19, 0x03, 0x6D, 0x06, 0x92, 0x09, 0x2F, 0x07, 0xED,
        0x04, 0x81, 0x08, 0x00, 0xFF,
    ];

    /// An arm that transmits continuously, once it has received so many bytes.
    struct Transmitter {
        sent: Arc<AtomicUsize>,
        silent_until: usize,
    }

    impl Line for Transmitter {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], wait: Duration) -> Result<usize, Error> {
            if self.sent.load(Ordering::Relaxed) < self.silent_until {
                std::thread::sleep(wait);
                return Ok(0);
            }
            buf[..JOINTS.len()].copy_from_slice(&JOINTS);
            Ok(JOINTS.len())
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            self.sent.fetch_add(bytes.len(), Ordering::Relaxed);
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            unreachable!("it transmits")
        }
    }

    #[test]
    fn legacy_arm_is_sent_nothing() {
        let now = Instant::now();
        for begun in [now, now.checked_sub(LISTEN_TIME).unwrap()] {
            let sent = Arc::new(AtomicUsize::new(0));
            let line = Transmitter {
                sent: Arc::clone(&sent),
                silent_until: 0,
            };
            assert!(matches!(
                Listened::new(Box::new(line), begun),
                Err(Error::Legacy { .. })
            ));
            assert_eq!(sent.load(Ordering::Relaxed), 0);
        }
    }

    #[test]
    fn write_after_a_detection_is_refused() {
        let sent = Arc::new(AtomicUsize::new(0));
        let line = Transmitter {
            sent: Arc::clone(&sent),
            silent_until: 1,
        };
        let mut line = Listened::new(Box::new(line), Instant::now()).unwrap();
        assert_eq!(line.write(&[0xAA]).unwrap(), 1);
        let mut buf = [0; 64];
        assert!(line.read(&mut buf, Duration::ZERO).is_ok(), "one frame may be noise");
        assert!(matches!(line.read(&mut buf, Duration::ZERO), Err(Error::Legacy { .. })));
        assert!(matches!(line.write(&[0xAA]), Err(Error::Legacy { .. })));
        assert_eq!(sent.load(Ordering::Relaxed), 1);
    }

    #[test]
    fn late_legacy_arm_is_sent_nothing_more() {
        let sent = Arc::new(AtomicUsize::new(0));
        let line = Transmitter {
            sent: Arc::clone(&sent),
            silent_until: 1,
        };
        let line = Listened::new(Box::new(line), Instant::now()).unwrap();
        let mut link = Link::<Ling>::new(Box::new(line), Ling::CONFIG);
        for _ in 0..2 {
            assert!(matches!(
                link.call(&Request::ReadJoints, drop),
                Err(Error::Legacy { .. })
            ));
            assert_eq!(sent.load(Ordering::Relaxed), 7);
        }
    }
}
