//! An open port for any Python thread. Calls wait without the interpreter's lock, and Ctrl-C ends them.

use std::error::Error as StdError;
use std::ffi::CString;
use std::num::NonZeroU32;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use armwire_host::{
    Adapter, Alpha1, Connection, Error, Ling, Options, Port, RECOVERY, Rate, Readable, Reader, Shared, XArm,
};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::error::{exception, reentered, value_error};

/// An open port with one call at a time, until it is closed.
pub(crate) struct Session<T> {
    open: Shared<T>,
    /// The thread that is in a call.
    caller: Mutex<Option<ThreadId>>,
}

/// A port that knows more of its errors.
pub(crate) trait Explain {
    /// The error with what only the adapter or the system knows of it.
    fn explain(&self, error: Error) -> Error {
        error
    }
}

impl Explain for Ling {
    fn explain(&self, error: Error) -> Error {
        self.explain(error)
    }
}

impl Explain for Alpha1 {
    fn explain(&self, error: Error) -> Error {
        self.explain(error)
    }
}

impl Explain for XArm {}

impl Explain for Adapter {}

impl<T: Explain + Send> Session<T> {
    /// Opens a port, called `name` by the user, with `open`.
    pub(crate) fn open(py: Python<'_>, name: &str, open: impl FnOnce() -> Result<T, Error> + Send) -> PyResult<Self> {
        let opened = py.detach(open).map_err(exception)?;
        Ok(Self {
            open: Shared::new(name, opened),
            caller: Mutex::new(None),
        })
    }

    /// Opens the arm on a port by `arm`, and warns of an adapter in recovery.
    pub(crate) fn of_arm(
        py: Python<'_>,
        name: &str,
        baud: Option<NonZeroU32>,
        arm: impl FnOnce(&Connection) -> Result<T, Error> + Send,
    ) -> PyResult<Self> {
        let port: Port = name.parse().map_err(value_error)?;
        let mut warning = None;
        let session = Self::open(py, name, || {
            let connection = port.open(Options::default().with_baud(baud))?;
            warning = recovery_warning(&connection);
            arm(&connection)
        })?;
        warn(py, warning)?;
        Ok(session)
    }

    /// Runs `act` on the open port. Other Python threads run meanwhile.
    ///
    /// A signal handler runs inside the call that it interrupts. A call from the handler would wait for itself: it is an
    /// error.
    pub(crate) fn with<R: Send>(
        &self,
        py: Python<'_>,
        act: impl FnOnce(&mut T) -> Result<R, Error> + Send,
    ) -> PyResult<R> {
        self.check_caller()?;
        let act = |open: &mut T| {
            *lock(&self.caller) = Some(thread::current().id());
            let acted = act(open).map_err(|error| open.explain(error));
            *lock(&self.caller) = None;
            acted
        };
        py.detach(|| self.open.call(act)).map_err(exception)
    }

    /// Closes the port after the current call ends.
    pub(crate) fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.check_caller()?;
        py.detach(|| drop(self.open.take()));
        Ok(())
    }

    /// Starts to read the arm's pose, at this rate in hertz.
    pub(crate) fn reader(&self, py: Python<'_>, rate: u32) -> PyResult<Reader<T>>
    where
        T: Readable,
    {
        self.check_caller()?;
        let rate = u16::try_from(rate).unwrap_or(u16::MAX);
        let rate = Rate::new(rate).map_err(value_error)?;
        py.detach(|| Reader::start(&self.open, rate)).map_err(exception)
    }

    fn check_caller(&self) -> PyResult<()> {
        match *lock(&self.caller) == Some(thread::current().id()) {
            true => Err(reentered()),
            false => Ok(()),
        }
    }
}

pub(crate) fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// The warning for a program that moves the arm on this port, if it has an adapter in recovery.
fn recovery_warning(connection: &Connection) -> Option<String> {
    let name = connection.adapter_in_recovery()?;
    Some(format!("{name}: the adapter has {RECOVERY}"))
}

/// Warns the caller of a class in Python, if there is a reason.
fn warn(py: Python<'_>, reason: Option<String>) -> PyResult<()> {
    match reason.map(CString::new) {
        Some(Ok(reason)) => PyErr::warn(py, &py.get_type::<PyUserWarning>(), &reason, 2),
        _ => Ok(()),
    }
}

/// The exception of a pending signal, such as `KeyboardInterrupt`.
pub(crate) fn check_signals() -> Result<(), Box<dyn StdError + Send + Sync>> {
    Python::attach(|py| py.check_signals()).map_err(Into::into)
}
