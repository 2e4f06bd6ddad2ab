//! A host that streams motion, and when it has fallen silent.

use crate::{Duration, Instant};

/// How many requests for motion in a row make a stream.
const STREAM: u8 = 3;

/// What one host does.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stream {
    /// Requests for motion that came sooner after each other than the time that counts as silence.
    run: u8,
    /// When the last of them came.
    moved: Instant,
    /// When the host was last heard, whatever it said.
    heard: Instant,
}

impl Stream {
    /// The host said something, or could not.
    pub(crate) fn hear(&mut self, now: Instant) {
        self.heard = now;
    }

    /// The host asked for motion.
    pub(crate) fn motion(&mut self, after: Duration, now: Instant) {
        self.run = match self.run {
            // A stream ends when its host falls silent or ends it. A gap is no end: another may have had the line.
            STREAM.. => STREAM,
            1.. if now.since(self.moved) < after => self.run.saturating_add(1),
            _ => 1,
        };
        self.moved = now;
        self.heard = self.heard.max(now);
    }

    /// When the host counts as silent. `None` when it streams nothing, or when `after` is zero.
    pub(crate) fn timeout(&self, after: Duration) -> Option<Instant> {
        (self.is_armed() && after > Duration::ZERO).then(|| self.heard + after)
    }

    /// Whether the host streams motion.
    pub(crate) const fn is_armed(&self) -> bool {
        self.run >= STREAM
    }

    /// The stream is over, if there was one: the next must start anew.
    pub(crate) fn end(&mut self) -> bool {
        core::mem::take(&mut self.run) >= STREAM
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AFTER: Duration = Duration::from_millis(500);

    #[test]
    fn three_requests_closer_than_the_silence_are_a_stream() {
        for (gap, streams) in [(499, true), (500, false)] {
            let mut stream = Stream::default();
            for n in 0..3 {
                assert_eq!(stream.timeout(AFTER), None);
                stream.motion(AFTER, Instant::from_millis(n * gap));
            }
            let end = Instant::from_millis(2 * gap) + AFTER;
            assert_eq!(stream.timeout(AFTER), streams.then_some(end));
            assert_eq!(stream.timeout(Duration::ZERO), None);
        }
    }

    #[test]
    fn a_host_that_says_anything_is_not_silent() {
        let mut stream = Stream::default();
        for n in 0..3 {
            stream.motion(AFTER, Instant::from_micros(n));
        }
        stream.hear(Instant::from_micros(100));
        assert_eq!(stream.timeout(AFTER), Some(Instant::from_micros(100) + AFTER));
        assert!(stream.end() && !stream.end());
        stream.motion(AFTER, Instant::from_micros(200));
        assert_eq!(stream.timeout(AFTER), None);
    }
}
