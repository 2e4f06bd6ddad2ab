//! The newest pose of an arm, which a thread reads.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use armwire_host::{Counts, Error, Readable, Reader, Reading, Stamping, XArm, XArmPose};
use pyo3::prelude::*;

use crate::error::{closed, exception, value_error};
use crate::joints::{Joints, joints};
use crate::session::check_signals;

/// Maximum duration of one wait between checks for signals.
const WAIT: Duration = Duration::from_millis(50);

/// Number, monotonic and system time in nanoseconds, true for a stamp of the adapter, and age in seconds.
type At = (u64, i64, i64, bool, f64);

/// A reader, until it is closed.
struct Held<A: Readable>(Mutex<Option<Arc<Reader<A>>>>);

impl<A: Readable> Held<A> {
    fn new(reader: Reader<A>) -> Self {
        Self(Mutex::new(Some(Arc::new(reader))))
    }

    /// Calls the open reader, without waiting.
    fn with<T>(&self, call: impl FnOnce(&Arc<Reader<A>>) -> T) -> PyResult<T> {
        let reader = self.0.lock().unwrap_or_else(PoisonError::into_inner);
        reader.as_ref().map(call).ok_or_else(closed)
    }

    fn latest(&self, max_age_s: Option<f64>) -> PyResult<(A::Pose, At)> {
        let max_age = max_age_s.map(duration).transpose()?;
        let reading = self.with(|reader| match max_age {
            None => reader.latest(),
            Some(max_age) => reader.latest_within(max_age),
        })?;
        reading.map(split).map_err(exception)
    }

    fn at(&self, monotonic_ns: i64) -> PyResult<(A::Pose, At)> {
        let reading = self.with(|reader| reader.at(monotonic_ns))?;
        reading.map(split).map_err(exception)
    }

    fn next_after(&self, py: Python<'_>, number: u64, timeout_s: f64) -> PyResult<Option<(A::Pose, At)>> {
        let (reader, timeout) = (self.with(Arc::clone)?, duration(timeout_s)?);
        // The last handle is dropped without the interpreter's lock, which the arm's call may wait for.
        let next = py.detach(move || next_after(&reader, number, timeout));
        Ok(next.map_err(exception)?.map(split))
    }

    fn counts(&self) -> PyResult<(u64, u64, u64)> {
        let Counts {
            samples, lost, missed, ..
        } = self.with(|reader| reader.counts())?;
        Ok((samples, lost, missed))
    }

    /// Ends the thread, after a call of the arm. If another thread waits for a reading, the wait's end ends it.
    fn close(&self, py: Python<'_>) {
        let reader = self.0.lock().unwrap_or_else(PoisonError::into_inner).take();
        py.detach(|| drop(reader));
    }
}

impl<A: Readable> Drop for Held<A> {
    fn drop(&mut self) {
        Python::attach(|py| self.close(py));
    }
}

/// The next reading after this number, within this time.
fn next_after<A: Readable>(
    reader: &Reader<A>,
    number: u64,
    timeout: Duration,
) -> Result<Option<Reading<A::Pose>>, Error> {
    let begun = Instant::now();
    loop {
        let left = timeout.saturating_sub(begun.elapsed());
        let next = reader.next_after(number, left.min(WAIT))?;
        if next.is_some() || left.is_zero() {
            return Ok(next);
        }
        check_signals().map_err(Error::Interrupted)?;
    }
}

fn split<P>(reading: Reading<P>) -> (P, At) {
    let (time, is_adapters) = (reading.time, reading.stamping == Stamping::Adapter);
    let age_s = reading.age.as_secs_f64();
    let at = (reading.number, time.monotonic_ns, time.unix_ns, is_adapters, age_s);
    (reading.pose, at)
}

fn duration(seconds: f64) -> PyResult<Duration> {
    let wrong = |_| value_error(format_args!("time {seconds} s is out of range"));
    Duration::try_from_secs_f64(seconds).map_err(wrong)
}

/// The reader of a Ling arm.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct LingReader(Held<armwire_host::Ling>);

impl LingReader {
    pub(crate) fn new(reader: Reader<armwire_host::Ling>) -> Self {
        Self(Held::new(reader))
    }
}

#[pymethods]
impl LingReader {
    fn latest(&self, max_age_s: Option<f64>) -> PyResult<(Joints, At)> {
        let (state, at) = self.0.latest(max_age_s)?;
        Ok((joints(state), at))
    }

    fn at(&self, monotonic_ns: i64) -> PyResult<(Joints, At)> {
        let (state, at) = self.0.at(monotonic_ns)?;
        Ok((joints(state), at))
    }

    fn next_after(&self, py: Python<'_>, number: u64, timeout_s: f64) -> PyResult<Option<(Joints, At)>> {
        let next = self.0.next_after(py, number, timeout_s)?;
        Ok(next.map(|(state, at)| (joints(state), at)))
    }

    /// Samples, lost and missed readings.
    fn counts(&self) -> PyResult<(u64, u64, u64)> {
        self.0.counts()
    }

    fn close(&self, py: Python<'_>) {
        self.0.close(py);
    }
}

/// The state as a byte, and seven angles in radians.
type Angles = (u8, [f32; 7]);

/// The reader of an xArm.
#[pyclass(frozen, module = "armwire._armwire")]
pub(crate) struct XArmReader(Held<XArm>);

impl XArmReader {
    pub(crate) fn new(reader: Reader<XArm>) -> Self {
        Self(Held::new(reader))
    }
}

#[pymethods]
impl XArmReader {
    fn latest(&self, max_age_s: Option<f64>) -> PyResult<(Angles, At)> {
        let (pose, at) = self.0.latest(max_age_s)?;
        Ok((angles(pose), at))
    }

    fn at(&self, monotonic_ns: i64) -> PyResult<(Angles, At)> {
        let (pose, at) = self.0.at(monotonic_ns)?;
        Ok((angles(pose), at))
    }

    fn next_after(&self, py: Python<'_>, number: u64, timeout_s: f64) -> PyResult<Option<(Angles, At)>> {
        let next = self.0.next_after(py, number, timeout_s)?;
        Ok(next.map(|(pose, at)| (angles(pose), at)))
    }

    /// Samples, lost and missed readings.
    fn counts(&self) -> PyResult<(u64, u64, u64)> {
        self.0.counts()
    }

    fn close(&self, py: Python<'_>) {
        self.0.close(py);
    }
}

fn angles(pose: XArmPose) -> Angles {
    (pose.state.0, pose.joints)
}
