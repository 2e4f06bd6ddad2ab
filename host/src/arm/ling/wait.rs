//! Waits for an arm, one reading at a time: between two readings of a [`Shared`] arm other calls have their turn.

use std::thread;
use std::time::{Duration, Instant};

use armwire::ling::arrival::{Arrival, Arrived, Tolerances};
use armwire::ling::effect::{Effect, EffectError, Outcome, Output};
use armwire::ling::{GripperSpeed, JOINTS, JointState, Move, Opening, Position, ReadBack, Request, Speed, Torque};

use super::Ling;
use crate::arm::shared::Shared;
use crate::arm::stop;
use crate::error::{Error, TorqueOffEffect};
use crate::ports::interrupt;
use crate::time::stopwatch::Stopwatch;

/// Time between two readings.
pub(super) const POLL_PERIOD: Duration = Duration::from_millis(20);

/// The readings of an arm in motion, one at a time. A missing or unacceptable answer costs one reading.
#[derive(Debug, Default)]
pub struct MotionReadings {
    /// The gripper's goal in the last move that is known here. Another call may switch the torque off between two
    /// readings: the arm forgets the goal then.
    gripper: Option<Opening>,
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
        self.gripper = arm.gripper.or(self.gripper);
        let Some(gripper) = self.gripper else {
            return arm.read_joints().map(Some);
        };
        let begun = Instant::now();
        match arm.read_joints() {
            Ok(state) if state.status.is_torque_off() => Err(arm.without_torque(&state, TorqueOffEffect::MotionEnded)),
            Ok(state) => {
                self.silent_since = None;
                Ok(Some(state))
            }
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

/// A wait for the arm at a target, one reading at a time.
#[derive(Debug)]
pub struct Wait {
    /// The arm was moved there. Otherwise something else may move it yet.
    is_led: bool,
    limit: Duration,
    clock: Stopwatch,
    arrival: Arrival,
    readings: MotionReadings,
}

impl Wait {
    /// The wait of this arm for a target, from now on, for this time. Its last move there is sent once more if it is lost.
    pub fn new(arm: &Ling, target: &Move, tolerances: Tolerances, limit: Duration) -> Self {
        Self {
            is_led: arm.target.as_ref() == Some(target),
            limit,
            clock: Stopwatch::start(),
            arrival: Arrival::new(*target, tolerances),
            readings: MotionReadings {
                gripper: arm.gripper,
                ..MotionReadings::default()
            },
        }
    }

    /// The wait of this arm for its joints, within this distance in ticks. If no move leads there, something else may.
    pub fn for_joints(arm: &Ling, joints: [Position; JOINTS], within: u16, limit: Duration) -> Self {
        let leads_there = |target: &&Move| target.joints.map(|(position, _)| position) == joints;
        let target = arm.target.as_ref().filter(leads_there).copied().unwrap_or(Move {
            joints: joints.map(|position| (position, Speed::MAX)),
            gripper: (Opening::CLOSED, GripperSpeed::DEFAULT),
        });
        let tolerances = Tolerances {
            gripper: None,
            ..Tolerances::within(within)
        };
        Self::new(arm, &target, tolerances, limit)
    }

    /// The time for which other calls may delay the next reading, which checks the interrupt and the limit.
    fn patience(&self) -> Duration {
        interrupt::PERIOD.min(self.limit.saturating_sub(self.clock.0.elapsed()))
    }

    /// Reads once. Returns the state at the target, and `None` before: read again, after 20 ms.
    ///
    /// # Errors
    ///
    /// [`Error::NotReached`] at rest elsewhere, and at the first reading after the limit; errors of
    /// [`MotionReadings::read`].
    pub fn read(&mut self, arm: &mut Ling) -> Result<Option<JointState>, Error> {
        let Some(state) = self.readings.read(arm)? else {
            return Ok(None);
        };
        let not_reached = |arm: &Ling, limit, away| Error::NotReached {
            name: arm.name().into(),
            state,
            limit,
            away,
        };
        match self.arrival.on_joints(self.clock.now(), &state) {
            Arrived::AtTarget(_) | Arrived::GripperStandsStill(_) => Ok(Some(state)),
            Arrived::Elsewhere(away) if self.is_led => {
                // An adapter that refuses motion is the reason.
                arm.check_refusal()?;
                Err(not_reached(arm, None, Some(away)))
            }
            _ if self.clock.0.elapsed() >= self.limit => {
                Err(not_reached(arm, Some(self.limit), self.arrival.away(&state)))
            }
            // An arm that was stopped meanwhile has another goal.
            Arrived::Resend if arm.target.as_ref() == Some(self.arrival.target()) => {
                arm.start(self.arrival.target()).map(|()| None)
            }
            Arrived::NotYet(_) | Arrived::Resend if self.is_led => arm.check_refusal_in_wait().map(|()| None),
            Arrived::NotYet(_) | Arrived::Resend | Arrived::Elsewhere(_) => Ok(None),
        }
    }

    /// As [`read`](Self::read), but an interrupt stops the arm.
    fn read_interruptibly(&mut self, arm: &mut Ling) -> Result<Option<JointState>, Error> {
        let read = arm.link.check_interrupt().and_then(|()| self.read(arm));
        let (gripper, _speed) = self.arrival.target().gripper;
        arm.unless_interrupted(gripper, read)
    }
}

/// A request whose effect is read back.
#[derive(Debug)]
pub struct Switching {
    effect: Effect,
    clock: Stopwatch,
    read_back: ReadBack,
    /// The last missing answer.
    missing: Option<Error>,
}

impl Switching {
    /// The request that has this effect, from now on.
    pub fn new(effect: Effect) -> Self {
        Self {
            effect,
            clock: Stopwatch::start(),
            read_back: ReadBack::new(effect),
            missing: None,
        }
    }

    /// Sends the request, or reads once. `None` while the effect is undecided: call it again, after 20 ms.
    ///
    /// # Errors
    ///
    /// [`Error::NoEffect`] if the arm shows for 0.5 s that the request has no effect, or gives no acceptable answer;
    /// [`Error::NoAnswer`] if it gives none. Errors of the line that do not pass.
    pub fn step(&mut self, arm: &mut Ling) -> Result<Option<Outcome>, Error> {
        loop {
            match self.read_back.poll(self.clock.now()) {
                Output::Request(Request::ReadJoints) => {
                    match arm.read_joints() {
                        Ok(state) => self.read_back.on_joints(self.clock.now(), &state),
                        Err(error @ Error::NoAnswer { .. }) => self.missing = Some(error),
                        Err(error) => {
                            stop::passing(error)?;
                        }
                    }
                    // Other calls have their turn, also if the next reading is due.
                    if self.read_back.result().is_none() {
                        return arm.link.check_interrupt().map(|()| None);
                    }
                }
                Output::Request(_) => arm.send_to_own(self.effect)?,
                Output::Wait(_) => return arm.link.check_interrupt().map(|()| None),
                Output::Done(Ok(outcome)) => return Ok(Some(outcome)),
                Output::Done(Err(cause)) => return Err(self.no_effect(arm.name(), cause)),
            }
        }
    }

    /// The error of an arm at `name`. A silent one keeps the hint of its missing answer.
    fn no_effect(&mut self, name: &str, cause: EffectError) -> Error {
        match (cause, self.missing.take()) {
            (
                EffectError::NoReading(_),
                Some(Error::NoAnswer {
                    name,
                    cause: silence,
                    hint,
                    missing,
                    bytes,
                }),
            ) => Error::NoAnswer {
                name,
                cause: format!("{cause}: {silence}").into(),
                hint,
                missing,
                bytes,
            },
            (cause, _) => Error::NoEffect {
                name: name.into(),
                cause,
            },
        }
    }
}

impl Ling {
    /// Moves the arm, and waits for its [`Arrival`] at the target within these tolerances, or until the gripper has stood
    /// still for 1 s, for example at an object. The [interrupt](Self::set_interrupt) stops the arm.
    ///
    /// # Errors
    ///
    /// [`Error::NotReached`] as soon as the arm is at rest elsewhere, and at the first reading after `limit`: it may move on
    /// then. [`Error::Stopped`] after an interrupt. [`Error::TorqueOff`] if the torque is off, or goes off.
    /// [`Error::Unanswered`] if the arm falls silent, as in [`MotionReadings::read`]: it was asked to stop.
    /// [`Error::MotionRefused`] as of [`check_refusal`](Self::check_refusal): before the move, or within a second if the
    /// adapter is told to stop the arm.
    pub fn move_and_wait(
        &mut self,
        target: &Move,
        tolerances: Tolerances,
        limit: Duration,
    ) -> Result<JointState, Error> {
        self.begin_move(target)?;
        let mut wait = Wait::new(self, target, tolerances, limit);
        until(|| wait.read_interruptibly(self))
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
    /// stop of another thread takes effect at once, and the wait ends at rest there.
    ///
    /// # Errors
    ///
    /// As of [`Ling::move_and_wait`].
    pub fn move_and_wait(&self, target: &Move, tolerances: Tolerances, limit: Duration) -> Result<JointState, Error> {
        let mut wait = self.call(|arm| {
            arm.begin_move(target)?;
            Ok(Wait::new(arm, target, tolerances, limit))
        })?;
        until(|| self.read_within(wait.patience(), |arm| wait.read_interruptibly(arm)))
    }

    /// Switches the torque, as [`Ling::set_torque`]. Other calls have their turn between two readings.
    ///
    /// # Errors
    ///
    /// As of [`Ling::set_torque`].
    pub fn set_torque(&self, torque: Torque) -> Result<Outcome, Error> {
        self.switch(Effect::Torque(torque))
    }

    /// Makes the present pose the zero position, as [`Ling::set_zero`]. Other calls have their turn between two readings.
    ///
    /// # Errors
    ///
    /// As of [`Ling::set_zero`].
    pub fn set_zero(&self) -> Result<Outcome, Error> {
        self.switch(Effect::Zero)
    }

    fn switch(&self, effect: Effect) -> Result<Outcome, Error> {
        let mut switching = Switching::new(effect);
        until(|| match switching.read_back.is_sent() {
            // The request is a call itself, ahead of readers.
            false => self.call(|arm| switching.step(arm)),
            true => self.read_within(interrupt::PERIOD, |arm| switching.step(arm)),
        })
    }
}

/// Repeats a reading until it decides.
pub(super) fn until<T>(mut read: impl FnMut() -> Result<Option<T>, Error>) -> Result<T, Error> {
    loop {
        if let Some(decided) = read()? {
            return Ok(decided);
        }
        thread::sleep(POLL_PERIOD);
    }
}

#[cfg(test)]
mod tests {
    use std::ops::Range;
    use std::sync::atomic::{AtomicBool, Ordering};
    use std::sync::{Arc, Mutex, OnceLock, PoisonError, mpsc};

    use armwire::ling::{GripperSpeed, JOINTS, Ling as Protocol, MotionStatus, Position, Response, Speed};
    use armwire::messages::Messages;

    use super::*;
    use crate::error::text::Text;
    use crate::ports::line::{Line, Names, Reception};

    /// The number of the request in which a call of another thread begins.
    const CALLED: usize = 4;
    /// The joints of the target.
    const TARGET: [u16; JOINTS] = [2_100; JOINTS];
    /// The number of times that a thread yields until it gives up: seconds.
    const YIELDS: u32 = 3_000_000;

    /// An arm that does as it is told.
    struct Arm {
        joints: [u16; JOINTS],
        status: MotionStatus,
        /// The number of requests.
        requests: usize,
        /// The numbers of the requests that fail.
        failing: Range<usize>,
        /// True if it answers nothing.
        is_silent: bool,
    }

    /// The arm, and its handle once there is one.
    struct Moving {
        shared: OnceLock<Shared<Ling>>,
        /// The number of calls of other threads that begin in the request [`CALLED`].
        callers: usize,
        arm: Mutex<Arm>,
    }

    impl Moving {
        fn set<T>(&self, set: impl FnOnce(&mut Arm) -> T) -> T {
            set(&mut self.arm.lock().unwrap_or_else(PoisonError::into_inner))
        }
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
            let response = self.moving.set(|arm| {
                Response::Joints(JointState {
                    joints: arm.joints,
                    gripper: 500,
                    status: arm.status,
                })
            });
            match std::mem::take(&mut self.is_asked) {
                true => Ok(Protocol.encode_response(&response, None, buf).unwrap()),
                false => Ok(0),
            }
        }

        fn write(&mut self, bytes: &[u8]) -> Result<usize, Error> {
            if Protocol::FENCES.contains(&bytes) {
                return Ok(bytes.len());
            }
            let (number, fails) = self.moving.set(|arm| {
                arm.requests += 1;
                (arm.requests, arm.failing.contains(&arm.requests))
            });
            if fails {
                return Err(Error::at("fake", "no"));
            }
            self.is_asked = !self.moving.set(|arm| arm.is_silent);
            if number == CALLED
                && let Some(arm) = self.moving.shared.get()
            {
                self.is_called.send(()).unwrap();
                // Until the other threads wait for the arm.
                while arm.waiting() < self.moving.callers {
                    thread::yield_now();
                }
            }
            Ok(bytes.len())
        }

        fn hint(&self, _: Reception, _: Names) -> Text {
            Text::default()
        }
    }

    /// An arm that holds its pose, and the report of its request [`CALLED`].
    fn moving(callers: usize) -> (Arc<Moving>, Ling, mpsc::Receiver<()>) {
        let moving = Arc::new(Moving {
            shared: OnceLock::new(),
            callers,
            arm: Mutex::new(Arm {
                joints: [2_000; JOINTS],
                status: MotionStatus::Locked,
                requests: 0,
                failing: 0..0,
                is_silent: false,
            }),
        });
        let (sender, is_called) = mpsc::channel();
        let arm = super::super::tests::ling(Box::new(Wire {
            moving: Arc::clone(&moving),
            is_called: sender,
            is_asked: false,
        }));
        (moving, arm, is_called)
    }

    /// The results of `wait` and of the calls which so many other threads make meanwhile.
    fn calls_within<T: Send, U: Send>(
        callers: usize,
        wait: impl FnOnce(&Shared<Ling>) -> T + Send,
        call: impl Fn(&Shared<Ling>, &Moving, &mut Ling) -> U + Sync,
    ) -> (T, Vec<U>) {
        let (moving, arm, is_called) = moving(callers);
        let shared = Shared::new("fake", arm);
        assert!(moving.shared.set(shared.clone()).is_ok());
        thread::scope(|scope| {
            let wait = scope.spawn(|| wait(&shared));
            is_called.recv().unwrap();
            let run = || shared.call(|arm| Ok::<_, Error>(call(&shared, &moving, arm))).unwrap();
            let calls: Vec<_> = (0..callers).map(|_| scope.spawn(run)).collect();
            let calls = calls.into_iter().map(|call| call.join().unwrap()).collect();
            (wait.join().unwrap(), calls)
        })
    }

    /// Moves the arm to [`TARGET`], for 5 s at most.
    fn move_to_target(arm: &Shared<Ling>) -> Result<JointState, Error> {
        let target = Move {
            joints: TARGET.map(|ticks| (Position::new(ticks).unwrap(), Speed::MAX)),
            gripper: (Opening::new(500).unwrap(), GripperSpeed(1_000)),
        };
        arm.move_and_wait(&target, Tolerances::MOVE, Duration::from_secs(5))
    }

    #[test]
    fn call_has_its_turn_within_a_wait() {
        let (arrived, requests) = calls_within(1, move_to_target, |_, moving, _| {
            moving.set(|arm| {
                arm.joints = TARGET;
                arm.requests
            })
        });
        assert_eq!(requests, [CALLED], "no reading comes before it");
        assert_eq!(arrived.unwrap().joints, TARGET, "the wait goes on");
    }

    #[test]
    fn call_has_its_turn_within_a_switching() {
        for switch in [|arm: &Shared<Ling>| arm.set_torque(Torque::Off), Shared::set_zero] {
            let switch = |arm: &Shared<Ling>| {
                arm.call(|arm| arm.read_joints())?;
                switch(arm)
            };
            let (outcome, requests) = calls_within(1, switch, |_, moving, _| {
                moving.set(|arm| {
                    (arm.joints, arm.status) = ([2_048; JOINTS], MotionStatus::Idle);
                    arm.requests
                })
            });
            assert_eq!(requests, [CALLED], "no reading comes before it");
            assert!(outcome.unwrap().is_shown, "the read-back goes on");
        }
    }

    #[test]
    fn torque_off_comes_before_the_next_reading_of_a_reader() {
        let (moving, arm, _is_called) = moving(1);
        moving.set(|arm| arm.status = MotionStatus::Idle);
        let shared = Shared::new("fake", arm);
        thread::scope(|scope| {
            let reading = shared.read(|_| {
                let switching = scope.spawn(|| shared.set_torque(Torque::Off));
                // Until it waits for the arm.
                let waits = (0..YIELDS).any(|_| {
                    thread::yield_now();
                    shared.waiting() == 1
                });
                Ok((switching, waits))
            });
            let (switching, waits) = reading.unwrap();
            assert!(waits);
            let requests = shared.read(|_| Ok(moving.set(|arm| arm.requests))).unwrap();
            assert!(requests > 0);
            assert!(switching.join().unwrap().unwrap().is_shown);
        });
    }

    #[test]
    fn wait_has_its_turn_among_ceaseless_calls() {
        let has_turn = AtomicBool::new(false);
        // Another call waits while the first one runs, and the wait comes as a third.
        let (arrived, turns) = calls_within(2, move_to_target, |shared, moving, _| {
            moving.set(|arm| arm.joints = TARGET);
            (0..YIELDS).any(|_| {
                thread::yield_now();
                has_turn.fetch_or(shared.waiting() == 2, Ordering::Relaxed);
                has_turn.load(Ordering::Relaxed)
            })
        });
        assert_eq!(turns, [true; 2]);
        assert_eq!(arrived.unwrap().joints, TARGET);
    }

    #[test]
    fn torque_off_of_another_thread_ends_a_wait() {
        let (ended, sent) = calls_within(1, move_to_target, |_, moving, arm| {
            arm.send(Effect::Torque(Torque::Off))?;
            moving.set(|arm| {
                arm.status = MotionStatus::Idle;
                arm.failing = arm.requests + 1..arm.requests + 2;
            });
            Ok::<_, Error>(())
        });
        assert!(matches!(sent[..], [Ok(())]), "{sent:?}");
        let error = ended.unwrap_err();
        let effect = match &error {
            Error::TorqueOff { effect, .. } => *effect,
            _ => panic!("{error}"),
        };
        assert_eq!(effect, TorqueOffEffect::MotionEnded);
    }

    #[test]
    fn readings_of_a_moved_arm_show_torque_off() {
        let (moving, mut arm, _is_called) = moving(1);
        arm.gripper = Some(Opening::OPEN);
        let mut readings = MotionReadings::default();
        assert!(readings.read(&mut arm).unwrap().is_some());
        arm.send(Effect::Torque(Torque::Off)).unwrap();
        moving.set(|arm| arm.status = MotionStatus::Idle);
        let error = readings.read(&mut arm).unwrap_err();
        assert!(matches!(error, Error::TorqueOff { .. }), "{error}");
    }

    #[test]
    fn lost_readings_leave_the_effect_to_the_rest() {
        let (moving, mut arm, _is_called) = moving(1);
        // After a reading and the request.
        moving.set(|arm| arm.failing = 3..4);
        let outcome = arm.set_torque(Torque::On).unwrap();
        assert!(outcome.is_shown, "{outcome}");
    }

    #[test]
    fn silence_after_torque_off_keeps_its_hint() {
        let (moving, mut arm, _is_called) = moving(1);
        moving.set(|arm| arm.is_silent = true);
        let error = arm.set_torque(Torque::Off).unwrap_err();
        let text = error.to_string();
        assert!(matches!(error, Error::NoAnswer { .. }), "{text}");
        let start = "fake: torque off was sent, but no reading came within 0.5 s: no answer";
        assert!(text.starts_with(start), "{text}");
    }

    #[test]
    fn effect_without_any_reading_is_not_confirmed() {
        let (moving, mut arm, _is_called) = moving(1);
        moving.set(|arm| arm.failing = 2..usize::MAX);
        let error = arm.set_torque(Torque::Off).unwrap_err();
        assert_eq!(
            error.to_string(),
            "fake: torque off was sent, but no reading came within 0.5 s"
        );
    }
}
