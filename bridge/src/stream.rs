//! A host that streams motion, and when it has fallen silent.

use crate::Micros;

/// How many requests for motion in a row make a stream.
const STREAM: u8 = 3;

/// What one host does.
#[derive(Clone, Copy, Default)]
pub(crate) struct Stream {
    /// Requests for motion that came sooner after each other than the time that counts as silence.
    run: u8,
    /// When the last of them came.
    moved: Micros,
    /// When the host was last heard, whatever it said.
    heard: Micros,
}

impl Stream {
    /// The host said something, or could not.
    pub(crate) fn hear(&mut self, now: Micros) {
        self.heard = now;
    }

    /// The host asked for motion.
    pub(crate) fn motion(&mut self, after: Micros, now: Micros) {
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
    pub(crate) fn timeout(&self, after: Micros) -> Option<Micros> {
        (self.is_armed() && after > Micros(0)).then(|| self.heard + after)
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

    const AFTER: Micros = Micros::from_millis(500);

    #[test]
    fn three_requests_closer_than_the_silence_are_a_stream() {
        for (gap, streams) in [(499, true), (500, false)] {
            let mut stream = Stream::default();
            for n in 0..3 {
                assert_eq!(stream.timeout(AFTER), None);
                stream.motion(AFTER, Micros::from_millis(n * gap));
            }
            let end = Micros::from_millis(2 * gap) + AFTER;
            assert_eq!(stream.timeout(AFTER), streams.then_some(end));
            assert_eq!(stream.timeout(Micros(0)), None);
        }
    }

    #[test]
    fn a_host_that_says_anything_is_not_silent() {
        let mut stream = Stream::default();
        for n in 0..3 {
            stream.motion(AFTER, Micros(n));
        }
        stream.hear(Micros(100));
        assert_eq!(stream.timeout(AFTER), Some(Micros(100) + AFTER));
        assert!(stream.end() && !stream.end());
        stream.motion(AFTER, Micros(200));
        assert_eq!(stream.timeout(AFTER), None);
    }
}
