//! The work of a reader's thread: it reads, and opens a lost port again.

use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread;
use std::time::{Duration, Instant};

use armwire::time;

use super::history::History;
use super::polled::Polled;
use super::pose::Readable;
use super::reading::End;
use crate::arm::shared::Shared;
use crate::error::Error;
use crate::error::outside::Outside;
use crate::time::pace::Pace;
use crate::time::rate::Rate;
use crate::time::stopwatch::Stopwatch;

/// Maximum wait for one answer, for which calls wait, too. It comes with a later reading then.
const MAX_WAIT: time::Duration = time::Duration::from_millis(100);
/// Time between two attempts to open a lost port.
const RETRY_PERIOD: Duration = Duration::from_millis(500);

/// The origin of the readings.
pub(super) enum Source {
    /// The polls of an adapter.
    Adapter(Polled),
    /// Requests of the reader.
    Arm,
}

impl Source {
    /// The polls of the adapter on the arm's port. The arm itself if there is none, if another program has its control
    /// port, or if it is configured for another kind of arm.
    ///
    /// # Errors
    ///
    /// Errors of the adapter.
    pub(super) fn find<A: Readable>(arm: &Shared<A>, rate: Rate) -> Result<Self, Error> {
        let adapter = arm.call(|arm| match arm.adapter() {
            Err(Error::NoControl { .. } | Error::Usb { .. } | Error::InUse { .. }) => Ok(None),
            found => found,
        })?;
        let Some(polled) = adapter
            .map(|adapter| Polled::start::<A>(adapter, rate))
            .transpose()?
            .flatten()
        else {
            return Ok(Self::Arm);
        };
        arm.call(|arm| {
            arm.lend(polled.adapter());
            Ok::<_, Error>(())
        })?;
        Ok(Self::Adapter(polled))
    }

    const fn is_polled(&self) -> bool {
        matches!(self, Self::Adapter(_))
    }
}

/// A reader's thread.
pub(super) struct Session<A: Readable> {
    pub(super) arm: Shared<A>,
    pub(super) rate: Rate,
    pub(super) history: Arc<History<A::Pose>>,
    pub(super) stop: Arc<AtomicBool>,
}

impl<A: Readable> Session<A> {
    /// Reads until the stop, until the arm is taken, or until it is one of the older generation.
    pub(super) fn run(&self, mut source: Source) {
        let takes_poses = !source.is_polled();
        let end = loop {
            let end = match &mut source {
                Source::Adapter(polled) => polled.run::<A>(&self.history, &self.stop),
                Source::Arm => self.read(),
            };
            let End::Lost(reason) = end else { break end };
            match self.reopen(source, reason) {
                Ok(reopened) => source = reopened,
                Err(end) => break end,
            }
        };
        if takes_poses {
            let leave = |arm: &mut A| {
                *arm.on_pose() = None;
                Ok::<_, Error>(())
            };
            // An arm that was taken has another owner.
            let _ = self.arm.call(leave);
        }
        self.history.set_end(Some(end));
    }

    /// Reads the arm at the rate until the stop, or until no later reading can succeed.
    fn read(&self) -> End {
        let clock = Stopwatch::start();
        let mut pace = Pace::new(self.rate);
        while !self.is_stopped() {
            let left = clock.until(pace.next());
            if !left.is_zero() {
                thread::park_timeout(left);
                continue;
            }
            let answered = self.arm.read(|arm| {
                let now = clock.now();
                self.history.add_missed(pace.begin(now).unwrap_or(0));
                let until = pace.next().min(now + MAX_WAIT);
                arm.read_pose(Instant::now() + until.since(now).into())
            });
            let is_answered = match answered {
                Ok(is_answered) => is_answered,
                Err(error) => match End::by(error) {
                    Some(end) => return end,
                    None => false,
                },
            };
            if !is_answered {
                self.history.add_lost(1);
            }
        }
        End::Closed
    }

    /// Closes the port that was lost for this reason, and opens it when the same arm is back.
    ///
    /// # Errors
    ///
    /// The end of the reader.
    fn reopen(&self, lost: Source, mut loss: Outside) -> Result<Source, End> {
        let mut reason = loss.clone();
        self.history.set_end(Some(End::Lost(reason.clone())));
        let is_polled = lost.is_polled();
        // Its port would keep its name from the device that comes back.
        drop(lost);
        while !self.is_stopped() {
            let opened = self.arm.call(A::reopen).and_then(|()| match is_polled {
                true => Source::find(&self.arm, self.rate),
                false => Ok(Source::Arm),
            });
            match opened {
                Ok(source) if source.is_polled() == is_polled => {
                    self.history.set_end(None);
                    return Ok(source);
                }
                Ok(_) => reason = format!("{}; the adapter's control port is not free", loss.as_str()).into(),
                Err(Error::Lost { reason: now, .. }) => {
                    loss = now;
                    reason = loss.clone();
                }
                Err(error) => {
                    reason = format!("{}; now: {error}", loss.as_str()).into();
                    if let Some(end) = End::by(error) {
                        return Err(end);
                    }
                }
            }
            self.history.set_end(Some(End::Lost(reason.clone())));
            let disconnect = |arm: &mut A| {
                arm.disconnect(reason.clone());
                Ok::<_, Error>(())
            };
            // An arm that was taken ends the next attempt.
            let _ = self.arm.call(disconnect);
            thread::park_timeout(RETRY_PERIOD);
        }
        Err(End::Closed)
    }

    fn is_stopped(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::VecDeque;
    use std::sync::Mutex;

    use armwire::ling::{JointState, Response};
    use armwire_bridge::config::ArmKind;

    use super::super::fake::{adapter, frame, state};
    use super::*;
    use crate::arm::ling::Ling;
    use crate::arm::pose::OnPose;
    use crate::ports::control::Adapter;

    /// An arm behind these adapters: the next one is found after each loss.
    struct BehindAdapters {
        adapters: Mutex<VecDeque<Adapter>>,
        losses: Vec<String>,
        on_pose: Option<OnPose<JointState>>,
    }

    impl Readable for BehindAdapters {
        type Pose = JointState;

        const KIND: Option<ArmKind> = Ling::KIND;

        fn name(&self) -> &str {
            "fake"
        }

        fn adapter(&self) -> Result<Option<Adapter>, Error> {
            Ok(self.adapters.lock().unwrap().pop_front())
        }

        fn lend(&mut self, _: Shared<Adapter>) {}

        fn pose(frame: &[u8]) -> Option<JointState> {
            Ling::pose(frame)
        }

        fn read_pose(&mut self, _: Instant) -> Result<bool, Error> {
            unreachable!("an adapter polls")
        }

        fn identify(&mut self) -> Result<(), Error> {
            Ok(())
        }

        fn disconnect(&mut self, reason: Outside) {
            self.losses.push(reason.as_str().to_owned());
        }

        fn reopen(&mut self) -> Result<(), Error> {
            Ok(())
        }

        fn on_pose(&mut self) -> &mut Option<OnPose<JointState>> {
            &mut self.on_pose
        }
    }

    #[test]
    fn adapter_that_is_back_polls_again() {
        let config = Arc::default();
        let adapters = [1, 2].map(|ticks| {
            // Each counts from its start.
            let events = vec![frame(900_000 / u64::from(ticks), &Response::Joints(state(ticks)))];
            adapter(&config, [events])
        });
        let arm = BehindAdapters {
            adapters: Mutex::new(adapters.into()),
            losses: Vec::new(),
            on_pose: None,
        };
        let session = Session {
            arm: Shared::new("fake", arm),
            rate: Rate::new(200).unwrap(),
            history: Arc::new(History::new()),
            stop: Arc::default(),
        };
        thread::scope(|scope| {
            scope.spawn(|| session.run(Source::find(&session.arm, session.rate).unwrap()));
            // Behind the second loss is no adapter: the arm is not read by requests instead.
            while session.arm.call(|arm| Ok::<_, Error>(arm.losses.is_empty())).unwrap() {
                thread::yield_now();
            }
            session.stop.store(true, Ordering::Relaxed);
        });
        let next = |number| session.history.next_after(number, Duration::ZERO).unwrap().unwrap();
        let (first, second) = (next(0), next(1));
        assert_eq!([first.pose, second.pose], [1, 2].map(state));
        assert!(first.time.monotonic_ns <= second.time.monotonic_ns);
        assert_eq!(
            session.arm.take().unwrap().losses,
            ["gone; the adapter's control port is not free"]
        );
    }
}
