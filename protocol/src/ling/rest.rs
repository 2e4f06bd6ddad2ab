//! The rest of an arm, from its readings.

use super::JOINTS;
use crate::time::{Duration, Instant};

/// The time for which an arm has been at rest. Readings go in.
///
/// The readings of one time of rest lie within [`Rest::TOLERANCE`] of each other, with [`Rest::LARGEST_GAP`] between two
/// of them at most. A servo holds a load by its error: an arm at rest is not always at its goal.
#[derive(Clone, Copy, Debug, Default)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
pub struct Rest {
    window: Option<Window>,
}

/// Readings that lie close to each other.
#[derive(Clone, Copy, Debug)]
#[cfg_attr(feature = "defmt", derive(defmt::Format))]
struct Window {
    /// The times of the first and of the last reading.
    first: Instant,
    last: Instant,
    /// The bounds of the joints, in ticks.
    low: [u16; JOINTS],
    high: [u16; JOINTS],
}

impl Rest {
    /// The distance between the readings of a joint at rest, in ticks: 0.26°. A reading's noise is less.
    pub const TOLERANCE: u16 = 3;
    /// An arm that was at rest for this time stays there. It is longer than the turn of a servo that overshoots.
    pub const TIME: Duration = Duration::from_millis(200);
    /// The largest time between two readings. In a longer one an arm may leave, and return. It is longer than the time
    /// in which a host notices that an answer is lost.
    pub const LARGEST_GAP: Duration = Duration::from_millis(150);

    /// The rest of an arm without readings.
    pub const fn new() -> Self {
        Self { window: None }
    }

    /// Takes a reading of the joints that arrived at `now`. Returns how long they have been at rest.
    ///
    /// # Errors
    ///
    /// The joint that moved since the reading before, from 1.
    pub fn on_joints(&mut self, now: Instant, joints: &[u16; JOINTS]) -> Result<Duration, u8> {
        let new = Window {
            first: now,
            last: now,
            low: *joints,
            high: *joints,
        };
        let window = self.window.get_or_insert(new);
        if now.since(window.last) > Self::LARGEST_GAP {
            *window = new;
        }
        window.last = now;
        let bounds = window.low.iter_mut().zip(&mut window.high).zip(joints);
        for (joint, ((low, high), at)) in (1..).zip(bounds) {
            (*low, *high) = ((*low).min(*at), (*high).max(*at));
            if *high - *low > Self::TOLERANCE {
                *window = new;
                return Err(joint);
            }
        }
        Ok(now.since(window.first))
    }
}
