//! Errors of commands, each one line with a remedy.

use std::error;
use std::fmt::Display;
use std::io;

use armwire::ErrorFrame;
use armwire::ling::legacy::OlderGeneration;
use armwire_bridge::control::VERSION;

use crate::received::Missing;

/// The reason for a failed command.
#[derive(Debug, thiserror::Error)]
#[allow(
    missing_docs,
    reason = "`name` is what the user calls the port, `reason` is in words"
)]
#[non_exhaustive]
pub enum Error {
    /// A port does not have what was asked of it.
    #[error("{0}")]
    Port(String),
    /// Something fails at a port, a host or a file, with a reason for the user only.
    #[error("{name}: {reason}")]
    At { name: String, reason: String },
    /// The arm or the adapter refuses the request.
    #[error("{name}: {reason}")]
    Refused { name: String, reason: String },
    /// The received bytes are no message of this arm, or an unacceptable one.
    #[error("{name}: {reason}")]
    Unacceptable { name: String, reason: String },
    /// The arm answered with an error frame.
    #[error("{name}: the arm answered with an error frame, which no document explains: {frame}")]
    ErrorFrame { name: String, frame: ErrorFrame },
    /// The program that waits wants no answer any more, for this reason of its own.
    #[error("{0}")]
    Interrupted(Box<dyn error::Error + Send + Sync>),
    /// The port or the connection is gone that was open: it may come back.
    #[error("{name}: {reason}")]
    Lost { name: String, reason: String },
    /// Another program has the port. `holder` describes it.
    #[error("{name}: in use by {holder}: close that one first")]
    InUse { name: String, holder: String },
    /// The port accepts no bytes.
    #[error("{name}: the port accepts no bytes: is the adapter stuck?")]
    Stuck { name: String },
    /// The arm is of the older generation, which is sent nothing.
    #[error("{name}: this is {legacy} 'armwire monitor' shows its joints.")]
    Legacy { name: String, legacy: OlderGeneration },
    /// The arm did not answer, though perhaps bytes came.
    #[error("{name}: {cause}")]
    NoAnswer {
        name: String,
        cause: String,
        missing: Missing,
        bytes: usize,
    },
    /// The arm was not stopped. It may still move.
    #[error("{name}: not stopped: {cause}")]
    NotStopped { name: String, cause: String },
    /// There is no adapter with a control port there.
    #[error("{name}: no control port of an armwire adapter found (a virtual board's is control:PATH)")]
    NoControl { name: String },
    /// The control port is there, but cannot be used.
    #[error("{name}: {reason}")]
    Usb { name: String, reason: String },
    /// The adapter does not know a request.
    #[error(
        "{name}: the adapter does not support this request: its control protocol is version {version}, this program's is \
         {VERSION}"
    )]
    Unsupported { name: String, version: u16 },
}

impl Error {
    /// An error at `name`.
    pub fn at(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.to_owned(), reason.to_string());
        Self::At { name, reason }
    }

    /// An arm or an adapter at `name` that refuses a request.
    pub fn refused(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.to_owned(), reason.to_string());
        Self::Refused { name, reason }
    }

    /// Unacceptable bytes from `name`.
    pub fn unacceptable(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.to_owned(), reason.to_string());
        Self::Unacceptable { name, reason }
    }

    /// A lost connection to `name`.
    pub fn lost(name: &str, reason: impl Display) -> Self {
        let (name, reason) = (name.to_owned(), reason.to_string());
        Self::Lost { name, reason }
    }

    /// A port that was unplugged.
    pub fn unplugged(name: &str, error: &io::Error) -> Self {
        Self::lost(name, format_args!("the port is gone ({error}): was it unplugged?"))
    }
}
