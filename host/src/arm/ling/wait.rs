//! Waits for an arm, one reading at a time: between two readings of a [`Shared`] arm other calls have their turn.

use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
use armwire::ling::effect::{Effect, Outcome, Output};
use armwire::ling::{JointState, Move, ReadBack, Request};

use super::Ling;
use crate::arm::shared::Shared;
use crate::arm::stop;
use crate::error::{Error, TorqueOffEffect};
use crate::time::stopwatch::Stopwatch;

/// Time between two readings.
pub(super) const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The readings of an arm in motion, one at a time. A missing or unacceptable answer costs one reading.
#[derive(Debug, Default)]
pub struct MotionReadings {
    /// The time since which no answer came.
    silent_since: Option<Instant>,
}

impl MotionReadings {
    /// Reads once. `None` without an acceptable answer: read again, after 20 ms. An arm that was not moved is read as by
    /// [`Ling::read_joints`]: it may be moved by hand.
    ///
    /// # Errors
    ///
    /// [`Error::TorqueOff`] if the torque went off after a move. [`Error::Unanswered`] after [`Ling::SILENCE`] without an
    /// answer: the arm was asked to stop, as by [`Ling::stop`]. Errors of the line that do not pass.
    pub fn read(&mut self, arm: &mut Ling) -> Result<Option<JointState>, Error> {
        let Some(gripper) = arm.gripper else {
            return arm.read_joints().map(Some);
        };
        let begun = Instant::now();
        match arm.read_joints() {
            Ok(state) if arm.may_move => {
                self.silent_since = None;
                Ok(Some(state))
            }
            Ok(state) => Err(arm.without_torque(&state, TorqueOffEffect::MotionEnded)),
            Err(error) => {
                let cause = stop::passing(error)?;
                let since = *self.silent_since.get_or_insert(begun);
                match since.elapsed() >= Ling::SILENCE {
                    true => Err(arm.unanswered(cause, gripper)),
                    false => arm.link.check_interrupt().map(|()| None),
                }
            }
        }
    }
}

/// The wait for the end of a move.
struct Wait {
    target: Move,
    limit: Duration,
    clock: Stopwatch,
    arrival: Arrival,
    readings: MotionReadings,
}

impl Wait {
    /// The wait for this move, which was just sent.
    fn new(target: &Move, limit: Duration) -> Self {
        Self {
            target: *target,
            limit,
            clock: Stopwatch::start(),
            arrival: Arrival::new(*target, Tolerances::MOVE),
            readings: MotionReadings::default(),
        }
    }

    /// Reads once. Returns the state at the target. An interrupt stops the arm.
    fn read(&mut self, arm: &mut Ling) -> Result<Option<JointState>, Error> {
        let read = arm.link.check_interrupt().and_then(|()| self.readings.read(arm));
        let (gripper, _speed) = self.target.gripper;
        let Some(state) = arm.unless_interrupted(gripper, read)? else {
            return Ok(None);
        };
        match self.arrival.on_joints(self.clock.now(), &state) {
            Arrived::AtTarget | Arrived::GripperStandsStill(_) => Ok(Some(state)),
            Arrived::NotYet(away) if self.clock.0.elapsed() >= self.limit => Err(Error::NotReached {
                name: arm.name().into(),
                state,
                away,
                limit: self.limit,
            }),
            Arrived::NotYet(_) => Ok(None),
        }
    }
}

/// A request whose effect is read back.
#[derive(Debug)]
pub struct Switching {
    effect: Effect,
    clock: Stopwatch,
    read_back: ReadBack,
}

impl Switching {
    /// The request that has this effect, from now on.
    pub fn new(effect: Effect) -> Self {
        Self {
            effect,
            clock: Stopwatch::start(),
            read_back: ReadBack::new(effect),
        }
    }

    /// Sends the request, or reads once. `None` while the effect is undecided: call it again, after 20 ms.
    ///
    /// # Errors
    ///
    /// [`Error::NoEffect`] if the arm shows for 0.5 s that the request has no effect; errors of a read.
    pub fn step(&mut self, arm: &mut Ling) -> Result<Option<Outcome>, Error> {
        loop {
            match self.read_back.poll(self.clock.now()) {
                Output::Request(Request::ReadJoints) => {
                    let state = arm.read_joints()?;
                    self.read_back.on_joints(self.clock.now(), &state);
                }
                Output::Request(_) => arm.send(self.effect)?,
                Output::Wait(_) => return arm.link.check_interrupt().map(|()| None),
                Output::Done(result) => {
                    let name = arm.name();
                    return result.map(Some).map_err(|cause| Error::NoEffect {
                        name: name.into(),
                        cause,
                    });
                }
            }
        }
    }
}

impl Ling {
    /// Moves the arm, and waits until the joints and the gripper have [reached](Move::is_reached_by) the target, or until
    /// the gripper has stood still for 1 s, for example at an object. The [interrupt](Self::set_interrupt) stops the arm.
    ///
    /// # Errors
    ///
    /// [`Error::NotReached`] at the first reading after `limit`: the arm may move on. [`Error::Stopped`] after an interrupt.
    /// [`Error::TorqueOff`] if the torque is off, or goes off. [`Error::Unanswered`] if the arm falls silent, as in
    /// [`MotionReadings::read`]: it was asked to stop.
    pub fn move_and_wait(&mut self, target: &Move, limit: Duration) -> Result<JointState, Error> {
        self.begin_move(target)?;
        let mut wait = Wait::new(target, limit);
        until(|| wait.read(self))
    }

    /// Makes the request that has this effect, and reads it back.
    pub(super) fn switch(&mut self, effect: Effect) -> Result<Outcome, Error> {
        let mut switching = Switching::new(effect);
        until(|| switching.step(self))
    }

    fn begin_move(&mut self, target: &Move) -> Result<(), Error> {
        let (gripper, _speed) = target.gripper;
        self.stop_if_interrupted(gripper, |arm| arm.move_to(target))
    }
}

impl Shared<Ling> {
    /// Moves the arm and waits, as [`Ling::move_and_wait`]. Other calls have their turn between two readings of the wait: a
    /// stop of another thread takes effect at once, and the wait goes on.
    ///
    /// # Errors
    ///
    /// As of [`Ling::move_and_wait`].
    pub fn move_and_wait(&self, target: &Move, limit: Duration) -> Result<JointState, Error> {
        self.call(|arm| arm.begin_move(target))?;
        let mut wait = Wait::new(target, limit);
        until(|| self.read(|arm| wait.read(arm)))
    }
}

/// Repeats a reading until it decides.
fn until<T>(mut read: impl FnMut() -> Result<Option<T>, Error>) -> Result<T, Error> {
    loop {
        if let Some(decided) = read()? {
            return Ok(decided);
        }
        thread::sleep(POLL_PERIOD);
    }
}

#[cfg(test)]
mod tests {
    use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
    use std::sync::{Arc, OnceLock, mpsc};

    use armwire::ling::{GripperSpeed, JOINTS, Ling as Protocol, MotionStatus, Opening, Position, Response, Speed};
    use armwire::messages::Messages;

    use super::*;
    use crate::error::text::Text;
    use crate::ports::line::{Line, Names, Reception};

    /// The number of the request in which a call of another thread begins.
    const CALLED: usize = 4;

    /// An arm that arrives when it is told to.
    #[derive(Default)]
    struct Moving {
        arm: OnceLock<Shared<Ling>>,
        requests: AtomicUsize,
        has_arrived: AtomicBool,
    }

    /// Its line.
    struct Wire {
        moving: Arc<Moving>,
        is_called: mpsc::Sender<()>,
        is_asked: bool,
    }

    impl Line for Wire {
        fn name(&self) -> &str {
            "fake"
        }

        fn read(&mut self, buf: &mut [u8], _: Duration) -> Result<usize, Error> {
            let joints = match self.moving.has_arrived.load(Ordering::Relaxed) {
                true => [2_100; JOINTS],
                false => [2_048; JOINTS],
            };
            let response = Response::Joints(JointState {
                joints,
                gripper: 500,
                status: MotionStatus::Locked,
            });
            match std::mem::take(&mut self.is_asked) {
                true => Ok(Protocol.encode_response(&response, None, buf).unwrap()),
                false => Ok(0),
            }
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            self.is_asked = true;
            if self.moving.requests.fetch_add(1, Ordering::Relaxed) + 1 == CALLED {
                self.is_called.send(()).unwrap();
                let arm = self.moving.arm.get().unwrap();
                // Until the other thread waits for the arm.
                while !arm.is_awaited() {
                    thread::yield_now();
                }
            }
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    #[test]
    fn call_has_its_turn_within_a_wait() {
        let moving = Arc::new(Moving::default());
        let (sender, is_called) = mpsc::channel();
        let arm = super::super::tests::ling(Box::new(Wire {
            moving: Arc::clone(&moving),
            is_called: sender,
            is_asked: false,
        }));
        let shared = Shared::new("fake", arm);
        assert!(moving.arm.set(shared.clone()).is_ok());
        let target = Move {
            joints: [(Position::new(2_100).unwrap(), Speed::MAX); JOINTS],
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1_000)),
        };
        let mover = shared.clone();
        let wait = thread::spawn(move || mover.move_and_wait(&target, Duration::from_secs(5)));
        is_called.recv().unwrap();
        let requests = shared.call(|_| {
            moving.has_arrived.store(true, Ordering::Relaxed);
            Ok::<_, Error>(moving.requests.load(Ordering::Relaxed))
        });
        assert_eq!(requests.unwrap(), CALLED, "no reading comes before it");
        assert_eq!(
            wait.join().unwrap().unwrap().joints,
            [2_100; JOINTS],
            "the wait goes on"
        );
    }
}
