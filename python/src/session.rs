//! An open port for any Python thread. Calls wait without the interpreter's lock, and Ctrl-C ends them.

use std::error::Error as StdError;
use std::ffi::CString;
use std::sync::{Mutex, MutexGuard, PoisonError};
use std::thread::{self, ThreadId};

use armwire_host::{Arm, Connection, Error, Link, Missing, RECOVERY};
use pyo3::exceptions::PyUserWarning;
use pyo3::prelude::*;

use crate::error::{closed, exception, reentered};

/// An open port with one call at a time, until it is closed.
pub(crate) struct Session<T> {
    open: Mutex<Option<T>>,
    /// The thread that is in a call.
    caller: Mutex<Option<ThreadId>>,
}

impl<T: Send> Session<T> {
    /// Opens a port with `open`.
    pub(crate) fn open(py: Python<'_>, open: impl FnOnce() -> Result<T, Error> + Send) -> PyResult<Self> {
        let opened = py.detach(open).map_err(exception)?;
        Ok(Self {
            open: Mutex::new(Some(opened)),
            caller: Mutex::new(None),
        })
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
        let acted = py.detach(|| {
            let mut open = lock(&self.open);
            *lock(&self.caller) = Some(thread::current().id());
            let acted = open.as_mut().map(act);
            *lock(&self.caller) = None;
            acted
        });
        acted.ok_or_else(closed)?.map_err(exception)
    }

    /// Closes the port after the current call ends.
    pub(crate) fn close(&self, py: Python<'_>) -> PyResult<()> {
        self.check_caller()?;
        py.detach(|| drop(lock(&self.open).take()));
        Ok(())
    }

    fn check_caller(&self) -> PyResult<()> {
        match *lock(&self.caller) == Some(thread::current().id()) {
            true => Err(reentered()),
            false => Ok(()),
        }
    }
}

fn lock<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

/// A link whose calls end with Ctrl-C.
pub(crate) fn interruptible<P: Arm>(mut link: Link<P>) -> Link<P> {
    link.set_interrupt(check_signals);
    link
}

/// The warning for a program that moves the arm on this port, if it has an adapter in recovery.
pub(crate) fn recovery_warning(connection: &Connection) -> Option<String> {
    let name = connection.adapter_in_recovery()?;
    Some(format!("{name}: the adapter has {RECOVERY}"))
}

/// Warns the caller of a class in Python, if there is a reason.
pub(crate) fn warn(py: Python<'_>, reason: Option<String>) -> PyResult<()> {
    match reason.map(CString::new) {
        Some(Ok(reason)) => PyErr::warn(py, &py.get_type::<PyUserWarning>(), &reason, 2),
        _ => Ok(()),
    }
}

/// The exception of a pending signal, such as `KeyboardInterrupt`.
pub(crate) fn check_signals() -> Result<(), Box<dyn StdError + Send + Sync>> {
    Python::attach(|py| py.check_signals()).map_err(Into::into)
}

/// Sends a request whose response has no data.
pub(crate) fn send<P: Arm>(link: &mut Link<P>, request: &P::Request<'_>) -> Result<(), Error> {
    link.call(request, |_| ()).map(drop)
}

/// Sends a request and converts its response with `take`.
pub(crate) fn call<P: Arm, T>(
    link: &mut Link<P>,
    request: &P::Request<'_>,
    take: impl FnOnce(P::Response<'_>) -> Option<T>,
) -> Result<T, Error> {
    let answer = link.call(request, |response| match P::refusal(&response) {
        None => Ok(take(response).ok_or_else(|| response.to_string())),
        Some(what) => Err(what),
    });
    let name = || link.name().to_owned();
    match answer {
        Ok(Some(Ok(Ok(value)))) => Ok(value),
        Ok(Some(Err(reason))) => Err(Error::refused(&name(), reason)),
        Ok(Some(Ok(Err(other)))) => Err(Error::Unacceptable {
            name: name(),
            reason: format!("the arm answered another request: {other}"),
        }),
        Ok(None) => Err(Error::Unacceptable {
            name: name(),
            reason: format!("'{request}' has no answer"),
        }),
        Err(Error::NoAnswer {
            name,
            missing: Missing::Silent,
            bytes,
            ..
        }) if link.comes_late()? => Err(Error::NoAnswer {
            name,
            missing: Missing::Late,
            cause: "the answer came too late".to_owned(),
            hint: "is the arm or the line overloaded?".into(),
            bytes,
        }),
        Err(error) => Err(error),
    }
}
