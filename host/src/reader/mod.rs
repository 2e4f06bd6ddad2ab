//! The newest pose of an arm, read by a thread of its own.
//!
//! [`pose`] has what is read, and [`history`] keeps each [`reading`]. A [`session`] reads, by requests or by the polls of
//! an adapter, which [`polled`] has.

#[cfg(test)]
mod fake;
mod history;
mod polled;
mod pose;
mod reading;
mod session;

use std::fmt;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::thread::{self, JoinHandle};
use std::time::Duration;

use crate::arm::ling::Ling;
use crate::arm::shared::Shared;
use crate::arm::xarm::XArm;
use crate::error::Error;
use crate::time::rate::Rate;
use crate::time::silence::SilenceLimit;
use crate::time::stamps::monotonic;
use history::{History, Missing};

pub use pose::Readable;
use reading::End;
pub use reading::{Counts, Reading, Stamping};
use session::{Session, Source};

/// A thread that reads the pose of an arm at a rate. Callers get the newest pose without waiting. Its drop ends it.
///
/// An adapter on the arm's port polls the arm by its clock, and its stamps are the times of the readings. Otherwise the
/// thread reads, and a reading has the time of its receipt, or of its request if the answer took more than 10 ms. A lost
/// answer costs one reading: the next one begins at its time. It is [counted](Self::counts).
///
/// A lost port is a state: [`latest`](Self::latest) and commands fail with [`Error::Lost`], and the port is opened again
/// every 0.5 s. It is back when the same arm answers, by its serial number; only reads are sent until then. Nothing moves
/// by itself afterwards, and the next move reads first.
///
/// Commands go on meanwhile, through the [shared arm](Self::arm): each waits for at most one read. A read by a command is
/// answered by what was sent after its begin. After a lost reading it waits for one more answer: see [`armwire::Client`].
///
/// ```no_run
/// use armwire::ling::Torque;
/// use armwire_host::{Error, Rate};
///
/// let arm = armwire_host::open("/dev/ttyUSB0")?.ling()?;
/// let reader = arm.reader(Rate::new(200)?)?;
/// if let Some(first) = reader.next_after(0, std::time::Duration::from_secs(1))? {
///     println!("{} at {} ns", first.pose, first.time.unix_ns);
/// }
/// reader.arm().set_torque(Torque::On)?;
/// println!("{} µs old", reader.latest()?.age.as_micros());
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Reader<A: Readable> {
    arm: Shared<A>,
    history: Arc<History<A::Pose>>,
    max_age: Duration,
    stop: Arc<AtomicBool>,
    thread: Option<JoinHandle<()>>,
}

impl Ling {
    /// Reads the arm's pose at this rate, in a thread: see [`Reader`].
    ///
    /// # Errors
    ///
    /// As of [`Reader::start`].
    pub fn reader(self, rate: Rate) -> Result<Reader<Self>, Error> {
        let name = self.name().to_owned();
        Reader::start(&Shared::new(&name, self), rate)
    }
}

impl XArm {
    /// Reads the arm's pose at this rate, in a thread: see [`Reader`].
    ///
    /// # Errors
    ///
    /// As of [`Reader::start`].
    pub fn reader(self, rate: Rate) -> Result<Reader<Self>, Error> {
        let name = self.name().to_owned();
        Reader::start(&Shared::new(&name, self), rate)
    }
}

impl<A: Readable> Reader<A> {
    /// Starts to read this arm: by the polls of the adapter on its port, or by reads if it has none or if another program
    /// has its control port.
    ///
    /// # Errors
    ///
    /// [`Error::Closed`] if the arm was taken. [`Error::InUse`] while another reader reads it. Errors of the adapter.
    pub fn start(arm: &Shared<A>, rate: Rate) -> Result<Self, Error> {
        // An arm that does not tell its serial number is read all the same: its port is not opened again then.
        if let Err(error @ Error::Interrupted(_)) = arm.call(A::identify) {
            return Err(error);
        }
        let source = Source::find(arm, rate)?;
        let mut reader = Self {
            arm: arm.clone(),
            history: Arc::new(History::new()),
            max_age: SilenceLimit::STALE.at(rate.micros()).into(),
            stop: Arc::default(),
            thread: None,
        };
        if let Source::Arm = source {
            reader.take_poses()?;
        }
        let session = Session {
            arm: arm.clone(),
            rate,
            history: Arc::clone(&reader.history),
            stop: Arc::clone(&reader.stop),
        };
        let thread = thread::Builder::new().name("armwire reader".to_owned());
        let spawned = thread.spawn(move || session.run(source));
        let no_thread = |error| Error::at(reader.arm.name(), format_args!("no thread for the reader: {error}"));
        reader.thread = Some(spawned.map_err(no_thread)?);
        Ok(reader)
    }

    /// The arm, for commands.
    pub const fn arm(&self) -> &Shared<A> {
        &self.arm
    }

    /// The newest pose, without waiting, if it is at most 100 ms or three periods old.
    ///
    /// # Errors
    ///
    /// [`Error::NoPose`] if it is older, or if there is none yet. [`Error::Lost`] at once while the port is lost,
    /// [`Error::Legacy`] and [`Error::Closed`] after the end of the reader.
    pub fn latest(&self) -> Result<Reading<A::Pose>, Error> {
        self.latest_within(self.max_age)
    }

    /// The newest pose, without waiting, if it is at most this old.
    ///
    /// # Errors
    ///
    /// As of [`latest`](Self::latest).
    pub fn latest_within(&self, max_age: Duration) -> Result<Reading<A::Pose>, Error> {
        self.found(self.history.latest(monotonic(), max_age))
    }

    /// The pose at this time of the [monotonic clock](crate::time::stamps::monotonic), without waiting: linear between the
    /// readings before and after it, which are at most 100 ms or three periods apart. Readings are kept for two seconds at
    /// 1000 Hz, and longer at a lower rate.
    ///
    /// # Errors
    ///
    /// As of [`latest`](Self::latest), and [`Error::NoPose`] for a time that is not between two readings.
    pub fn at(&self, monotonic_ns: i64) -> Result<Reading<A::Pose>, Error> {
        self.found(self.history.at(monotonic_ns, monotonic(), self.max_age))
    }

    /// The next reading after this number, of those that are kept; waits for it at most this long. The first has number 1.
    ///
    /// # Errors
    ///
    /// As of [`latest`](Self::latest), except for the age.
    pub fn next_after(&self, number: u64, wait: Duration) -> Result<Option<Reading<A::Pose>>, Error> {
        self.found(self.history.next_after(number, wait))
    }

    /// Counts since the start.
    pub fn counts(&self) -> Counts {
        self.history.counts()
    }

    /// Ends the reader, and returns the arm. `None` if it was taken before.
    pub fn into_arm(self) -> Option<A> {
        let arm = self.arm.clone();
        drop(self);
        arm.take()
    }

    /// Takes each pose that the arm reports.
    fn take_poses(&self) -> Result<(), Error> {
        let history = Arc::clone(&self.history);
        self.arm.call(|arm| {
            if arm.on_pose().is_some() {
                let (name, user) = (arm.name().into(), "another reader of this program".into());
                return Err(Error::InUse { name, user });
            }
            *arm.on_pose() = Some(Box::new(move |pose, time| history.push(pose, time, Stamping::Receipt)));
            Ok(())
        })
    }

    fn found<T>(&self, found: Result<T, Missing>) -> Result<T, Error> {
        let name = || self.arm.name().into();
        found.map_err(|missing| match missing {
            Missing::NoPose(reason) => Error::NoPose { name: name(), reason },
            Missing::Ended(End::Lost(reason)) => Error::Lost { name: name(), reason },
            Missing::Ended(End::Legacy(legacy)) => Error::Legacy { name: name(), legacy },
            Missing::Ended(End::Closed) => Error::Closed { name: name() },
        })
    }
}

impl<A: Readable> Drop for Reader<A> {
    fn drop(&mut self) {
        self.stop.store(true, Ordering::Relaxed);
        if let Some(thread) = self.thread.take() {
            thread.thread().unpark();
            // A panic of the thread was reported by it.
            let _ = thread.join();
        }
    }
}

impl<A: Readable> fmt::Debug for Reader<A> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.debug_struct("Reader")
            .field("arm", &self.arm)
            .field("counts", &self.counts())
            .finish_non_exhaustive()
    }
}
