//! The newest readings of an arm, which callers get without waiting.

use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::{Condvar, Mutex, PoisonError, RwLock};
use std::time::{Duration, Instant};

use super::{Counts, End, Reading, Stamping};
use crate::arm::pose::Pose;
use crate::error::no_pose::NoPose;
use crate::time::stamps::{HostTime, monotonic};
use crate::time::stopwatch::after;

/// Number of readings: two seconds at the highest rate.
const KEPT: u64 = 2_048;

/// The reason why a pose is missing.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) enum Missing {
    NoPose(NoPose),
    /// The port is lost, or the reader has ended.
    Ended(End),
}

/// A reading at its time.
#[derive(Clone, Copy, Debug)]
struct Sample<P> {
    pose: P,
    number: u64,
    time: HostTime,
    stamping: Stamping,
}

/// The last readings. One thread at a time adds to them.
///
/// Each is in a slot of its own, by its number. Only the oldest is overwritten: a caller that reads the newest meets no
/// writer, and never waits for one.
pub(super) struct History<P> {
    slots: Box<[RwLock<Option<Sample<P>>>]>,
    /// The number of the newest; 0 for none.
    newest: AtomicU64,
    lost: AtomicU64,
    missed: AtomicU64,
    /// The reason why there are no more readings.
    end: RwLock<Option<End>>,
    /// For callers that wait for the next one.
    gate: Mutex<()>,
    changed: Condvar,
}

impl<P: Pose> History<P> {
    pub(super) fn new() -> Self {
        Self {
            slots: (0..KEPT).map(|_| RwLock::new(None)).collect(),
            newest: AtomicU64::new(0),
            lost: AtomicU64::new(0),
            missed: AtomicU64::new(0),
            end: RwLock::new(None),
            gate: Mutex::new(()),
            changed: Condvar::new(),
        }
    }

    /// Adds a reading.
    pub(super) fn push(&self, pose: P, time: HostTime, stamping: Stamping) {
        let number = self.newest.load(Ordering::Acquire) + 1;
        let mut slot = self.slot(number).write().unwrap_or_else(PoisonError::into_inner);
        *slot = Some(Sample {
            pose,
            number,
            time,
            stamping,
        });
        drop(slot);
        self.newest.store(number, Ordering::Release);
        self.notify();
    }

    /// Counts readings without an answer.
    pub(super) fn add_lost(&self, lost: u64) {
        self.lost.fetch_add(lost, Ordering::Relaxed);
    }

    /// Counts readings that were not begun at their time.
    pub(super) fn add_missed(&self, missed: u64) {
        self.missed.fetch_add(missed, Ordering::Relaxed);
    }

    /// There are no more readings, for this reason, or there are again.
    pub(super) fn set_end(&self, reason: Option<End>) {
        *self.end.write().unwrap_or_else(PoisonError::into_inner) = reason;
        self.notify();
    }

    pub(super) fn counts(&self) -> Counts {
        Counts {
            samples: self.newest.load(Ordering::Acquire),
            lost: self.lost.load(Ordering::Relaxed),
            missed: self.missed.load(Ordering::Relaxed),
        }
    }

    /// The newest reading, if it is at most this old at this time of the monotonic clock.
    pub(super) fn latest(&self, now: i64, limit: Duration) -> Result<Reading<P>, Missing> {
        let reading = self.newest(now)?;
        match reading.age {
            age if age > limit => Err(Missing::NoPose(NoPose::Stale { age, limit })),
            _ => Ok(reading),
        }
    }

    /// The pose at this time of the monotonic clock, between two readings at most `limit` apart.
    pub(super) fn at(&self, monotonic_ns: i64, now: i64, limit: Duration) -> Result<Reading<P>, Missing> {
        let mut later = self.newest(now)?;
        if later.time.monotonic_ns < monotonic_ns {
            let ahead = nanos(monotonic_ns - later.time.monotonic_ns);
            return Err(Missing::NoPose(NoPose::After { ahead }));
        }
        loop {
            if later.time.monotonic_ns == monotonic_ns {
                return Ok(later);
            }
            let Some(earlier) = self.get(later.number - 1, now) else {
                let before = nanos(later.time.monotonic_ns - monotonic_ns);
                return Err(Missing::NoPose(NoPose::Before { before }));
            };
            if earlier.time.monotonic_ns <= monotonic_ns {
                return between(&earlier, &later, monotonic_ns, now, limit);
            }
            later = earlier;
        }
    }

    /// The next reading after this number, of those that are kept, within this time.
    pub(super) fn next_after(&self, number: u64, wait: Duration) -> Result<Option<Reading<P>>, Missing> {
        let until = after(wait);
        let mut gate = self.gate.lock().unwrap_or_else(PoisonError::into_inner);
        loop {
            let newest = self.newest.load(Ordering::Acquire);
            if newest > number {
                // The oldest may be overwritten meanwhile.
                let oldest = (newest + 2).saturating_sub(KEPT).max(number + 1);
                let now = monotonic();
                if let Some(reading) = (oldest..=newest).find_map(|number| self.get(number, now)) {
                    return Ok(Some(reading));
                }
                continue;
            }
            if let Some(reason) = self.end() {
                return Err(Missing::Ended(reason));
            }
            let left = until.saturating_duration_since(Instant::now());
            if left.is_zero() {
                return Ok(None);
            }
            let woken = self.changed.wait_timeout(gate, left);
            (gate, _) = woken.unwrap_or_else(PoisonError::into_inner);
        }
    }

    fn end(&self) -> Option<End> {
        self.end.read().unwrap_or_else(PoisonError::into_inner).clone()
    }

    /// The newest reading. After the end, which is newer, there is none.
    fn newest(&self, now: i64) -> Result<Reading<P>, Missing> {
        if let Some(end) = self.end() {
            return Err(Missing::Ended(end));
        }
        loop {
            let number = self.newest.load(Ordering::Acquire);
            match self.get(number, now) {
                Some(reading) => return Ok(reading),
                None if number == 0 => return Err(Missing::NoPose(NoPose::NotYet)),
                // All other slots were written since.
                None => {}
            }
        }
    }

    /// The reading with this number, unless it is not kept any more.
    fn get(&self, number: u64, now: i64) -> Option<Reading<P>> {
        let slot = self.slot(number).try_read().ok()?;
        slot.filter(|sample| sample.number == number)
            .map(|sample| sample.reading(now))
    }

    fn slot(&self, number: u64) -> &RwLock<Option<Sample<P>>> {
        &self.slots[(number % KEPT) as usize]
    }

    /// Wakes the callers that wait. The lock makes them wait or see what is new.
    fn notify(&self) {
        drop(self.gate.lock().unwrap_or_else(PoisonError::into_inner));
        self.changed.notify_all();
    }
}

impl<P> Sample<P> {
    fn reading(self, now: i64) -> Reading<P> {
        Reading {
            pose: self.pose,
            number: self.number,
            time: self.time,
            stamping: self.stamping,
            age: nanos(now - self.time.monotonic_ns),
        }
    }
}

/// The pose between two readings.
fn between<P: Pose>(
    earlier: &Reading<P>,
    later: &Reading<P>,
    monotonic_ns: i64,
    now: i64,
    limit: Duration,
) -> Result<Reading<P>, Missing> {
    let span = later.time.monotonic_ns - earlier.time.monotonic_ns;
    let gap = nanos(span);
    if gap > limit {
        return Err(Missing::NoPose(NoPose::Gap { gap, limit }));
    }
    let fraction = (monotonic_ns - earlier.time.monotonic_ns) as f64 / span as f64;
    let stamping = match (earlier.stamping, later.stamping) {
        (Stamping::Adapter, Stamping::Adapter) => Stamping::Adapter,
        _ => Stamping::Receipt,
    };
    Ok(Reading {
        pose: earlier.pose.between(&later.pose, fraction),
        number: earlier.number,
        time: later.time.at(monotonic_ns),
        stamping,
        age: nanos(now - monotonic_ns),
    })
}

/// A duration, zero if negative.
fn nanos(nanos: i64) -> Duration {
    Duration::from_nanos(nanos.try_into().unwrap_or(0))
}

#[cfg(test)]
mod tests {
    use armwire::ling::{JointState, MotionStatus};

    use super::*;

    const MS: i64 = 1_000_000;
    const LIMIT: Duration = Duration::from_millis(100);

    fn time(ms: i64) -> HostTime {
        HostTime {
            monotonic_ns: ms * MS,
            unix_ns: 1_700_000_000_000_000_000 + ms * MS,
        }
    }

    fn pose(ticks: u16) -> JointState {
        JointState {
            joints: [ticks; 6],
            gripper: ticks / 4,
            status: MotionStatus::Locked,
        }
    }

    /// The readings of these times in ms, with the ticks.
    fn history(samples: &[(i64, u16)]) -> History<JointState> {
        let history = History::new();
        for &(ms, ticks) in samples {
            history.push(pose(ticks), time(ms), Stamping::Adapter);
        }
        history
    }

    #[test]
    fn newest_reading_has_its_time_and_age() {
        let reading = history(&[(10, 1_000), (20, 1_100)]).latest(25 * MS, LIMIT).unwrap();
        assert_eq!((reading.pose, reading.number), (pose(1_100), 2));
        assert_eq!((reading.time, reading.age), (time(20), Duration::from_millis(5)));
        assert_eq!(reading.stamping, Stamping::Adapter);
    }

    #[test]
    fn stale_reading_is_an_error() {
        let history = history(&[(0, 1_000)]);
        assert!(history.latest(100 * MS, LIMIT).is_ok());
        let stale = history.latest(101 * MS, LIMIT).unwrap_err();
        let age = Duration::from_millis(101);
        assert_eq!(stale, Missing::NoPose(NoPose::Stale { age, limit: LIMIT }));
    }

    #[test]
    fn no_reading_is_an_error() {
        let history = history(&[]);
        assert_eq!(history.latest(0, LIMIT).unwrap_err(), Missing::NoPose(NoPose::NotYet));
        assert_eq!(history.at(0, 0, LIMIT).unwrap_err(), Missing::NoPose(NoPose::NotYet));
        assert_eq!(
            history.next_after(0, Duration::ZERO).unwrap().map(|next| next.number),
            None
        );
    }

    #[test]
    fn pose_between_readings_is_linear() {
        let history = history(&[(10, 1_000), (20, 2_000), (40, 1_000)]);
        let at = |ms: i64| {
            history
                .at(ms * MS, 50 * MS, LIMIT)
                .map(|reading| reading.pose.joints[5])
        };
        let ticks = [10, 11, 15, 20, 30, 39, 40].map(|ms| at(ms).unwrap());
        assert_eq!(ticks, [1_000, 1_100, 1_500, 2_000, 1_500, 1_050, 1_000]);
        let reading = history.at(15 * MS, 50 * MS, LIMIT).unwrap();
        assert_eq!((reading.time, reading.age), (time(15), Duration::from_millis(35)));
        assert_eq!(reading.pose.gripper, 375);
    }

    #[test]
    fn pose_outside_of_readings_is_never_guessed() {
        let history = history(&[(10, 1_000), (20, 2_000)]);
        let at = |ms: i64| history.at(ms * MS, 50 * MS, LIMIT).unwrap_err();
        let (before, ahead) = (Duration::from_millis(1), Duration::from_millis(2));
        assert_eq!(at(9), Missing::NoPose(NoPose::Before { before }));
        assert_eq!(at(22), Missing::NoPose(NoPose::After { ahead }));
    }

    #[test]
    fn pose_in_a_long_gap_is_an_error() {
        let history = history(&[(0, 1_000), (101, 2_000), (111, 2_000)]);
        let gap = Duration::from_millis(101);
        let error = history.at(50 * MS, 120 * MS, LIMIT).unwrap_err();
        assert_eq!(error, Missing::NoPose(NoPose::Gap { gap, limit: LIMIT }));
        assert!(history.at(105 * MS, 120 * MS, LIMIT).is_ok());
    }

    #[test]
    fn old_readings_make_room() {
        let history = history(&[]);
        for ms in 0..3_000 {
            history.push(pose(2_048), time(ms), Stamping::Receipt);
        }
        assert!(history.at(2_000 * MS, 3_000 * MS, LIMIT).is_ok());
        assert!(matches!(
            history.at(500 * MS, 3_000 * MS, LIMIT),
            Err(Missing::NoPose(NoPose::Before { .. }))
        ));
        let first = history.next_after(0, Duration::ZERO).unwrap().unwrap();
        assert_eq!(first.number, 3_000 - KEPT + 2);
        let all = std::iter::successors(Some(first), |reading| {
            history.next_after(reading.number, Duration::ZERO).unwrap()
        });
        assert!(all.map(|reading| reading.number).eq(first.number..=3_000));
    }

    #[test]
    fn end_of_readings_is_the_reason() {
        let history = history(&[(0, 1_000)]);
        history.set_end(Some(End::Closed));
        let ended = Missing::Ended(End::Closed);
        assert_eq!(history.latest(10 * MS, LIMIT).unwrap_err(), ended);
        assert_eq!(history.at(0, 10 * MS, LIMIT).unwrap_err(), ended);
        assert_eq!(history.next_after(0, Duration::MAX).unwrap().unwrap().number, 1);
        assert_eq!(history.next_after(1, Duration::MAX).unwrap_err(), ended);
    }
}
