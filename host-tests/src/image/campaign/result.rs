//! The result of a step of a run.

use std::error::Error;

/// The result of a step of a run. The error describes a violated invariant.
pub type Result<T = (), E = Box<dyn Error>> = std::result::Result<T, E>;
