//! The dead-man timer: detects hosts that stream motion, and their silence.

use crate::config::HostTimeout;
use crate::control::Initiator;
use armwire::time::{Duration, Instant};

/// Number of consecutive motion requests that make a stream.
const STREAM: u8 = 3;

/// Time that a motion of a host on CAN may wait for its turn before the host can count as silent.
const MOTION_WAIT: Duration = Duration::from_millis(150);

/// Initiators that may stream motion.
pub(crate) const STREAMERS: [Initiator; 3] = [Initiator::Usb, Initiator::Can, Initiator::Command];

/// The motion of one host.
#[derive(Clone, Copy, Default)]
struct Stream {
    /// Consecutive motion requests within the timeout of each other.
    run: u8,
    /// Time of the last of them.
    moved: Instant,
    /// Time of the last byte or request of the host, of any kind.
    last_active: Instant,
    /// The host is not silent before: its motion had no room.
    not_before: Instant,
}

impl Stream {
    const fn is_armed(&self) -> bool {
        self.run >= STREAM
    }
}

/// The streams of motion, and the timeout of their hosts.
pub(crate) struct DeadMan {
    /// The timeout, zero for never.
    after: Duration,
    /// True if the silence of a host that streams motion switches the torque off.
    switches_off: bool,
    usb: Stream,
    can: Stream,
    command: Stream,
}

impl DeadMan {
    /// No streams. The torque goes off only if the arm `can_switch_off`.
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

    /// Changes the timeout. Streams continue.
    pub(crate) fn configure(&mut self, timeout: HostTimeout, can_switch_off: bool) {
        self.after = timeout.after();
        self.switches_off = timeout.torque_off && timeout.after_ms > 0 && can_switch_off;
    }

    /// Returns true if the silence of a host that streams motion switches the torque off.
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

    /// The host was active, or could not have been received.
    pub(crate) fn keep_alive(&mut self, initiator: Initiator, now: Instant) {
        if let Some(stream) = self.stream_mut(initiator) {
            stream.last_active = now;
        }
    }

    /// A motion of the host waits for room. It gets the same time as one that waits for its turn.
    pub(crate) fn motion_waits(&mut self, initiator: Initiator, now: Instant) {
        if let Some(stream) = self.stream_mut(initiator) {
            (stream.last_active, stream.not_before) = (now, now + MOTION_WAIT);
        }
    }

    /// No host could be received until now.
    pub(crate) fn keep_all_alive(&mut self, now: Instant) {
        for stream in [&mut self.usb, &mut self.can, &mut self.command] {
            stream.last_active = now;
        }
    }

    /// The host requested motion.
    pub(crate) fn motion(&mut self, initiator: Initiator, now: Instant) {
        let after = self.after;
        let Some(stream) = self.stream_mut(initiator) else {
            return;
        };
        stream.run = match stream.run {
            // Silence or a request of the host ends a stream. A gap does not: another initiator may have had the line.
            STREAM.. => STREAM,
            1.. if now.since(stream.moved) < after => stream.run.saturating_add(1),
            _ => 1,
        };
        stream.moved = now;
        stream.last_active = stream.last_active.max(now);
    }

    /// Ends the stream. Returns true if there was one. The next must start again.
    pub(crate) fn end(&mut self, initiator: Initiator) -> bool {
        self.stream_mut(initiator)
            .is_some_and(|stream| core::mem::take(&mut stream.run) >= STREAM)
    }

    /// Returns true if the host streams motion.
    pub(crate) fn is_streaming(&self, initiator: Initiator) -> bool {
        self.stream(initiator).is_some_and(Stream::is_armed)
    }

    /// Returns true if any host streams motion.
    pub(crate) const fn is_any_streaming(&self) -> bool {
        self.usb.is_armed() || self.is_can_streaming()
    }

    /// Returns true if a host on CAN streams motion.
    pub(crate) const fn is_can_streaming(&self) -> bool {
        self.can.is_armed() || self.command.is_armed()
    }

    /// The time at which the host counts as silent, unless it is active before. A motion that has waited for its turn
    /// `since` then extends it: a host on CAN cannot send more while the queue is full.
    pub(crate) fn timeout(&self, initiator: Initiator, since: Option<Instant>) -> Option<Instant> {
        let stream = self.stream(initiator)?;
        let is_supervised = stream.is_armed() && self.after > Duration::ZERO;
        let timeout = is_supervised.then(|| stream.not_before.max(stream.last_active + self.after))?;
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
    fn timeout_of_zero_is_never() {
        let mut dead_man = dead_man(0);
        for n in 0..3 {
            dead_man.motion(Initiator::Can, at(n));
        }
        assert_eq!(dead_man.timeout(Initiator::Can, None), None);
        assert!(!dead_man.switches_off());
    }

    #[test]
    fn active_host_is_not_silent() {
        let mut dead_man = dead_man(500);
        for n in 0..3 {
            dead_man.motion(Initiator::Can, at(n));
        }
        dead_man.keep_alive(Initiator::Can, at(100));
        assert_eq!(dead_man.timeout(Initiator::Can, None), Some(at(100) + AFTER));
        // A waiting motion extends the timeout to 150 ms.
        let since = at(400_000);
        assert_eq!(dead_man.timeout(Initiator::Can, Some(since)), Some(since + MOTION_WAIT));
        assert!(dead_man.end(Initiator::Can) && !dead_man.end(Initiator::Can));
        dead_man.motion(Initiator::Can, at(200));
        assert_eq!(dead_man.timeout(Initiator::Can, None), None);
    }
}
