//! Errors of commands, each one line with a remedy.

use std::fmt::Display;
use std::io;

use armwire::framing::Reason;
use armwire_host::Error as Host;

use crate::remedies;

/// The reason for a failed command.
#[derive(Debug, thiserror::Error)]
pub(crate) enum Error {
    /// An arm, an adapter or a port fails.
    #[error("{}", remedies::text(.0))]
    Host(#[from] Host),
    /// The arguments do not go together.
    #[error("{0}")]
    Usage(String),
    /// The user declined.
    #[error("cancelled")]
    Declined,
    /// The stream of a line without losses broke.
    #[error(
        "{name}: the stream is broken at byte {offset}: {reason}: is it one direction of one connection, from its start?"
    )]
    Undecodable { name: String, offset: u64, reason: Reason },
    /// Parts of a recording were not understood. They are in the output.
    #[error("{name}: {reasons}, see the output")]
    NotUnderstood { name: String, reasons: String },
    /// The output went nowhere.
    #[error("cannot write the output: {0}")]
    Output(io::Error),
    /// A motion ended for this cause, and the arm like this.
    #[error("{cause}; {end}")]
    Ended { cause: Box<Error>, end: String },
    /// A recording could not be written.
    #[error("{path}: {reason}")]
    Recording { path: String, reason: String },
    /// Ctrl-C could not be caught.
    #[error("cannot catch Ctrl-C: {0}")]
    Signals(ctrlc::Error),
}

impl Error {
    /// Returns true for an error in the arguments.
    pub(crate) fn is_usage(&self) -> bool {
        matches!(self, Self::Usage(_) | Self::Host(Host::Port(_) | Host::Baud { .. }))
    }

    /// The exit status of a program that fails with this error.
    pub(crate) fn status(&self) -> u8 {
        match self {
            Self::NotUnderstood { .. } => 3,
            // As clap.
            error if error.is_usage() => 2,
            _ => 1,
        }
    }

    /// The error with what only the adapter or the system knows of it, which `explain` asks.
    pub(crate) fn explained(self, explain: impl FnOnce(Host) -> Host) -> Self {
        match self {
            Self::Host(error) => explain(error).into(),
            error => error,
        }
    }

    /// An error at `name`.
    pub(crate) fn at(name: &str, reason: impl Display) -> Self {
        Host::at(name, reason).into()
    }

    /// An arm or an adapter at `name` that refuses a request.
    pub(crate) fn refused(name: &str, reason: impl Display) -> Self {
        Host::refused(name, reason).into()
    }
}
