//! System time, and the adapter's clock in it.

use std::time::{Duration, SystemTime, UNIX_EPOCH};

use armwire_bridge::control::Stamp;

/// The length of the window whose least delay counts: crystals drift by some 50 µs in a second.
const WINDOW_NS: i64 = 2_000_000_000;

/// Nanoseconds of system time since 1970.
pub fn now() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// Nanoseconds since 1970 as seconds and nanoseconds of a ROS time, which ends in 2038.
pub fn ros_time(nanos: i64) -> (i32, u32) {
    let seconds = i32::try_from(nanos.div_euclid(1_000_000_000)).unwrap_or(i32::MAX);
    (seconds, nanos.rem_euclid(1_000_000_000) as u32)
}

/// The adapter's clock in system time.
///
/// A message is delayed on its way to the host, by an unknown time that is never negative. So the least difference
/// between the host's time of receipt and the stamp is nearest to the difference of the clocks. It is taken over the
/// last two to four seconds, so that drift and steps of the system clock are followed.
#[derive(Debug, Default)]
pub struct Clock {
    windows: Option<Windows>,
}

#[derive(Debug)]
struct Windows {
    /// The stamp of the last message.
    last: Stamp,
    /// The host's time when the present window began.
    begun: i64,
    /// The least differences of the window before and of the present one, in nanoseconds.
    before: i64,
    present: i64,
}

impl Clock {
    /// The system time of a stamp, in nanoseconds since 1970, of a message that the host received at `now`. Never later
    /// than `now`.
    pub fn system_time(&mut self, stamp: Stamp, now: i64) -> i64 {
        let micros = i64::try_from(stamp.0).unwrap_or(i64::MAX);
        let at = micros.saturating_mul(1_000);
        let difference = now.saturating_sub(at);
        // An adapter that was restarted counts from zero, and a system clock that was set back is another clock.
        let windows = match self.windows.take() {
            Some(windows) if windows.last <= stamp && windows.begun <= now => windows,
            _ => Windows {
                last: stamp,
                begun: now,
                before: difference,
                present: difference,
            },
        };
        let windows = self.windows.insert(windows);
        windows.last = stamp;
        if now - windows.begun >= WINDOW_NS {
            windows.begun = now;
            windows.before = windows.present;
            windows.present = difference;
        }
        windows.present = windows.present.min(difference);
        at.saturating_add(windows.present.min(windows.before))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;
    const EPOCH: i64 = 1_700_000_000_000_000_000;

    /// The system time of stamps in ms, each with the delay of its message in ms.
    fn mapped(clock: &mut Clock, messages: &[(i64, i64)]) -> Vec<i64> {
        let one = |&(at, delay): &(i64, i64)| {
            let stamp = Stamp(u64::try_from(at * 1_000).unwrap());
            clock.system_time(stamp, EPOCH + (at + delay) * MS) - EPOCH
        };
        messages.iter().map(one).collect()
    }

    #[test]
    fn delays_of_messages_do_not_move_stamps() {
        let times = mapped(&mut Clock::default(), &[(0, 1), (5, 1), (10, 40), (15, 36), (20, 1)]);
        assert_eq!(times, [1, 6, 11, 16, 21].map(|ms| ms * MS));
    }

    #[test]
    fn stamps_are_never_in_the_future() {
        let times = mapped(&mut Clock::default(), &[(0, 9), (5, 2), (10, 4)]);
        assert_eq!(times, [9, 7, 12].map(|ms| ms * MS));
    }

    #[test]
    fn drift_is_followed_within_two_windows() {
        let mut clock = Clock::default();
        let messages: Vec<_> = (0..1_000).map(|n| (n * 10, 1 + n / 100)).collect();
        let last = *mapped(&mut clock, &messages).last().unwrap();
        assert!((9_996 * MS..=10_000 * MS).contains(&last), "{last}");
    }

    #[test]
    fn restarted_adapter_gets_a_new_difference() {
        let mut clock = Clock::default();
        clock.system_time(Stamp(9_000_000), EPOCH);
        assert_eq!(clock.system_time(Stamp(1_000), EPOCH + 50 * MS), EPOCH + 50 * MS);
    }

    #[test]
    fn ros_time_has_seconds_and_nanoseconds() {
        assert_eq!(ros_time(EPOCH + 5), (1_700_000_000, 5));
    }
}
