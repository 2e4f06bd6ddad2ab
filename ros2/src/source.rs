//! Where an arm's readings come from: the polls of its adapter, or its own stream. No wait is longer than a step.

use std::time::{Duration, Instant};

use armwire::ling::{JointState, Ling, Response};
use armwire::messages::Messages;
use armwire_bridge::control::Event;
use armwire_host::stamps::{self, Clock, HostTime};
use armwire_host::{Adapter, Error, Stream};

/// Maximum wait for a reading before setpoints and requests have their turn.
pub(crate) const STEP: Duration = Duration::from_millis(5);

/// What came within a step.
pub(crate) enum Input {
    /// A reading, and its system time in nanoseconds since 1970.
    Reading(i64, JointState),
    /// An event of the adapter that is no frame.
    Event(Event),
}

/// The source of an arm's readings.
pub(crate) enum Source {
    /// An adapter that polls the arm.
    Adapter(Adapter, Clock),
    /// The arm itself: the time of the next request, and the time between two.
    Arm { due: Instant, period: Duration },
}

impl Source {
    /// What has come, after a wait of at most a step.
    ///
    /// # Errors
    ///
    /// The line or the control port fails. A lost answer is no error.
    pub(crate) fn receive(&mut self, stream: &mut Stream) -> Result<Vec<Input>, Error> {
        match self {
            Self::Adapter(adapter, clock) => {
                let Some((stamp, event)) = adapter.next_event(STEP)? else {
                    return Ok(Vec::new());
                };
                let Event::Frame { bytes, .. } = event else {
                    return Ok(vec![Input::Event(event)]);
                };
                let Ok(Response::Joints(state)) = Ling.parse_response(&bytes, ()) else {
                    return Ok(Vec::new());
                };
                stream.on_joints(&state);
                let at = clock.host_time(stamp, HostTime::now()).unix_ns;
                Ok(vec![Input::Reading(at, state)])
            }
            Self::Arm { due, period } => {
                let now = Instant::now();
                if now >= *due {
                    stream.request_joints()?;
                    *due = (*due + *period).max(now);
                }
                let readings = stream.receive(due.saturating_duration_since(now).min(STEP))?;
                let reading = |state| Input::Reading(stamps::now(), state);
                Ok(readings.into_iter().map(reading).collect())
            }
        }
    }

    /// The adapter; `None` without one.
    pub(crate) fn adapter(&mut self) -> Option<&mut Adapter> {
        match self {
            Self::Adapter(adapter, _) => Some(adapter),
            Self::Arm { .. } => None,
        }
    }
}

#[cfg(all(test, unix))]
#[path = "../../host/tests/virtual_arm/mod.rs"]
#[allow(dead_code, reason = "the tests of the library use the rest")]
mod virtual_arm;

#[cfg(all(test, unix))]
mod tests {
    use std::sync::atomic::Ordering;

    use armwire::ling::{GripperSpeed, Move, Opening, Position, Speed};

    use super::virtual_arm::{JOINTS_ANSWER, with_own_arm};
    use super::*;

    /// The time between two readings.
    const PERIOD: Duration = Duration::from_millis(10);

    /// A setpoint per period is late by less than this, whatever the arm answers.
    #[test]
    fn lost_answers_do_not_hold_setpoints_up() {
        with_own_arm(|mut arm, lost| {
            arm.read_joints().unwrap();
            let mut stream = arm.into_stream();
            let due = Instant::now();
            let mut source = Source::Arm { due, period: PERIOD };
            let target = Move {
                joints: [(Position::CENTRE, Speed::SLOWEST); 6],
                gripper: (Opening::CLOSED, GripperSpeed(1000)),
            };
            let (mut worst, mut sent, mut readings) = (Duration::ZERO, Instant::now(), 0);
            for nth in 0..400 {
                if [50, 51, 100, 150].contains(&nth) {
                    lost.store(JOINTS_ANSWER, Ordering::Relaxed);
                }
                readings += source.receive(&mut stream).unwrap().len();
                if sent.elapsed() >= PERIOD {
                    stream.move_to(&target).unwrap();
                    worst = worst.max(sent.elapsed());
                    sent = Instant::now();
                }
            }
            println!("worst time between two setpoints: {worst:?}, {readings} readings");
            assert!(worst < Duration::from_millis(60), "{worst:?}");
        });
    }
}
