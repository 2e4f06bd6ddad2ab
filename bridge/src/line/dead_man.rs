//! The dead-man: hosts that stream motion, and when one of them has fallen silent.

use crate::config::HostTimeout;
use crate::control::Initiator;
use armwire::time::{Duration, Instant};

/// How many requests for motion in a row make a stream.
const STREAM: u8 = 3;

/// How long a motion of a host on CAN may wait for its turn before the host can count as silent.
const MOTION_WAIT: Duration = Duration::from_millis(150);

/// Those that may stream motion.
pub(crate) const STREAMERS: [Initiator; 3] = [Initiator::Usb, Initiator::Can, Initiator::Command];

/// The motion of one host.
#[derive(Clone, Copy, Default)]
struct Stream {
    /// Requests for motion that came sooner after each other than the time-out.
    run: u8,
    /// When the last of them came.
    moved: Instant,
    /// When the host was last heard, whatever it said.
    heard: Instant,
}

impl Stream {
    const fn is_armed(&self) -> bool {
        self.run >= STREAM
    }
}

/// The streams of motion, and the time-out of their hosts.
pub(crate) struct DeadMan {
    /// Zero for never.
    after: Duration,
    /// Whether the torque goes off when a host that streams motion falls silent.
    switches_off: bool,
    usb: Stream,
    can: Stream,
    command: Stream,
}

impl DeadMan {
    /// Without streams. The torque goes off only if the arm `can_switch_off`.
    pub(crate) fn new(timeout: HostTimeout, can_switch_off: bool) -> Self {
        let mut dead_man = Self {
            after: Duration::ZERO,
            switches_off: false,
            usb: Stream::default(),
            can: Stream::default(),
            command: Stream::default(),
        };
        dead_man.configure(timeout, can_switch_off);
        dead_man
    }

    /// Another time-out. Streams stay.
    pub(crate) fn configure(&mut self, timeout: HostTimeout, can_switch_off: bool) {
        self.after = timeout.after();
        self.switches_off = timeout.torque_off && timeout.after_ms > 0 && can_switch_off;
    }

    /// Whether the torque goes off when a host that streams motion falls silent.
    pub(crate) const fn switches_off(&self) -> bool {
        self.switches_off
    }

    const fn stream(&self, initiator: Initiator) -> Option<&Stream> {
        match initiator {
            Initiator::Usb => Some(&self.usb),
            Initiator::Can => Some(&self.can),
            Initiator::Command => Some(&self.command),
            Initiator::Poll | Initiator::Adapter => None,
        }
    }

    const fn stream_mut(&mut self, initiator: Initiator) -> Option<&mut Stream> {
        match initiator {
            Initiator::Usb => Some(&mut self.usb),
            Initiator::Can => Some(&mut self.can),
            Initiator::Command => Some(&mut self.command),
            Initiator::Poll | Initiator::Adapter => None,
        }
    }

    /// The host said something, or could not.
    pub(crate) fn heard(&mut self, initiator: Initiator, now: Instant) {
        if let Some(stream) = self.stream_mut(initiator) {
            stream.heard = now;
        }
    }

    /// No host could be heard until now.
    pub(crate) fn all_heard(&mut self, now: Instant) {
        for stream in [&mut self.usb, &mut self.can, &mut self.command] {
            stream.heard = now;
        }
    }

    /// The host asked for motion.
    pub(crate) fn motion(&mut self, initiator: Initiator, now: Instant) {
        let after = self.after;
        let Some(stream) = self.stream_mut(initiator) else {
            return;
        };
        stream.run = match stream.run {
            // A stream ends when its host falls silent or ends it. A gap is no end: another may have had the line.
            STREAM.. => STREAM,
            1.. if now.since(stream.moved) < after => stream.run.saturating_add(1),
            _ => 1,
        };
        stream.moved = now;
        stream.heard = stream.heard.max(now);
    }

    /// The stream is over. Returns whether there was one: the next must start anew.
    pub(crate) fn end(&mut self, initiator: Initiator) -> bool {
        self.stream_mut(initiator)
            .is_some_and(|stream| core::mem::take(&mut stream.run) >= STREAM)
    }

    /// Whether the host streams motion.
    pub(crate) fn is_streaming(&self, initiator: Initiator) -> bool {
        self.stream(initiator).is_some_and(Stream::is_armed)
    }

    /// Whether any host streams motion.
    pub(crate) const fn is_any_streaming(&self) -> bool {
        self.usb.is_armed() || self.is_can_streaming()
    }

    /// Whether a host on CAN streams motion.
    pub(crate) const fn is_can_streaming(&self) -> bool {
        self.can.is_armed() || self.command.is_armed()
    }

    /// When the host counts as silent, unless it says something before. While its motion waits for another's turn, which it
    /// does `since` then, it has more time: a host on CAN cannot be heard when there is no room for more.
    pub(crate) fn timeout(&self, initiator: Initiator, since: Option<Instant>) -> Option<Instant> {
        let stream = self.stream(initiator)?;
        let timeout = (stream.is_armed() && self.after > Duration::ZERO).then(|| stream.heard + self.after)?;
        Some(since.map_or(timeout, |since| timeout.max(since + MOTION_WAIT)))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const AFTER: Duration = Duration::from_millis(500);

    fn dead_man(after_ms: u16) -> DeadMan {
        let timeout = HostTimeout {
            after_ms,
            torque_off: true,
        };
        DeadMan::new(timeout, true)
    }

    fn at(micros: u64) -> Instant {
        Instant::from_micros(micros)
    }

    #[test]
    fn three_requests_within_the_timeout_are_a_stream() {
        for (gap, streams) in [(499_999, true), (500_000, false)] {
            let mut dead_man = dead_man(500);
            for n in 0..3 {
                assert_eq!(dead_man.timeout(Initiator::Usb, None), None);
                dead_man.motion(Initiator::Usb, at(n * gap));
            }
            let end = at(2 * gap) + AFTER;
            assert_eq!(dead_man.timeout(Initiator::Usb, None), streams.then_some(end));
            assert_eq!(dead_man.timeout(Initiator::Can, None), None);
            dead_man.configure(HostTimeout::default(), true);
            assert_eq!(dead_man.timeout(Initiator::Usb, None), streams.then_some(end));
        }
    }

    #[test]
    fn a_timeout_of_zero_is_never() {
        let mut dead_man = dead_man(0);
        for n in 0..3 {
            dead_man.motion(Initiator::Can, at(n));
        }
        assert_eq!(dead_man.timeout(Initiator::Can, None), None);
        assert!(!dead_man.switches_off());
    }

    #[test]
    fn a_host_that_is_heard_is_not_silent() {
        let mut dead_man = dead_man(500);
        for n in 0..3 {
            dead_man.motion(Initiator::Can, at(n));
        }
        dead_man.heard(Initiator::Can, at(100));
        assert_eq!(dead_man.timeout(Initiator::Can, None), Some(at(100) + AFTER));
        // Motion that waits gives it 150 ms.
        let since = at(400_000);
        assert_eq!(dead_man.timeout(Initiator::Can, Some(since)), Some(since + MOTION_WAIT));
        assert!(dead_man.end(Initiator::Can) && !dead_man.end(Initiator::Can));
        dead_man.motion(Initiator::Can, at(200));
        assert_eq!(dead_man.timeout(Initiator::Can, None), None);
    }
}
