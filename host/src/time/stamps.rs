//! Time of this computer, and the adapter's clock in it.

#[cfg(not(unix))]
use std::sync::OnceLock;
#[cfg(not(unix))]
use std::time::Instant;
use std::time::{Duration, SystemTime, UNIX_EPOCH};

use armwire_bridge::control::Stamp;

/// The length of the window whose least delay counts: crystals drift by some 50 µs in a second.
const WINDOW_NS: i64 = 2_000_000_000;
/// Maximum time between two readings of the monotonic clock around one of the system time.
const MAX_SPREAD_NS: i64 = 20_000;
/// Difference of two leads of the system time that is a step of it, in nanoseconds.
const LEAST_STEP_NS: u64 = 100_000;
/// Maximum number of attempts for that.
const ATTEMPTS: usize = 3;

/// Nanoseconds of system time since 1970.
pub fn now() -> i64 {
    let since = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or(Duration::ZERO);
    i64::try_from(since.as_nanos()).unwrap_or(i64::MAX)
}

/// Nanoseconds of the monotonic clock. On Unix it is the clock that Python's `time.monotonic_ns` has on Linux; elsewhere
/// it counts from its first use in this program.
pub fn monotonic() -> i64 {
    #[cfg(unix)]
    {
        let time = rustix::time::clock_gettime(rustix::time::ClockId::Monotonic);
        time.tv_sec * 1_000_000_000 + time.tv_nsec
    }
    #[cfg(not(unix))]
    {
        static START: OnceLock<Instant> = OnceLock::new();
        let elapsed = START.get_or_init(Instant::now).elapsed();
        i64::try_from(elapsed.as_nanos()).unwrap_or(i64::MAX)
    }
}

/// Nanoseconds since 1970 as seconds and nanoseconds of a ROS time, which ends in 2038.
pub fn ros_time(nanos: i64) -> (i32, u32) {
    let seconds = i32::try_from(nanos.div_euclid(1_000_000_000)).unwrap_or(i32::MAX);
    (seconds, nanos.rem_euclid(1_000_000_000) as u32)
}

/// An instant on both clocks of this computer.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct HostTime {
    /// Nanoseconds of the [monotonic] clock, which nobody sets.
    pub monotonic_ns: i64,
    /// Nanoseconds of system time since 1970, as it was set when the instant became known.
    pub unix_ns: i64,
}

impl HostTime {
    /// Now.
    pub fn now() -> Self {
        let mut attempts = 1;
        loop {
            let (before, unix_ns, after) = (monotonic(), now(), monotonic());
            // This thread may have been interrupted in between.
            if after - before <= MAX_SPREAD_NS || attempts == ATTEMPTS {
                let monotonic_ns = before + (after - before) / 2;
                return Self { monotonic_ns, unix_ns };
            }
            attempts += 1;
        }
    }

    /// The instant at this time of the monotonic clock, with the system time as it is set at `self`.
    #[must_use]
    pub const fn at(self, monotonic_ns: i64) -> Self {
        let before = self.monotonic_ns.saturating_sub(monotonic_ns);
        Self {
            monotonic_ns,
            unix_ns: self.unix_ns.saturating_sub(before),
        }
    }
}

/// The adapter's clock in the time of this computer.
///
/// A message is delayed on its way to the host, by an unknown time that is never negative. So the least difference
/// between the host's time of receipt and the stamp is nearest to the difference of the clocks. It is taken over the
/// last two to four seconds of the monotonic clock, so that drift is followed, and a step of the system time moves no
/// stamp.
///
/// A clock is that of one subscription: an adapter that was restarted has none. Make another with the next one.
#[derive(Debug, Default)]
pub struct Clock {
    windows: Option<Windows>,
    /// The system time minus the monotonic clock, in nanoseconds. Two clocks cannot be read at once: the least difference
    /// counts, until one differs by a step.
    lead: Option<i64>,
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
    /// The host's time of a stamp, in a message that the host received at this time. Never later than that.
    pub fn host_time(&mut self, stamp: Stamp, received: HostTime) -> HostTime {
        let now = received.monotonic_ns;
        let micros = i64::try_from(stamp.0).unwrap_or(i64::MAX);
        let at = micros.saturating_mul(1_000);
        let difference = now.saturating_sub(at);
        // An adapter that was restarted counts from zero.
        let windows = match self.windows.take() {
            Some(windows) if windows.last <= stamp => windows,
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
        let monotonic_ns = at.saturating_add(windows.present.min(windows.before));
        HostTime {
            monotonic_ns,
            unix_ns: monotonic_ns.saturating_add(self.lead(received)),
        }
    }

    /// The system time minus the monotonic clock, as it is set at this time.
    fn lead(&mut self, received: HostTime) -> i64 {
        let now = received.unix_ns.saturating_sub(received.monotonic_ns);
        let lead = match self.lead {
            Some(lead) if now.abs_diff(lead) < LEAST_STEP_NS => lead.min(now),
            _ => now,
        };
        self.lead = Some(lead);
        lead
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const MS: i64 = 1_000_000;
    const EPOCH: i64 = 1_700_000_000_000_000_000;

    /// An instant, in milliseconds of the monotonic clock, and how far the system time is set ahead of it.
    fn instant(ms: i64, set: i64) -> HostTime {
        HostTime {
            monotonic_ns: ms * MS,
            unix_ns: EPOCH + (ms + set) * MS,
        }
    }

    /// The times of stamps in ms, each with the delay of its message in ms.
    fn mapped(clock: &mut Clock, messages: &[(i64, i64)]) -> Vec<i64> {
        let one = |&(at, delay): &(i64, i64)| {
            let stamp = Stamp(u64::try_from(at * 1_000).unwrap());
            let time = clock.host_time(stamp, instant(at + delay, 0));
            assert_eq!(time.unix_ns, EPOCH + time.monotonic_ns);
            time.monotonic_ns
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
        clock.host_time(Stamp(9_000_000), instant(0, 0));
        assert_eq!(clock.host_time(Stamp(1_000), instant(50, 0)), instant(50, 0));
    }

    #[test]
    fn distance_of_clock_readings_moves_no_stamp() {
        let mut clock = Clock::default();
        for (nth, late) in [0, 700, 20, 4_000].into_iter().enumerate() {
            let received = instant(5 * nth as i64, 0);
            let read = HostTime {
                unix_ns: received.unix_ns + late,
                ..received
            };
            let time = clock.host_time(Stamp(5_000 * nth as u64), read);
            assert_eq!(time, received);
        }
    }

    #[test]
    fn steps_of_the_system_time_move_no_stamp() {
        let mut clock = Clock::default();
        for (ms, set) in [
            (0, 0),
            (10, 0),
            (20, 3_600_000),
            (30, 3_600_000),
            (40, -500),
            (50, -500),
        ] {
            let stamp = Stamp(u64::try_from(ms * 1_000).unwrap());
            let time = clock.host_time(stamp, instant(ms + 1, set));
            assert_eq!(time, instant(ms + 1, set));
        }
    }

    /// Random numbers of up to 32 bits.
    struct Random(u64);

    impl Random {
        fn below(&mut self, limit: i64) -> i64 {
            self.0 = self.0.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            i64::try_from(self.0 >> 33).unwrap() % limit
        }
    }

    #[test]
    fn stamps_are_true_within_a_millisecond() {
        const POLLS: i64 = 200 * 600;
        let mut random = Random(1);
        let (mut clock, mut set, mut restarted) = (Clock::default(), 0, 0);
        let (mut received, mut far) = (0, 0);
        for poll in 0..POLLS {
            // The truth, in nanoseconds of the monotonic clock. Every two minutes the adapter is restarted, with a new
            // subscription, and every minute or so the system time is set.
            let truth = poll * 5 * MS;
            if poll % (200 * 120) == 0 {
                (clock, restarted) = (Clock::default(), truth);
            }
            if poll % (200 * 61) == 0 {
                set = random.below(7_200_000) - 3_600_000;
            }
            // The adapter's crystal is 50 ppm fast.
            let since = truth - restarted;
            let stamp = Stamp(u64::try_from((since + since / 20_000) / 1_000).unwrap());
            let delay = 200_000 + random.below(400_000);
            let delay = match random.below(100) {
                0 => delay + random.below(50 * MS),
                _ => delay,
            };
            // Messages arrive in their order.
            received = received.max(truth + delay);
            let receipt = HostTime {
                monotonic_ns: received,
                unix_ns: EPOCH + received + set * MS,
            };
            let time = clock.host_time(stamp, receipt);
            assert!(time.monotonic_ns <= received);
            let is_near = |time: i64, truth: i64| (time - truth).abs() <= MS;
            let near = is_near(time.monotonic_ns, truth) && is_near(time.unix_ns, EPOCH + truth + set * MS);
            far += i64::from(!near);
        }
        assert!(far * 1_000 <= POLLS, "{far} of {POLLS}");
    }

    #[test]
    fn both_clocks_of_now_go_on() {
        let (first, second) = (HostTime::now(), HostTime::now());
        assert!(first.monotonic_ns <= second.monotonic_ns);
        assert_eq!(second.at(first.monotonic_ns).monotonic_ns, first.monotonic_ns);
    }

    #[test]
    fn ros_time_has_seconds_and_nanoseconds() {
        assert_eq!(ros_time(EPOCH + 5), (1_700_000_000, 5));
    }
}
