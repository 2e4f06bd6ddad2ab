//! Conversion of errors to the exceptions of `armwire.errors`.

use std::fmt::Display;

use armwire_host::{Error, Missing, Remedy};
use pyo3::PyErr;
use pyo3::exceptions::{PyRuntimeError, PyValueError};

mod exceptions {
    #![allow(missing_docs, reason = "documented in Python, where they are defined")]

    pyo3::import_exception!(armwire.errors, AbsentError);
    pyo3::import_exception!(armwire.errors, ClosedError);
    pyo3::import_exception!(armwire.errors, DamagedError);
    pyo3::import_exception!(armwire.errors, ErrorFrameError);
    pyo3::import_exception!(armwire.errors, LateError);
    pyo3::import_exception!(armwire.errors, NotReachedError);
    pyo3::import_exception!(armwire.errors, NotStoppedError);
    pyo3::import_exception!(armwire.errors, OlderArmError);
    pyo3::import_exception!(armwire.errors, PortError);
    pyo3::import_exception!(armwire.errors, PortLostError);
    pyo3::import_exception!(armwire.errors, NoPoseError);
    pyo3::import_exception!(armwire.errors, RefusedError);
    pyo3::import_exception!(armwire.errors, UnacceptableError);
    pyo3::import_exception!(armwire.errors, WrongArmError);
}

use exceptions::{
    AbsentError, ClosedError, DamagedError, ErrorFrameError, LateError, NoPoseError, NotReachedError, NotStoppedError,
    OlderArmError, PortError, PortLostError, RefusedError, UnacceptableError, WrongArmError,
};

/// The exception for an error.
pub(crate) fn exception(error: Error) -> PyErr {
    let text = error.with(words);
    match error {
        Error::Interrupted(reason) => match reason.downcast::<PyErr>() {
            Ok(exception) => *exception,
            Err(reason) => PyValueError::new_err(reason.to_string()),
        },
        Error::Port(_) | Error::Baud { .. } => PyValueError::new_err(text),
        Error::NoAnswer { missing, .. } => match missing {
            Missing::Damaged => DamagedError::new_err(text),
            Missing::Late => LateError::new_err(text),
            Missing::Unknown => RefusedError::new_err(text),
            Missing::Elsewhere | Missing::Foreign => WrongArmError::new_err(text),
            _ => AbsentError::new_err(text),
        },
        Error::Unanswered { silence, .. } if silence.stopped.is_ok() => AbsentError::new_err(text),
        Error::NotStopped { .. } | Error::Unanswered { .. } => NotStoppedError::new_err(text),
        Error::NotParked { stopped: Err(_), .. } => NotStoppedError::new_err(text),
        Error::NotReached { .. } | Error::NotParked { .. } => NotReachedError::new_err(text),
        Error::NoPose { .. } => NoPoseError::new_err(text),
        Error::Closed { .. } => ClosedError::new_err(text),
        Error::Legacy { .. } => OlderArmError::new_err(text),
        Error::Lost { .. } | Error::Stuck { .. } => PortLostError::new_err(text),
        Error::Refused { .. }
        | Error::TorqueOff { .. }
        | Error::TorqueSwitched { .. }
        | Error::Immovable { .. }
        | Error::MotionRefused { .. }
        | Error::NoEffect { .. }
        | Error::NoForceFeedback { .. }
        | Error::ModeNotApplied { .. }
        | Error::NoParkPose { .. }
        | Error::Unsupported { .. } => RefusedError::new_err(text),
        Error::ErrorFrame { .. } => ErrorFrameError::new_err(text),
        Error::Unacceptable { .. } => UnacceptableError::new_err(text),
        _ => PortError::new_err(text),
    }
}

/// The words of this package for a remedy.
fn words(remedy: Remedy) -> String {
    match remedy {
        Remedy::SaveParkPose => ": save_park_pose() saves it".to_owned(),
        Remedy::TorqueOn => ": set_torque(True) switches it on".to_owned(),
        _ => String::new(),
    }
}

/// The exception for a stop that failed for this reason.
pub(crate) fn not_stopped(error: impl Display) -> PyErr {
    NotStoppedError::new_err(error.to_string())
}

/// The exception for an invalid argument.
pub(crate) fn value_error(error: impl Display) -> PyErr {
    PyValueError::new_err(error.to_string())
}

/// The exception for an invalid value in an answer.
pub(crate) fn unacceptable(error: impl Display) -> PyErr {
    UnacceptableError::new_err(error.to_string())
}

/// The exception for a call of a closed reader.
pub(crate) fn closed() -> PyErr {
    ClosedError::new_err("the reader is closed")
}

/// The exception for a call from a signal handler that interrupts a call of the same object.
pub(crate) fn reentered() -> PyErr {
    PyRuntimeError::new_err(
        "a signal handler cannot call the arm or adapter whose call it interrupts: raise an exception to end that call",
    )
}
